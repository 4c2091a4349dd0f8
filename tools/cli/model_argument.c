// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/model_argument.h"

#include <string.h>

#include "cli/interrupt.h"
#include "cli/progress.h"

bool model_open(const char *model, const sgs_model_read_options *options, opened_model *opened)
{
    *opened = (opened_model){0};
    if (!model_locate(model, &opened->located))
        return false;
    if (sgs_model_read(opened->located.ply_path, options, &opened->gaussians, &opened->info)) {
        fail_library();
        model_path_free(&opened->located);
        return false;
    }
    const char *filter = json_string_value(config_option(opened->located.config, "filter"));
    opened->antialiased = opened->info.antialiased || (filter && !strcmp(filter, "mip"));
    return true;
}

void opened_model_free(opened_model *opened)
{
    sgs_gaussians_destroy(opened->gaussians);
    model_path_free(&opened->located);
    *opened = (opened_model){0};
}

bool model_read(const model_path *located, drawing_values *drawing, sgs_gaussians **gaussians)
{
    sgs_model_info info;
    if (sgs_model_read(located->ply_path, NULL, gaussians, &info)) {
        fail_library();
        return false;
    }
    if (drawing && info.antialiased && !drawing->filter_selected)
        drawing->filter = SGS_FILTER_MIP;
    return true;
}

bool model_show_encoding(void *user, size_t done, size_t total)
{
    (void)user;
    progress_work("encoding", done, total);
    return !interrupt_signal();
}
