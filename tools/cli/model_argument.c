// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/model_argument.h"

#include <stdlib.h>
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

static int compare_values(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

void model_measure(const sgs_gaussians *model, double center[3], double *range)
{
    enum { SAMPLES = 10000 };
    const size_t count = model->count, kept = count < SAMPLES ? count : SAMPLES;
    float *values = malloc((kept + 1) * sizeof *values);
    *range = 0;
    for (int k = 0; k < 3; ++k) {
        center[k] = 0;
        for (size_t i = 0; values && i < kept; ++i)
            values[i] = *sgs_gaussians_at(model, i * count / kept, SGS_PARAM_MEAN + k);
        if (!values || !kept)
            continue;
        qsort(values, kept, sizeof *values, compare_values);
        const double along = (double)values[kept - 1 - kept / 10] - (double)values[kept / 10];
        center[k] = (double)values[kept / 2];
        *range = along > *range ? along : *range;
    }
    free(values);
    if (!(*range > 0))
        *range = 1;
}

// The cameras of a data set are spread over about a quarter of what they see.
static double near_distance_of(const sgs_gaussians *model)
{
    double center[3], range;
    model_measure(model, center, &range);
    return sgs_near_distance(range / 4);
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
    if (drawing && !drawing->near_selected)
        drawing->near_distance = near_distance_of(*gaussians);
    return true;
}

void model_warn_unmarked(const char *path, const sgs_model_write_options *options)
{
    sgs_model_format format;
    if (!sgs_model_format_of_name(path, &format))
        return;
    if (options->antialiased && !sgs_model_format_marks_filter(format))
        print_warning("%s: %s has no mark for models trained with Mip-Splatting's filters; render "
                      "with --filter mip",
                      path, sgs_model_format_name(format));
}

bool model_show_encoding(void *user, size_t done, size_t total)
{
    (void)user;
    progress_work("encoding", done, total);
    return !interrupt_signal();
}
