// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The loop. One iteration, in 3DGS's order (Kerbl et al. 2023, algorithm 1): rate and SH ramp, pick
// a view, project, refit or rebuild the BVH, forward, loss, backward, statistics, optimiser step;
// here the model may be saved; structural update and opacity reset, at the beginning of the next
// call. Two quirks of the original are kept because they shape quality:
// there is no optimiser step on iterations with a structural update, and moments of new rows start
// at zero under a step counter that goes on.

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/core.h"
#include "optimize/optimize.h"
#include "sparegs/image.h"
#include "base/threads.h"
#include "train/traffic.h"
#include "train/trainer_state.h"

enum { FILTER_INTERVAL = 100 };

sgs_train_options sgs_train_options_default(void)
{
    return (sgs_train_options){.iterations = 30000,
                               .schedule = SGS_SCHEDULE_SCALED,
                               .pipeline = SGS_PIPELINE_3DGS,
                               .filter = SGS_FILTER_3DGS,
                               .optimizer = SGS_OPTIMIZER_SPARSE,
                               .sh_degree = 3,
                               .compact_box = 1.0,
                               .spare = SGS_SPARE_ALL,
                               .spare_grid = 32,
                               .spare_tau_alpha = 0.05,
                               .spare_eps_loss = 0.008,
                               .spare_eps_count = 0.01,
                               .spare_patience = 2,
                               .spare_interval = 1000,
                               .spare_demand = SGS_DEMAND_ALL,
                               .spare_budget = 1.0,
                               .random_points = 100000,
                               .pipeline_options = {.taming_multiplier = 20,
                                                    .taming_opacity = SGS_TAMING_FROZEN,
                                                    .fastgs_loss = 0.1,
                                                    .fastgs_gradient = 0.0012,
                                                    .fastgs_dense = 0.001}};
}

static sgs_status check_options(const sgs_train_options *o)
{
#define SGSI_REQUIRE(condition, text)                                                              \
    if (!(condition))                                                                              \
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, text)
    SGSI_REQUIRE(o->iterations >= 1 && o->iterations <= 10000000,
                 "iterations must be between 1 and 10000000");
    SGSI_REQUIRE((unsigned)o->pipeline < SGS_PIPELINE_COUNT,
                 "pipeline must be one of sgs_pipeline");
    SGSI_REQUIRE((unsigned)o->filter <= SGS_FILTER_MIP, "filter must be 3dgs, none or mip");
    SGSI_REQUIRE(o->sh_degree >= 0 && o->sh_degree <= 3, "SH degree must be between 0 and 3");
    SGSI_REQUIRE((unsigned)o->pipeline_options.taming_opacity <= SGS_TAMING_LINEAR,
                 "opacities of Taming 3DGS must be frozen, trained or linear");
    SGSI_REQUIRE(o->pipeline != SGS_PIPELINE_TAMING ||
                     o->pipeline_options.taming_opacity != SGS_TAMING_LINEAR ||
                     o->filter != SGS_FILTER_MIP,
                 "linear opacities do not go with the mip filter");
    SGSI_REQUIRE(o->compact_box > 0 && o->compact_box <= 1, "the compact box must be in (0, 1]");
    SGSI_REQUIRE(o->spare_grid >= 2 && o->spare_grid <= 256,
                 "the SPARE-GS grid must be between 2 and 256");
    SGSI_REQUIRE(o->spare_tau_alpha >= 0 && o->spare_tau_alpha <= 1,
                 "SPARE-GS's tau_alpha must be between 0 and 1");
    SGSI_REQUIRE(o->spare_eps_loss >= 0 && o->spare_eps_count >= 0,
                 "SPARE-GS's tolerances must not be negative");
    SGSI_REQUIRE(o->spare_patience >= 1 && o->spare_interval >= 1,
                 "SPARE-GS's patience and interval must be at least 1");
    SGSI_REQUIRE(o->alpha_loss >= 0 && o->alpha_loss <= 1000,
                 "the weight of the alpha loss must be between 0 and 1000");
    SGSI_REQUIRE(o->spare_budget > 0 && o->spare_budget <= 100,
                 "SPARE-GS's budget must be between 0 and 100 times the count");
    const sgs_pipeline_options *own = &o->pipeline_options;
    SGSI_REQUIRE(own->taming_multiplier > 0 && own->taming_multiplier <= 1e6,
                 "Taming's multiplier must be between 0 and 1000000");
    SGSI_REQUIRE(own->fastgs_loss >= 0 && own->fastgs_loss <= 1,
                 "FastGS's loss threshold must be between 0 and 1");
    SGSI_REQUIRE(own->fastgs_gradient > 0 && own->fastgs_dense > 0,
                 "FastGS's thresholds must be positive");
    for (int c = 0; c < 3; ++c)
        SGSI_REQUIRE(o->background[c] >= 0 && o->background[c] <= 1,
                     "background colours must be between 0 and 1");
#undef SGSI_REQUIRE
    return SGS_STATUS_OK;
}

// Random cloud: in the cube around the origin for NeRF synthetic scenes, around the cameras
// otherwise.
static sgs_status random_cloud(sgs_trainer *trainer)
{
    const sgs_scene *scene = trainer->scene;
    size_t n = trainer->options.random_points;
    if (trainer->options.max_gaussians && n > trainer->options.max_gaussians)
        n = trainer->options.max_gaussians;
    trainer->cloud_points = sgsi_alloc(n ? n : 1, 3 * sizeof(float));
    trainer->cloud_colors = sgsi_alloc(n ? n : 1, 3);
    if (!trainer->cloud_points || !trainer->cloud_colors)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for %zu random points", n);
    const bool cube = scene->white_background != 0;
    const double half = cube ? 1.3 : 3.0 * scene->extent;
    for (size_t i = 0; i < 3 * n; ++i) {
        const double u = sgsi_random_uniform(trainer->options.seed ^ 0xC10D, i);
        trainer->cloud_points[i] =
            (float)((cube ? 0.0 : scene->center[i % 3]) + half * (2.0 * u - 1.0));
        // The original draws SH coefficients in [0, 1] / 255: colours just above middle grey.
        const double coefficient = sgsi_random_uniform(trainer->options.seed ^ 0xC0108, i) / 255.0;
        trainer->cloud_colors[i] =
            (unsigned char)(255.0 * (0.5 + 0.28209479177387814 * coefficient) + 0.5);
    }
    trainer->cloud_count = n;
    return SGS_STATUS_OK;
}

// The scene's cloud, thinned at random to the cap.
static sgs_status scene_cloud(sgs_trainer *trainer)
{
    const sgs_scene *scene = trainer->scene;
    const size_t cap = trainer->options.max_gaussians, n = scene->point_count;
    const size_t wanted = cap && cap < n ? cap : n;
    trainer->cloud_points = sgsi_alloc(wanted, 3 * sizeof(float));
    trainer->cloud_colors = sgsi_alloc(wanted, 3);
    if (!trainer->cloud_points || !trainer->cloud_colors)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for %zu points", wanted);
    if (wanted < n)
        sgsi_warn("the sparse model has %zu points; %zu are drawn at random to honour the cap", n,
                  wanted);
    size_t taken = 0;
    for (size_t i = 0; i < n && taken < wanted; ++i) {
        // Selection sampling (Knuth, algorithm S): each subset of the size equally likely, order
        // kept.
        if ((double)(n - i) * sgsi_random_uniform(trainer->options.seed ^ 0x5A3D, i) >=
            (double)(wanted - taken))
            continue;
        memcpy(trainer->cloud_points + 3 * taken, scene->points + 3 * i, 3 * sizeof(float));
        for (size_t c = 0; c < 3; ++c) {
            const unsigned char color = scene->colors[3 * i + c]; // of display-encoded photographs
            trainer->cloud_colors[3 * taken + c] =
                scene->space == SGS_SPACE_SRGB
                    ? color
                    : (unsigned char)(255.0f * sgs_srgb_decode((float)color / 255.0f) + 0.5f);
        }
        ++taken;
    }
    trainer->cloud_count = taken;
    return SGS_STATUS_OK;
}

static sgs_status copy_initial_model(sgs_trainer *trainer, const sgs_gaussians *from)
{
    const size_t cap = trainer->options.max_gaussians;
    size_t wanted = cap && cap < from->count ? cap : from->count, taken = 0;
    if (wanted < from->count)
        sgsi_warn("the initial model has %zu primitives; %zu of them, drawn at random, are left by "
                  "the limit (--max-gaussians)",
                  from->count, wanted);
    sgs_status status = sgs_gaussians_create(wanted + SGS_LANES, &trainer->model);
    if (!status)
        status = sgs_gaussians_resize(trainer->model, wanted);
    if (status)
        return status;
    for (size_t i = 0; i < from->count && taken < wanted; ++i) {
        if ((double)(from->count - i) * sgsi_random_uniform(trainer->options.seed ^ 0x5A3D, i) >=
            (double)(wanted - taken))
            continue;
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(from, i, params);
        params[SGS_PARAM_OPACITY] = sgs_gaussians_opacity_logit(from, i);
        sgs_gaussians_set(trainer->model, taken++, params);
    }
    return SGS_STATUS_OK;
}

static sgs_status create_model(sgs_trainer *trainer)
{
    sgs_status status;
    if (trainer->options.init) {
        status = copy_initial_model(trainer, trainer->options.init);
        trainer->options.init = NULL;
    } else {
        status = trainer->scene->point_count ? scene_cloud(trainer) : random_cloud(trainer);
        if (!status)
            status = sgs_gaussians_init_points(trainer->cloud_points, trainer->cloud_colors,
                                               trainer->cloud_count, 0.01 * trainer->scene->extent,
                                               &trainer->model);
    }
    if (status)
        return status;
    trainer->model->sh_degree = trainer->options.sh_degree;
    status = sgsi_density_sort(trainer->model);
    if (!status && !trainer->model->count)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "no primitive to start from is finite");
    if (status)
        return status;
    trainer->m = sgsi_calloc_shared(trainer->model->capacity, SGS_PARAM_COUNT * sizeof(float));
    trainer->v = sgsi_calloc_shared(trainer->model->capacity, SGS_PARAM_COUNT * sizeof(float));
    if (!trainer->m || !trainer->v)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for the optimiser of %zu primitives",
                         trainer->model->count);
    trainer->progress.pipeline.initial_count = (int64_t)trainer->model->count;
    status = sgsi_trainer_reserve_accumulated_grad(trainer);
    if (!status)
        status = sgsi_trainer_update_filter_3d(trainer);
    return status ? status
                  : sgsi_statistics_reserve(&trainer->statistics, trainer->model->capacity);
}

static sgs_status create_views(sgs_trainer *trainer)
{
    const sgs_scene *scene = trainer->scene;
    trainer->train_views =
        sgsi_calloc(scene->view_count ? scene->view_count : 1, sizeof *trainer->train_views);
    trainer->order = sgsi_calloc(scene->view_count ? scene->view_count : 1, sizeof *trainer->order);
    trainer->depth_bounds =
        sgsi_calloc(scene->view_count ? scene->view_count : 1, sizeof *trainer->depth_bounds);
    trainer->tile_counts =
        sgsi_calloc(scene->view_count ? scene->view_count : 1, sizeof *trainer->tile_counts);
    if (!trainer->train_views || !trainer->order || !trainer->depth_bounds || !trainer->tile_counts)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for %zu views", scene->view_count);
    int width = 1, height = 1;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *view = &scene->views[i];
        if (view->split != SGS_SPLIT_TRAIN || !view->image.width)
            continue;
        const size_t k = trainer->train_view_count++;
        const size_t tiles = (size_t)((view->camera.width + SGSI_TILE - 1) / SGSI_TILE) *
                             (size_t)((view->camera.height + SGSI_TILE - 1) / SGSI_TILE);
        trainer->train_views[k] = i;
        trainer->tile_counts[k] = tiles;
        trainer->depth_bounds[k] = sgsi_alloc(tiles, sizeof(float));
        if (!trainer->depth_bounds[k])
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for %zu views",
                             scene->view_count);
        for (size_t t = 0; t < tiles; ++t)
            trainer->depth_bounds[k][t] = INFINITY;
        width = view->camera.width > width ? view->camera.width : width;
        height = view->camera.height > height ? view->camera.height : height;
    }
    if (!trainer->train_view_count)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: no view is left for training; hold out fewer", scene->path);
    trainer->plane_floats = ((size_t)width + 15) / 16 * 16 * (size_t)height;
    trainer->planes = sgsi_calloc_shared(trainer->plane_floats, 8 * sizeof(float));
    if (!trainer->planes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for images of %dx%d pixels", width,
                         height);
    const sgs_status status = sgsi_loss_reserve(trainer->loss, width, height);
    if (status || !trainer->options.exposure)
        return status;
    return sgsi_exposure_create(trainer->train_view_count, trainer->plane_floats, (size_t)height,
                                &trainer->exposure);
}

sgs_status sgs_trainer_create(const sgs_scene *scene, const sgs_train_options *options,
                              sgs_trainer **trainer)
{
    *trainer = NULL;
    sgs_status status = check_options(options);
    if (status)
        return status;
    sgs_trainer *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for a trainer");
    made->scene = scene;
    made->options = *options;
    made->pipeline = sgsi_pipeline_get(options->pipeline);
    made->structure_changed = true;
    made->progress.last_reset = -1;
    spare_equilibrium_begin(&made->progress.equilibrium);
    status = sgsi_tracer_create(&made->tracer);
    if (!status)
        sgsi_tracer_collect_abs_grad(made->tracer, made->pipeline->abs_grad);
    if (!status)
        status = sgsi_ray_cache_create((size_t)1 << 30, &made->rays);
    if (!status)
        status = sgsi_loss_create(&made->loss);
    if (!status)
        status = create_views(made);
    made->schedule = sgsi_schedule_make(options, made->train_view_count);
    if (!status)
        status = sgsi_trainer_resolution_plan(made);
    if (!status)
        status = create_model(made);
    if (status) {
        sgs_trainer_destroy(made);
        return status;
    }
    *trainer = made;
    return SGS_STATUS_OK;
}

void sgs_trainer_destroy(sgs_trainer *trainer)
{
    if (!trainer)
        return;
    for (size_t i = 0; trainer->depth_bounds && i < trainer->train_view_count; ++i)
        sgsi_free(trainer->depth_bounds[i]);
    sgsi_exposure_destroy(trainer->exposure);
    sgsi_loss_destroy(trainer->loss);
    sgsi_ray_cache_destroy(trainer->rays);
    sgsi_tracer_destroy(trainer->tracer);
    sgsi_statistics_free(&trainer->statistics);
    sgsi_trainer_scores_free(&trainer->scores);
    sgsi_free((void *)trainer->regions.regions);
    sgsi_small_images_free(&trainer->small_images);
    sgs_gaussians_destroy(trainer->model);
    void *const arrays[] = {trainer->m,
                            trainer->v,
                            trainer->train_views,
                            trainer->order,
                            trainer->depth_bounds,
                            trainer->tile_counts,
                            trainer->planes,
                            trainer->cloud_points,
                            trainer->cloud_colors,
                            trainer->accumulated_grad,
                            trainer->accumulated_rows,
                            trainer->filter_3d};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
        sgsi_free(arrays[i]);
    sgsi_free(trainer);
}

// A random permutation per epoch, drawn from the seed and the epoch alone.
static size_t next_view(sgs_trainer *trainer)
{
    sgsi_progress *progress = &trainer->progress;
    const size_t n = trainer->train_view_count;
    if (progress->order_position >= n || (!progress->order_position && !progress->order_epoch)) {
        progress->order_position = 0;
        ++progress->order_epoch;
    }
    if (!progress->order_position) {
        const uint64_t seed =
            sgsi_random_bits(trainer->options.seed ^ 0x0EDE2, progress->order_epoch);
        for (size_t i = 0; i < n; ++i)
            trainer->order[i] = (uint32_t)i;
        for (size_t i = n; i-- > 1;) {
            const size_t k = (size_t)(sgsi_random_uniform(seed, i) * (double)(i + 1));
            const uint32_t kept = trainer->order[i];
            trainer->order[i] = trainer->order[k];
            trainer->order[k] = kept;
        }
    }
    return trainer->order[progress->order_position++];
}

// The views after this one, as far as this epoch's order tells.
static void expect_next_views(const sgs_trainer *trainer)
{
    const size_t next = trainer->progress.order_position;
    for (size_t i = next; i < next + 2 && i < trainer->train_view_count; ++i)
        sgs_scene_prefetch(trainer->scene, trainer->train_views[trainer->order[i]]);
}

static int active_sh_degree(const sgs_trainer *trainer, int iteration)
{
    const int degree = iteration / trainer->schedule.sh_interval;
    return degree < trainer->options.sh_degree ? degree : trainer->options.sh_degree;
}

static void set_planes(sgs_trainer *trainer, step_state *step)
{
    float *block = trainer->planes;
    const size_t n = trainer->plane_floats;
    const int width = step->camera.width, height = step->camera.height;
    step->planes = (sgsi_planes){.width = width,
                                 .height = height,
                                 .stride = ((size_t)width + 15) / 16 * 16,
                                 .color = {block, block + n, block + 2 * n},
                                 .transmittance = block + 3 * n};
    for (int c = 0; c < 3; ++c)
        step->d_color[c] = block + (size_t)(4 + c) * n;
    step->d_transmittance = block + 7 * n;
}

static sgs_status trace_forward(sgs_trainer *trainer, step_state *step)
{
    sgs_train_seconds *seconds = &trainer->progress.seconds;
    const sgsi_rays *rays;
    sgs_status status = sgsi_ray_cache_get(trainer->rays, &step->camera, &rays);
    if (status)
        return status;
    const sgs_render_options options = {.filter = trainer->options.filter,
                                        .near_distance = sgs_near_distance(trainer->scene->extent),
                                        .filter_3d = trainer->filter_3d,
                                        .sh_degree = active_sh_degree(trainer, step->iteration),
                                        .compact_box = trainer->options.compact_box};
    sgsi_view_set(&step->view, rays, &step->source->pose, &options);
    step->view.linear_opacity = trainer->model->linear_opacity;
    set_planes(trainer, step);
    const sgsi_statistics *statistics = step->statistics;
    status = sgsi_tracer_project(trainer->tracer, trainer->model, &step->view,
                                 statistics ? statistics->visible_count : NULL,
                                 statistics ? statistics->radius_max : NULL);
    if (!status)
        status = sgsi_tracer_commit(trainer->tracer, trainer->structure_changed, SGSI_BVH_REFIT);
    if (!status)
        status = sgsi_tracer_forward(trainer->tracer, &step->view, &step->planes,
                                     trainer->depth_bounds[step->view_index], true);
    if (status)
        return status;
    trainer->structure_changed = false;
    const sgsi_trace_seconds spent = sgsi_tracer_seconds(trainer->tracer);
    seconds->bvh_build += spent.bvh_build;
    seconds->bvh_refit += spent.bvh_refit;
    seconds->gather += spent.gather;
    seconds->forward += spent.project + spent.forward;
    return SGS_STATUS_OK;
}

static sgs_status evaluate_loss(sgs_trainer *trainer, step_state *step)
{
    const double start = sgsi_seconds();
    const sgsi_planes *planes = &step->planes;
    sgsi_loss_input input = {
        .width = planes->width,
        .height = planes->height,
        .stride = planes->stride,
        .color = {planes->color[0], planes->color[1], planes->color[2]},
        .transmittance = planes->transmittance,
        .background = {step->background[0], step->background[1], step->background[2]},
        .target = step->target,
        .ssim_weight = 0.2f,
        .alpha_weight = (float)trainer->options.alpha_loss};
    step->loss =
        (sgsi_loss_output){.d_color = {step->d_color[0], step->d_color[1], step->d_color[2]},
                           .d_transmittance = step->d_transmittance};
    const sgsi_loss_input image = input;
    if (trainer->exposure)
        sgsi_exposure_forward(trainer->exposure, step->view_index, &input);
    const sgs_status status = sgsi_loss_evaluate(trainer->loss, &input, &step->loss);
    if (trainer->exposure && !status)
        sgsi_exposure_backward(trainer->exposure, step->view_index, &image, &step->loss);
    trainer->progress.seconds.loss += sgsi_seconds() - start;
    return status;
}

// The photograph of step->view_index. It comes before all else, so that a file that cannot be read
// any more leaves the training as it was.
sgs_status sgsi_trainer_fetch(sgs_trainer *trainer, step_state *step)
{
    const size_t view = trainer->train_views[step->view_index];
    step->source = &trainer->scene->views[view];
    step->camera = step->source->camera;
    if (trainer->small_images.photos) {
        step->target = &trainer->small_images.photos[step->view_index];
        step->camera = sgs_camera_resized(&step->camera, step->target->width, step->target->height);
        return SGS_STATUS_OK;
    }
    const double start = sgsi_seconds();
    const sgs_status status = sgs_scene_photo(trainer->scene, view, &step->target);
    trainer->progress.seconds.image_io += sgsi_seconds() - start;
    return status;
}

// Forward and loss of a training view.
sgs_status sgsi_trainer_draw(sgs_trainer *trainer, step_state *step)
{
    for (int c = 0; c < 3; ++c)
        step->background[c] =
            trainer->options.background_random
                ? (float)sgsi_random_uniform(trainer->options.seed ^ 0xBAC6,
                                             3 * (uint64_t)step->iteration + (uint64_t)c)
                : trainer->options.background[c];
    const sgs_status status = trace_forward(trainer, step);
    return status ? status : evaluate_loss(trainer, step);
}

typedef struct optimize_job {
    sgsi_optimize input;
    atomic_size_t broken;
} optimize_job;

static void optimize_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    optimize_job *job = context;
    const size_t broken = sgsi_optimize_blocks(&job->input, begin, end);
    if (broken) // hardly ever
        atomic_fetch_add(&job->broken, broken);
}

static void optimize_step(sgs_trainer *trainer, const step_state *step)
{
    const double start = sgsi_seconds();
    const sgs_train_options *o = &trainer->options;
    const sgs_camera *camera = &step->camera;
    const bool dense = o->optimizer == SGS_OPTIMIZER_DENSE;
    const bool apply = !step->structural && !step->prunes && !step->last;
    sgsi_progress *progress = &trainer->progress;
    const bool step_main = apply && sgsi_schedule_steps_main(&trainer->schedule, step->iteration);
    const bool step_rest = apply && sgsi_schedule_steps_rest(&trainer->schedule, step->iteration);
    progress->adam_step += step_main;
    progress->rest_step += step_rest;
    const double t = fmax(progress->adam_step, 1), rest_t = fmax(progress->rest_step, 1);
    const double rate =
        1.6e-4 * trainer->scene->extent * sgsi_schedule_lr(&trainer->schedule, step->iteration);
    optimize_job job = {
        .input = {.params = trainer->model->data,
                  .m = trainer->m,
                  .v = trainer->v,
                  .count = trainer->model->count,
                  .view = step->view,
                  .sums = sgsi_tracer_grad_sums(trainer->tracer),
                  .touched = sgsi_tracer_touched(trainer->tracer),
                  .visible = sgsi_tracer_visible(trainer->tracer),
                  .dense = dense,
                  .apply = apply,
                  .lr_mean = (float)rate,
                  .lr_rotation = 1e-3f,
                  .lr_scale = 5e-3f,
                  .lr_opacity = sgsi_trainer_lr_opacity(trainer, step->iteration),
                  .lr_dc = 2.5e-3f,
                  .lr_rest = trainer->pipeline->lr_rest,
                  .beta1 = 0.9f,
                  .beta2 = 0.999f,
                  .epsilon = 1e-15f,
                  .correction1 = dense && apply ? (float)(1.0 / (1.0 - pow(0.9, t))) : 1.0f,
                  .correction2 = dense && apply ? (float)(1.0 / sqrt(1.0 - pow(0.999, t))) : 1.0f,
                  .rest_correction1 =
                      dense && apply ? (float)(1.0 / (1.0 - pow(0.9, rest_t))) : 1.0f,
                  .rest_correction2 =
                      dense && apply ? (float)(1.0 / sqrt(1.0 - pow(0.999, rest_t))) : 1.0f,
                  .accumulated_grad = trainer->accumulated_grad,
                  .accumulated_rows = trainer->accumulated_rows,
                  .step_main = step_main,
                  .step_rest = step_rest,
                  .gradient_sum = step->statistics ? step->statistics->gradient_sum : NULL,
                  .abs_grad_sum = step->statistics && trainer->pipeline->abs_grad
                                      ? step->statistics->abs_grad_sum
                                      : NULL,
                  .abs_grad_norm = trainer->pipeline->abs_grad_norm,
                  .tan_half_x = 0.5f * (float)camera->width / step->view.rays->fx,
                  .tan_half_y = 0.5f * (float)camera->height / step->view.rays->fy}};
    if (apply || step->statistics)
        sgsi_parallel_ranges((trainer->model->count + SGS_LANES - 1) / SGS_LANES, 64,
                             optimize_range, &job);
    const size_t broken = atomic_load(&job.broken);
    if (broken)
        sgsi_skip_gradients(&progress->skipped, step->iteration, step->source->name, broken,
                            &job.input);
    progress->seconds.optimizer += sgsi_seconds() - start;
}

static double follow(double *average, double *weight, double value)
{
    if (isfinite(value)) {
        *average = 0.98 * *average + 0.02 * value;
        *weight = 0.98 * *weight + 0.02;
    }
    return *weight > 0.0 ? *average / *weight : 0.0;
}

static void fill_info(sgs_trainer *trainer, const step_state *step, sgs_step_info *info)
{
    sgsi_progress *progress = &trainer->progress;
    info->iteration = step->iteration;
    info->view = (size_t)(step->source - trainer->scene->views);
    info->loss = step->loss.loss;
    info->loss_average = follow(&progress->loss_average, &progress->loss_weight, step->loss.loss);
    info->psnr_average = follow(&progress->psnr_average, &progress->psnr_weight,
                                -10.0 * log10(fmax(step->loss.mse, 1e-12)));
    info->gaussians = trainer->model->count;
}

static size_t count_visible(const sgs_trainer *trainer)
{
    const uint8_t *touched = sgsi_tracer_touched(trainer->tracer);
    size_t blocks = 0;
    for (size_t i = 0; i < (trainer->model->count + SGS_LANES - 1) / SGS_LANES; ++i)
        blocks += touched[i];
    return blocks * SGS_LANES;
}

// Before a structural update changes the rows.
static void count_traffic(sgs_trainer *trainer, const step_state *step)
{
    const sgsi_rays *rays = step->view.rays;
    const sgsi_traffic traffic = {
        .tracer = trainer->tracer,
        .primitives = trainer->model->count,
        .pixels = (size_t)step->planes.width * (size_t)step->planes.height,
        .tiles = (size_t)rays->tiles_x * (size_t)rays->tiles_y,
        .macrotiles = (size_t)rays->macrotiles_x * (size_t)rays->macrotiles_y,
        .sh_degree = step->view.sh_degree,
        .channels = step->source->image.channels,
        .collects = step->statistics != NULL,
        .steps = !step->structural && !step->last,
        .dense = trainer->options.optimizer == SGS_OPTIMIZER_DENSE};
    sgsi_traffic_add(&traffic, &trainer->bytes);
}

// Time of the step that began at `start`.
static void account_step(sgs_trainer *trainer, double start, sgsi_loop_seconds loops)
{
    sgs_train_seconds *seconds = &trainer->progress.seconds;
    const sgsi_loop_seconds now = sgsi_threads_seconds();
    const double total = sgsi_seconds() - start;
    seconds->total += total;
    seconds->serial += total - (now.inside - loops.inside);
    seconds->waiting += now.waiting - loops.waiting;
}

// A training that looks past its model would end well and show nothing.
static void watch_views(sgs_trainer *trainer, int iteration)
{
    trainer->seen = trainer->seen || sgsi_tracer_counts(trainer->tracer).block_hits;
    if (!trainer->seen && (size_t)iteration == trainer->train_view_count)
        sgsi_warn("%s: none of the %zu training views has seen a primitive; do the points (or "
                  "--init) belong to these cameras?",
                  trainer->scene->path, trainer->train_view_count);
}

// The last iteration of a shorter run has changed nothing but counters. Afterwards the state is
// that of a run that always had the present length.
static sgs_status repeat_last(sgs_trainer *trainer)
{
    sgsi_progress *progress = &trainer->progress;
    sgs_step_info info;
    progress->stop = SGS_STOP_NONE;
    --progress->iteration;
    --progress->order_position;
    return sgs_trainer_step(trainer, &info);
}

sgs_status sgs_trainer_step(sgs_trainer *trainer, sgs_step_info *info)
{
    const double start = sgsi_seconds();
    const sgsi_loop_seconds loops = sgsi_threads_seconds();
    sgsi_progress *progress = &trainer->progress;
    *info = (sgs_step_info){.mean_weight = 1.0};
    if (progress->stop == SGS_STOP_SCHEDULE && progress->iteration < trainer->options.iterations) {
        const sgs_status repeated = repeat_last(trainer);
        if (repeated)
            return repeated;
    }
    if (progress->stop != SGS_STOP_NONE)
        return sgsi_fail(SGS_STATUS_LIMIT, "training is over after %d iterations",
                         progress->iteration);
    if (trainer->inconsistent)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "the step after iteration %d failed half-way; there is nothing to go on "
                         "from",
                         progress->iteration);
    const int iteration = progress->iteration + 1;
    step_state step = {.iteration = iteration,
                       .structural = sgsi_schedule_is_structural(&trainer->schedule, iteration),
                       .prunes = sgsi_schedule_is_final_prune(&trainer->schedule, iteration),
                       .last = iteration == trainer->options.iterations};
    if (iteration < trainer->schedule.densify_until && !step.last)
        step.statistics = &trainer->statistics;
    sgs_status status = sgsi_trainer_apply_deferred(trainer, info);
    if (status)
        return status;
    const sgsi_progress before = *progress;
    step.view_index = next_view(trainer);
    expect_next_views(trainer);
    status = sgsi_trainer_fetch(trainer, &step);
    if (status) {
        *progress = before; // the same view comes next
        return status;
    }
    trainer->inconsistent = true;
    status = sgsi_trainer_draw(trainer, &step);
    if (!status)
        watch_views(trainer, iteration);
    if (!status && trainer->exposure && !step.last)
        sgsi_exposure_step(trainer->exposure, step.view_index,
                           sgsi_exposure_lr(iteration, trainer->options.iterations));
    if (!status)
        status = sgsi_tracer_backward(trainer->tracer, &step.view, &step.planes, step.d_color,
                                      step.d_transmittance);
    if (status)
        return status;
    const sgsi_trace_seconds spent = sgsi_tracer_seconds(trainer->tracer);
    progress->seconds.backward += spent.backward + spent.reduce;
    info->visible = count_visible(trainer);
    count_traffic(trainer, &step);
    if (isfinite(step.loss.loss))
        optimize_step(trainer, &step);
    else
        sgsi_skip_step(&progress->skipped, iteration, step.source->name, step.loss.loss);
    // Mip-Splatting: positions still move after the last structural update.
    if (trainer->filter_3d && iteration > trainer->schedule.densify_until &&
        iteration % FILTER_INTERVAL == 0 &&
        iteration < trainer->options.iterations - FILTER_INTERVAL)
        status = sgsi_trainer_update_filter_3d(trainer);
    if (status)
        return status;
    progress->iteration = iteration;
    sgsi_trainer_convert_opacity(trainer);
    fill_info(trainer, &step, info);
    info->stop = sgsi_trainer_decide_stop(trainer, step.loss.loss);
    progress->stop = info->stop;
    trainer->inconsistent = false;
    account_step(trainer, start, loops);
    return SGS_STATUS_OK;
}

bool sgs_trainer_is_consistent(const sgs_trainer *trainer)
{
    return !trainer->inconsistent;
}

int sgs_trainer_structure_iteration(const sgs_trainer *trainer)
{
    return trainer->progress.structure_iteration;
}

const sgs_gaussians *sgs_trainer_model(const sgs_trainer *trainer)
{
    return trainer->model;
}

const double *sgs_trainer_exposure(const sgs_trainer *trainer, size_t view)
{
    for (size_t i = 0; trainer->exposure && i < trainer->train_view_count; ++i)
        if (trainer->train_views[i] == view)
            return sgsi_exposure_map(trainer->exposure, i);
    return NULL;
}

const float *sgs_trainer_filter_3d(const sgs_trainer *trainer)
{
    return trainer->filter_3d;
}

sgs_regions sgs_trainer_regions(const sgs_trainer *trainer)
{
    return trainer->regions;
}

int sgs_trainer_iteration(const sgs_trainer *trainer)
{
    return trainer->progress.iteration;
}

sgs_train_bytes sgs_trainer_bytes(const sgs_trainer *trainer)
{
    return trainer->bytes;
}

sgs_train_seconds sgs_trainer_seconds(const sgs_trainer *trainer)
{
    return trainer->progress.seconds;
}

sgs_train_skipped sgs_trainer_skipped(const sgs_trainer *trainer)
{
    const sgsi_skipped *skipped = &trainer->progress.skipped;
    return (sgs_train_skipped){.steps = skipped->steps, .gradients = skipped->gradients};
}

const char *sgs_trainer_stop_text(const sgs_trainer *trainer)
{
    return trainer->stop_text;
}

size_t sgs_trainer_initial_cloud(const sgs_trainer *trainer, const float **points,
                                 const unsigned char **colors)
{
    *points = trainer->cloud_points;
    *colors = trainer->cloud_colors;
    return trainer->cloud_count;
}
