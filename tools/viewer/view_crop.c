// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/view_crop.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "arguments/model_argument.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "sparegs/model_file.h"

unsigned char *crop_keep(const view_crop *crop, view_source *source)
{
    const sgs_gaussians *model = source->model;
    const region_map *regions =
        crop->region >= 0 || crop->slack > -INFINITY ? view_source_regions(source) : NULL;
    static const sgs_floater_options floaters = {.opacity = 0.1, .share = 0.01}; // as auto
    model_condition conditions[3];
    for (int k = 0; k < 3; ++k) {
        conditions[k] = (model_condition){.comparison = SGS_LESS_EQUAL, .value = crop->size};
        snprintf(conditions[k].name, sizeof conditions[k].name, "scale_%d", k);
    }
    const model_filter filter = {.box = crop->has_box ? crop->box : NULL,
                                 .sphere = crop->has_sphere ? crop->sphere : NULL,
                                 .conditions = conditions,
                                 .condition_count = crop->size > 0 ? 3 : 0,
                                 .opacity = crop->opacity,
                                 .region = regions ? regions->region : NULL,
                                 .slack = regions ? regions->slack : NULL,
                                 .only_region = crop->region,
                                 .slack_low = crop->slack,
                                 .floaters = crop->floaters ? &floaters : NULL};
    unsigned char *keep = malloc(model->count + 1);
    if (keep && model_filter_select(&filter, model, keep))
        return keep;
    free(keep);
    return NULL;
}

static size_t count_kept(const unsigned char *keep, size_t count)
{
    size_t kept = 0;
    for (size_t i = 0; i < count; ++i)
        kept += keep[i];
    return kept;
}

// Colour red of every direction.
static void paint_red(sgs_gaussians *model, size_t row)
{
    static const float red[3] = {1.6F, -1.6F, -1.6F}; // coefficients of band 0
    for (int k = SGS_PARAM_SH_DC; k < SGS_PARAM_COUNT; ++k)
        *sgs_gaussians_at(model, row, k) = k < SGS_PARAM_SH_REST ? red[k - SGS_PARAM_SH_DC] : 0;
}

bool crop_preview_prepare(crop_preview *preview, const view_crop *crop, view_source *source)
{
    const sgs_gaussians *model = source->model;
    const uint64_t version = atomic_load(&source->version);
    if (preview->renderer && preview->version == version && view_crop_equal(&preview->crop, crop))
        return true;
    if (!preview->model && sgs_gaussians_create(model->count, &preview->model))
        return false;
    unsigned char *keep = crop_keep(crop, source);
    bool done = keep && !sgs_gaussians_copy(preview->model, model);
    if (done) {
        preview->removed = model->count - count_kept(keep, model->count);
        for (size_t i = 0; i < model->count; ++i)
            if (crop->preview == CROP_MARK && !keep[i])
                paint_red(preview->model, i);
        if (crop->preview == CROP_HIDE)
            sgs_selection_apply(preview->model, keep);
        done = preview->renderer ? !sgs_renderer_update(preview->renderer)
                                 : view_renderer_create(preview->model, &preview->renderer);
    }
    free(keep);
    preview->crop = *crop;
    preview->version = done ? version : UINT64_MAX;
    return done;
}

void crop_preview_free(crop_preview *preview)
{
    sgs_renderer_destroy(preview->renderer);
    sgs_gaussians_destroy(preview->model);
    *preview = (crop_preview){0};
}

// Writes the primitives that are kept. NULL after printing the error.
static json_t *write_kept(const char *path, const sgs_gaussians *kept, const view_source *source)
{
    const sgs_model_write_options options = model_write_options(&source->drawing);
    sgs_model_written written;
    if (!kept->count)
        fail_run("the crop keeps no primitive; nothing was written");
    else if (sgs_model_write(path, kept, &options, &written))
        fail_library();
    else
        return json_pack("{s:s,s:o,s:I,s:I}", "type", "crop", "path", json_text(path), "kept",
                         (json_int_t)kept->count, "removed",
                         (json_int_t)(source->model->count - kept->count));
    return NULL;
}

json_t *crop_save(const view_crop *crop, view_source *source, sgs_progress_fn progress, void *user)
{
    const sgs_gaussians *model = source->model;
    unsigned char *keep = crop_keep(crop, source);
    sgs_gaussians *kept = NULL;
    json_t *reply = NULL;
    const int n = free_number(source->folder, "crop", "ply");
    char *path = format_text("%s/crop_%04d.ply", source->folder, n);
    if (n && keep && !sgs_gaussians_create(model->count, &kept) &&
        !sgs_gaussians_copy(kept, model)) {
        sgs_selection_apply(kept, keep);
        if (!progress || progress(user, 0, 1))
            reply = write_kept(path, kept, source);
    }
    free(path);
    free(keep);
    sgs_gaussians_destroy(kept);
    return reply;
}
