// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "draw/view_drawer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cameras/lens_samples.h"
#include "cameras/lens_scale.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"
#include "sparegs/aov_descriptors.h"
#include "sparegs/metrics.h"
#include "sparegs/runtime.h"

// Number and size in pixels of the small renderings that measure the ranges of PNG files.
enum { PREVIEWS = 32, PREVIEW_SIZE = 128, FULL_PREVIEWS = 3 };

// The model's parameters in double precision, row by row.
static double *exact_params(const sgs_gaussians *model)
{
    double *params = malloc((model->count + 1) * SGS_PARAM_COUNT * sizeof *params);
    for (size_t i = 0; params && i < model->count; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            params[i * SGS_PARAM_COUNT + (size_t)k] = (double)*sgs_gaussians_at(model, i, k);
    return params;
}

bool view_drawer_open(view_drawer *drawer, const view_options *options,
                      const drawing_values *drawing, const sgs_gaussians *model)
{
    *drawer = (view_drawer){.options = options, .drawing = drawing, .model = model};
    drawer->frame = &drawer->frames[0];
    if (options->film && group_leads() && !video_possible())
        return false;
    if (options->reference) {
        drawer->params = exact_params(model);
        if (!drawer->params)
            fail_run("not enough memory for %zu primitives in double precision", model->count);
        return drawer->params != NULL;
    }
    if (!sgs_renderer_create(model, &drawer->renderer))
        return true;
    fail_library();
    return false;
}

bool view_drawer_finish(view_drawer *drawer)
{
    return async_task_wait(&drawer->writing);
}

bool view_drawer_close(view_drawer *drawer, bool complete)
{
    const bool films = drawer->film != NULL;
    const bool done = video_close(drawer->film, complete);
    drawer->filmed = films && complete && done;
    for (int k = 0; k < 2; ++k)
        sgs_frame_free(&drawer->frames[k]);
    sgs_frame_free(&drawer->sampled);
    sgs_renderer_destroy(drawer->renderer);
    free(drawer->params);
    free(drawer->round);
    return done;
}

// `to` may be NULL.
static void copy_plane(sgs_aov_type type, const double *from, void *to, size_t pixels)
{
    float *floats = to;
    uint32_t *ids = to;
    for (size_t i = 0; i < pixels && to; ++i)
        if (type == SGS_AOV_TYPE_UINT)
            ids[i] = from[i] < 0 ? SGS_NO_PRIMITIVE : (uint32_t)from[i];
        else
            floats[i] = (float)from[i];
}

static bool not_interrupted(void *user, size_t done, size_t total)
{
    (void)user, (void)done, (void)total;
    return !interrupt_signal();
}

// Ranks draw their views to the end: they meet in every round.
static sgs_render_options render_options(const view_drawer *drawer)
{
    sgs_render_options options = drawing_render_options(drawer->drawing);
    options.axis_depth = drawer->options->axis_depth;
    options.progress = group_ranks() ? NULL : not_interrupted;
    return options;
}

// Records a cancelled rendering. True if the status is not an error that is to be printed.
static bool was_cancelled(view_drawer *drawer, sgs_status status)
{
    drawer->cancelled = drawer->cancelled || status == SGS_STATUS_CANCELLED;
    return status == SGS_STATUS_CANCELLED;
}

static sgs_status draw_reference(const view_drawer *drawer, const sgs_camera *camera,
                                 const sgs_pose *pose, const sgs_render_options *options,
                                 sgs_frame *frame)
{
    sgs_reference_frame exact = {0};
    sgs_status status = sgs_reference_frame_create(camera->width, camera->height, &exact);
    if (!status)
        status = sgs_reference_render(drawer->params, drawer->model->count, camera, pose, options,
                                      &exact);
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    size_t count;
    const sgs_aov *aovs = sgs_aov_descriptors(&count);
    for (size_t k = 0; k < count && !status; ++k)
        for (int c = 0; c < aovs[k].channels; ++c)
            copy_plane(aovs[k].type, sgs_aov_reference_plane(&aovs[k], &exact, c),
                       sgs_aov_plane(&aovs[k], frame, c), pixels);
    sgs_reference_frame_free(&exact);
    return status;
}

// Creates or resizes a frame for a view.
static bool prepare_frame(sgs_frame *frame, const sgs_camera *camera, unsigned planes)
{
    if (frame->width == camera->width && frame->height == camera->height)
        return true;
    sgs_frame_free(frame);
    if (!sgs_frame_create_with(camera->width, camera->height, planes, frame))
        return true;
    fail_library();
    return false;
}

static bool draw_flat(view_drawer *drawer, const sgs_camera *camera, const sgs_pose *pose,
                      const sgs_render_options *options, sgs_frame *frame)
{
    const sgs_status status =
        drawer->renderer ? sgs_renderer_render(drawer->renderer, camera, pose, options, frame)
                         : draw_reference(drawer, camera, pose, options, frame);
    if (status && !was_cancelled(drawer, status))
        fail_library();
    return !status;
}

// Renders the frame and writes the deep file.
static bool draw_deep(view_drawer *drawer, const frame_files *files,
                      const sgs_render_options *options)
{
    const sgs_deep_options *deep = &drawer->options->deep_options;
    deep_file *file = deep_file_open(files, drawer->frame, deep->max_samples);
    if (!file)
        return false;
    const sgs_status status =
        sgs_renderer_render_deep(drawer->renderer, files->camera, files->pose, options, deep,
                                 drawer->frame, deep_file_rows, file);
    if (status && !deep_file_failed(file) && !was_cancelled(drawer, status))
        fail_library();
    return deep_file_close(file, !status);
}

// ---- Multisampling ----

// Distance along the axis of the surface at the image centre. 0 after printing the error if there
// is none.
static double middle_distance(const view_drawer *drawer, const char *name, const sgs_camera *camera)
{
    const int x = camera->width / 2, y = camera->height / 2;
    const double pixel[2] = {x + 0.5, y + 0.5};
    double direction[3] = {0, 0, 1};
    const float depth = drawer->frame->depth_mean[(size_t)y * (size_t)camera->width + (size_t)x];
    if (!drawer->options->axis_depth && !sgs_camera_unproject(camera, pixel, direction))
        direction[2] = 0;
    const double distance = (double)depth * direction[2];
    if (!(distance > 0))
        fail_run("%s: no surface at the image centre; set the focus distance with --focus", name);
    return distance > 0 ? distance : 0;
}

// Replaces the frame's colours by the mean of the samples. Other AOVs keep the values at pixel
// centres.
static bool draw_samples(view_drawer *drawer, const char *name, const sgs_camera *camera,
                         const sgs_pose *pose, const sgs_render_options *options)
{
    const view_options *o = drawer->options;
    if (o->aperture > 0 && sgs_camera_is_fisheye(camera->model)) {
        fail_run("%s: --aperture requires a perspective lens, not %s", name,
                 sgs_camera_model_name(camera->model));
        return false;
    }
    const double focus =
        o->focus > 0 || !(o->aperture > 0) ? o->focus : middle_distance(drawer, name, camera);
    if (o->aperture > 0 && !(focus > 0))
        return false;
    light_sum sum;
    bool done = prepare_frame(&drawer->sampled, camera, 0);
    if (done && !light_sum_begin(&sum, camera->width, camera->height,
                                 drawer->drawing->space == SGS_SPACE_LINEAR)) {
        fail_run("%s: not enough memory for its samples", name);
        done = false;
    }
    if (!done)
        return false;
    for (int k = 0; k < o->samples && done; ++k) {
        sgs_camera lens = *camera;
        sgs_pose place = *pose;
        lens_sample(k, o->aperture, focus, &lens, &place);
        done = draw_flat(drawer, &lens, &place, options, &drawer->sampled);
        if (done)
            light_sum_add(&sum, &drawer->sampled);
    }
    if (done)
        light_sum_mean(&sum, drawer->frame);
    light_sum_free(&sum);
    return done;
}

static bool takes_samples(const view_options *options)
{
    return options->samples > 1 || options->aperture > 0;
}

// The planes of a frame.
static unsigned drawn_planes(const view_options *options)
{
    return aov_planes(options->aovs) | (options->aperture > 0 ? SGS_AOV_DEPTH_MEAN : 0);
}

static bool draw_frame(view_drawer *drawer, const frame_files *files,
                       const sgs_render_options *options)
{
    const view_options *o = drawer->options;
    if (!prepare_frame(drawer->frame, files->camera, drawn_planes(o)))
        return false;
    if (o->deep)
        return draw_deep(drawer, files, options);
    return draw_flat(drawer, files->camera, files->pose, options, drawer->frame) &&
           (!takes_samples(o) ||
            draw_samples(drawer, files->name, files->camera, files->pose, options));
}

// ---- Ranges of PNG files ----

// A preview of a view with the planes of `aovs`, at most PREVIEW_SIZE pixels wide and high. Without
// the pixel filter, whose footprint would grow with the size of the pixels. Or the whole frame.
static bool preview(view_drawer *drawer, const named_camera *view, unsigned aovs, bool whole,
                    sgs_frame *frame)
{
    const sgs_camera *camera = &view->camera;
    const int longer = camera->width > camera->height ? camera->width : camera->height;
    const double scale = longer > PREVIEW_SIZE ? (double)PREVIEW_SIZE / longer : 1;
    const int width = (int)fmax(1, scale * camera->width),
              height = (int)fmax(1, scale * camera->height);
    const sgs_camera small = sgs_camera_resized(camera, width, height);
    sgs_render_options options = render_options(drawer);
    if (!whole)
        options.filter = SGS_FILTER_NONE;
    return prepare_frame(frame, whole ? camera : &small, range_planes(aovs)) &&
           draw_flat(drawer, whole ? camera : &small, &view->pose, &options, frame);
}

// Adds the values of up to `most` previews to the samples.
static bool measure(view_drawer *drawer, const camera_list *views, unsigned aovs, size_t most,
                    bool whole, range_samples *samples)
{
    const size_t count = views->count < most ? views->count : most;
    sgs_frame frame = {0};
    bool done = true;
    for (size_t i = 0; i < count && aovs && done; ++i) {
        done = preview(drawer, &views->cameras[i * views->count / count], aovs, whole, &frame);
        if (done && !range_samples_add(samples, aovs, &frame)) {
            fail_run("not enough memory to measure the ranges of the images");
            done = false;
        }
    }
    sgs_frame_free(&frame);
    return done;
}

static void report_ranges(const view_drawer *drawer, unsigned aovs)
{
    for (int k = 0; k < AOV_ROWS; ++k)
        if (aovs >> k & 1 && aov_rows[k].picture == AOV_PICTURE_RAMP)
            print_note("%s: colours from dark to light represent %g to %g in all frames",
                       aov_words[k], (double)drawer->ranges.of[k][0].low,
                       (double)drawer->ranges.of[k][0].high);
    reported_files_set("ranges", picture_ranges_json(&drawer->ranges, aovs));
}

// Checks that a video can be made of the views, and reserves the frames of a round of the ranks.
static bool prepare_film(view_drawer *drawer, const camera_list *views)
{
    const sgs_camera *first = &views->cameras[0].camera;
    for (size_t i = 1; i < views->count; ++i) {
        const sgs_camera *camera = &views->cameras[i].camera;
        if (camera->width == first->width && camera->height == first->height)
            continue;
        fail_run("%s: all frames of a video must have the same size, this one is %d x %d; use "
                 "--size",
                 views->cameras[i].name, camera->width, camera->height);
        return false;
    }
    drawer->film_aspect = camera_pixel_aspect(first);
    drawer->frame_bytes = 3 * (size_t)first->width * (size_t)first->height;
    const size_t ranks = (size_t)group_count();
    if (!group_ranks() || !group_leads())
        return true;
    drawer->round = malloc(drawer->frame_bytes * (ranks < views->count ? ranks : views->count));
    if (!drawer->round)
        fail_run("not enough memory for a frame of %d x %d from each rank", first->width,
                 first->height);
    return drawer->round != NULL;
}

// Memory for drawing a view while the previous one is written.
static double drawing_bytes(const view_drawer *drawer, const sgs_camera *camera, int frames)
{
    const view_options *o = drawer->options;
    const unsigned planes = drawn_planes(o);
    const double pixels = (double)camera->width * camera->height;
    double per_pixel =
        frame_writing_bytes(o->aovs, drawer->drawing->space, o->folder && !o->png, o->png);
    if (o->film) // the picture, and its copy for ffmpeg
        per_pixel += 3 + frame_writing_bytes(0, drawer->drawing->space, false, true);
    if (takes_samples(o)) // a sample, and the sum of their colours and transmittances
        per_pixel += 8 * sizeof(float);
    size_t count;
    const sgs_aov *aovs = sgs_aov_descriptors(&count);
    for (size_t k = 0; k < count && o->reference; ++k) // all planes in double precision
        per_pixel += (double)sizeof(double) * aovs[k].channels;
    return (double)sgs_frame_memory(camera->width, camera->height, planes, frames) +
           pixels * per_pixel;
}

// Allocations beyond the memory would succeed, and the system would end the process without a word.
static bool check_memory(const view_drawer *drawer, const camera_list *views)
{
    const double machine = (double)sgs_machine_memory();
    const int frames = views->count > (size_t)group_count() ? 2 : 1;
    for (size_t i = 0; i < views->count; ++i) {
        const sgs_camera camera =
            camera_with_border(&views->cameras[i].camera, drawer->options->overscan);
        const double bytes = drawing_bytes(drawer, &camera, frames);
        if (bytes <= machine)
            continue;
        fail_run("%s: a frame of %dx%d pixels requires more than %.1f GiB, but the machine has "
                 "%.1f GiB; use a smaller size%s",
                 views->cameras[i].name, camera.width, camera.height, bytes / 0x1p30,
                 machine / 0x1p30,
                 drawer->options->aovs & ~(unsigned)AOV_RGBA ? " or fewer AOVs" : "");
        return false;
    }
    return true;
}

bool view_drawer_prepare(view_drawer *drawer, const camera_list *views)
{
    const view_options *o = drawer->options;
    if (!check_memory(drawer, views))
        return false;
    const bool is_given = o->depth_range.high > 0;
    const unsigned aovs = o->folder && o->png ? ranged_aovs(o->aovs) : 0,
                   measured = is_given ? aovs & ~(unsigned)AOV_DEPTHS : aovs;
    // Candidates are counted per tile of 16x16 pixels, whatever the size of the image.
    const unsigned scaled = measured & ~(unsigned)AOV_CANDIDATES;
    range_samples samples = {0};
    bool done = (!o->film || prepare_film(drawer, views)) &&
                measure(drawer, views, scaled, PREVIEWS, false, &samples);
    // Rays of a preview may pass between primitives that are smaller than its pixels.
    const unsigned missing =
        range_samples_missing(&samples, scaled) | (measured & (unsigned)AOV_CANDIDATES);
    done = done && measure(drawer, views, missing, FULL_PREVIEWS, true, &samples);
    range_samples_finish(&samples, measured, &drawer->ranges);
    for (int k = 0; k < AOV_ROWS; ++k)
        if (is_given && 1 << k & AOV_DEPTHS)
            drawer->ranges.of[k][0] = o->depth_range;
    range_samples_free(&samples);
    if (done && aovs)
        report_ranges(drawer, aovs);
    return done || drawer->cancelled;
}

// ---- Views of an earlier command ----

bool view_drawer_skip_existing(view_drawer *drawer, camera_list *views)
{
    const view_options *o = drawer->options;
    json_t *missing = json_array();
    for (size_t i = 0; i < views->count; ++i)
        json_array_append_new(missing,
                              json_boolean(!frame_files_exist(o->folder, views->cameras[i].stem,
                                                              o->aovs, o->png, o->deep)));
    // One answer for all: the others may begin to write before a slow rank has looked.
    missing = group_json(missing);
    const bool done = group_all(json_array_size(missing) == views->count);
    size_t kept = 0;
    for (size_t i = 0; i < views->count && done; ++i)
        if (json_is_true(json_array_get(missing, i)))
            views->cameras[kept++] = views->cameras[i];
        else
            named_camera_free(&views->cameras[i]);
    if (done) {
        drawer->skipped = views->count - kept;
        views->count = kept;
        reported_files_set("skipped", json_integer((json_int_t)drawer->skipped));
    }
    json_decref(missing);
    return done;
}

// ---- Output ----

static bool open_film(view_drawer *drawer)
{
    const sgs_frame *frame = drawer->finished;
    if (!drawer->film)
        drawer->film = video_open(drawer->options->film, frame->width, frame->height,
                                  drawer->film_aspect, drawer->options->fps);
    return drawer->film != NULL;
}

static bool add_to_film(view_drawer *drawer)
{
    sgs_image8 image = {0};
    if (!open_film(drawer) || !frame_picture(&drawer->files, drawer->finished, &image))
        return false;
    const bool done = video_add(drawer->film, &image);
    sgs_image8_free(&image);
    return done;
}

// The frames of all ranks, on rank 0.
static bool add_round_to_film(view_drawer *drawer)
{
    if (!group_leads())
        return true;
    bool done = open_film(drawer);
    for (size_t k = 0; k < drawer->round_views && done; ++k) {
        const sgs_image8 image = {.width = drawer->finished->width,
                                  .height = drawer->finished->height,
                                  .channels = 3,
                                  .pixels = drawer->round + k * drawer->frame_bytes};
        done = video_add(drawer->film, &image);
    }
    return done;
}

static bool write_finished(void *context)
{
    view_drawer *drawer = context;
    const view_options *o = drawer->options;
    const double start = clock_seconds();
    bool done = !o->film || (drawer->round_views ? add_round_to_film(drawer) : add_to_film(drawer));
    if (done && o->folder && drawer->finished)
        done = o->png ? frame_write_png(&drawer->files, drawer->finished)
                      : frame_write_exr(&drawer->files, drawer->finished);
    drawer->write_seconds += clock_seconds() - start;
    return done;
}

// Deep files are written during rendering. Synchronous writing keeps the order of printed paths.
static void start_writing(view_drawer *drawer)
{
    async_task_start(&drawer->writing, sgs_threads_get() > 1 && !drawer->options->deep,
                     write_finished, drawer);
}

// Draws a view and waits until the previous one is written.
static bool draw_view(view_drawer *drawer, const named_camera *view)
{
    const view_options *o = drawer->options;
    const sgs_render_options options = render_options(drawer);
    sgs_camera *camera = &drawer->cameras[drawer->frame != drawer->frames];
    *camera = camera_with_border(&view->camera, o->overscan);
    frame_files files = {.folder = o->folder,
                         .stem = view->stem,
                         .name = view->name,
                         .camera = camera,
                         .overscan = o->overscan,
                         .pose = &view->pose,
                         .aovs = o->aovs,
                         .regions = o->regions,
                         .ranges = &drawer->ranges,
                         .axis_depth = o->axis_depth,
                         .encoding = o->encoding,
                         .compression = o->compression,
                         .half = o->half,
                         .frame_rate = o->frame_rate,
                         .space = drawer->drawing->space,
                         .white_point = (float)drawer->drawing->white_point,
                         .near_distance = options.near_distance};
    memcpy(files.background, drawer->drawing->background, sizeof files.background);
    const double start = clock_seconds();
    const bool drawn = draw_frame(drawer, &files, &options);
    drawer->draw_seconds += clock_seconds() - start;
    if (!async_task_wait(&drawer->writing) || !drawn)
        return false;
    drawer->files = files;
    drawer->finished = drawer->frame;
    drawer->frame = &drawer->frames[drawer->frame == drawer->frames];
    ++drawer->drawn;
    return true;
}

bool view_drawer_draw(view_drawer *drawer, const named_camera *view)
{
    const bool done = draw_view(drawer, view);
    if (done)
        start_writing(drawer);
    return done || drawer->cancelled;
}

bool view_drawer_draw_round(view_drawer *drawer, const named_camera *view, size_t views)
{
    sgs_image8 image = {0};
    bool done = view ? draw_view(drawer, view) : async_task_wait(&drawer->writing);
    if (!view)
        drawer->finished = NULL; // was written in the previous round
    else
        done = done && frame_picture(&drawer->files, drawer->finished, &image);
    done = group_all(done);
    if (done && sgs_ranks_collect(group_ranks(), SGS_STATUS_OK, image.pixels, drawer->frame_bytes,
                                  (int)views, drawer->round)) {
        fail_library();
        done = false;
    }
    sgs_image8_free(&image);
    if (!done) // the writer may still use the previous round
        return false;
    drawer->round_views = views;
    start_writing(drawer);
    return true;
}
