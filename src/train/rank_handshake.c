// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Every rank describes itself in lines "what: value", which sgs_ranks_compare compares.

#include "train/rank_handshake.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "base/core.h"
#include "image/mask.h"
#include "sparegs/option_descriptors.h"
#include "sparegs/rank_check.h"
#include "sparegs/runtime.h"

// A hash of functions whose last bit may differ between C libraries.
static uint64_t arithmetic(void)
{
    enum { PROBES = 4096 };
    XXH64_state_t *state = XXH64_createState();
    if (!state)
        return 0;
    XXH64_reset(state, 0);
    for (uint64_t i = 0; i < PROBES; ++i) {
        const double x = 40.0 * sgsi_random_uniform(1, i) - 20.0;
        const double values[] = {exp(x),
                                 log(fabs(x) + 1e-9),
                                 pow(fabs(x), 0.37),
                                 tanh(x),
                                 expm1(0.1 * x),
                                 log1p(fabs(x)),
                                 sin(x),
                                 cos(x),
                                 tan(x),
                                 atan(x),
                                 atan2(x, 1.0 + cos(3.0 * x)),
                                 hypot(x, 1.0 + cos(3.0 * x)),
                                 log10(fabs(x) + 1e-9)};
        const float value = expf((float)x);
        XXH64_update(state, values, sizeof values);
        XXH64_update(state, &value, sizeof value);
    }
    const uint64_t digest = XXH64_digest(state);
    XXH64_freeState(state);
    return digest;
}

// The sets of a class compute the same bits.
static const char *isa_class(void)
{
#ifdef __x86_64__
    return sgs_isa_get() == SGS_ISA_BASELINE ? "x86-64 without fused multiply-add"
                                             : "with fused multiply-add";
#else
    return "with fused multiply-add";
#endif
}

char *sgs_rank_program_text(void)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    if (!out)
        return NULL;
    fprintf(out,
            "version: %s (%s)\ninstruction set: %s\narithmetic of the C library: %016" PRIx64 "\n",
            sgs_version(), sgs_version_commit(), isa_class(), arithmetic());
    if (!fclose(out))
        return text;
    free(text);
    return NULL;
}

uint64_t sgs_rank_file_digest(const char *path)
{
    unsigned char bytes[1 << 14];
    XXH64_state_t *state = XXH64_createState();
    FILE *file;
    size_t size;
    uint64_t digest = 0;
    sgsi_errors_suspend();
    const bool opened = state && !sgsi_file_open(path, &file, &size);
    sgsi_errors_resume();
    if (opened) {
        XXH64_reset(state, 0);
        for (size_t n; (n = fread(bytes, 1, sizeof bytes, file)) > 0;)
            XXH64_update(state, bytes, n);
        digest = ferror(file) ? 0 : XXH64_digest(state);
        fclose(file);
    }
    XXH64_freeState(state);
    return digest;
}

uint64_t sgs_rank_camera_digest(const sgs_camera *camera, const sgs_pose *pose)
{
    const uint64_t parts[] = {(uint64_t)camera->model << 32 | (uint32_t)camera->width,
                              (uint32_t)camera->height,
                              XXH64(camera->params, sizeof camera->params, 0),
                              XXH64(pose->rotation, sizeof pose->rotation, 0),
                              XXH64(pose->translation, sizeof pose->translation, 0)};
    return XXH64(parts, sizeof parts, 0);
}

uint64_t sgs_rank_photo_digest(const sgs_photo *photo)
{
    const size_t values = (size_t)photo->channels * (size_t)photo->width * (size_t)photo->height;
    const size_t words = sgs_mask_words(photo->width) * (size_t)photo->height;
    const uint64_t parts[] = {
        (uint64_t)photo->width << 32 | (uint32_t)photo->height,
        photo->halves ? XXH64(photo->halves, values * sizeof *photo->halves, 1)
                      : XXH64(photo->pixels, values, 0),
        photo->valid_mask ? XXH64(photo->valid_mask, words * sizeof *photo->valid_mask, 0) : 0};
    return XXH64(parts, sizeof parts, 0);
}

static void describe_options(FILE *out, const sgs_train_options *options)
{
    size_t count;
    const sgs_train_option *rows = sgs_train_option_descriptors(&count);
    for (size_t i = 0; i < count; ++i) {
        char value[256];
        if (rows[i].type == SGS_OPTION_MODEL) // replaced by the model after creation
            continue;
        sgs_train_option_text(&rows[i], options, value, sizeof value);
        fprintf(out, "option %s: %s\n", rows[i].name, value);
    }
}

// All views of the scene: held-out ones are scored after the training, each on one rank.
static sgs_status describe_views(FILE *out, const sgsi_train_views *views)
{
    const sgs_scene *scene = views->scene;
    const size_t ahead = sgs_scene_prefetch_count(scene);
    fprintf(out, "number of training views: %zu\nnumber of held-out views: %zu\n", views->count,
            scene->view_count - views->count);
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *view = &scene->views[i];
        const sgs_photo *photo;
        for (size_t k = i + 1; k <= i + ahead; ++k)
            sgs_scene_prefetch(scene, k);
        const sgs_status status = sgs_scene_photo(scene, i, &photo);
        if (status)
            return status;
        fprintf(out, "split of %s: %s\ncamera of %s: %016" PRIx64 "\nphoto %s: %016" PRIx64 "\n",
                view->name, view->split == SGS_SPLIT_TEST ? "held out" : "training", view->name,
                sgs_rank_camera_digest(&view->camera, &view->pose), view->name,
                sgs_rank_photo_digest(photo));
    }
    return SGS_STATUS_OK;
}

sgs_status sgsi_rank_handshake(const sgsi_train_views *views, const sgs_gaussians *model,
                               double near_limit, sgs_ranks *ranks)
{
    char hash[17];
    char *text = NULL, *program = sgs_rank_program_text();
    size_t size = 0;
    sgs_status status = SGS_STATUS_OK;
    FILE *out = program ? open_memstream(&text, &size) : NULL;
    if (out) {
        fputs(program, out);
        describe_options(out, views->options);
        sgs_gaussians_hash(model, hash);
        fprintf(out, "initial model: %s\n", hash);
        status = describe_views(out, views);
        fprintf(out, "median depth of the points: %.17g\n", near_limit);
    }
    if ((!out || fclose(out)) && !status)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to describe %zu views",
                           views->scene->view_count);
    free(program);
    status = sgs_ranks_compare(ranks, status, text ? text : "");
    free(text);
    return status;
}
