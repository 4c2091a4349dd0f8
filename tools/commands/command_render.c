// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs render`: renders views of a stored model as EXR or PNG, by the tracer or, with
// --reference, by the brute-force reference renderer that the tracer must match.

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "cameras/camera_export.h"
#include "cameras/chan_file.h"
#include "cameras/render_cameras.h"
#include "cameras/usd_camera_file.h"
#include "cli/commands.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "commands/render_options.h"
#include "draw/aov_list.h"
#include "draw/photo_guard.h"
#include "draw/view_drawer.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"
#include "run/rank_work.h"
#include "sparegs/rank_check.h"

static const char description[] =
    "Renders MODEL (a model file, or a run folder, whose latest iteration is used) from the "
    "cameras of SCENE, from a camera file, or along a path around the scene. Writes DIR/STEM.exr "
    "with all AOVs as layers, or DIR/STEM.png and DIR/STEM.AOV.png, where STEM is the image name "
    "of the view without extension, and prints the paths. EXR colours are premultiplied by alpha, "
    "without background, and scene-linear: the model's display (sRGB) values are decoded unless "
    "--exr-encoding srgb is given. PNGs and videos are composited over the background. Under "
    "mpirun or srun, the views are distributed over the processes, and rank 0 encodes the video.";

enum { FORMAT_EXR = 0, DEPTH_Z = 1, LENS_PINHOLE = 0, BLUR_SAMPLES = 64, DEFAULT_FPS = 30 };
static const sgs_split splits[] = {SGS_SPLIT_TEST, SGS_SPLIT_TRAIN, SGS_SPLIT_ALL};

// "NEAR:FAR" with 0 <= NEAR < FAR.
static bool depth_range_parse(const char *text, value_range *range)
{
    char *end;
    const double low = strtod(text, &end);
    if (end == text || *end != ':')
        return false;
    const char *far_text = end + 1;
    const double high = strtod(far_text, &end);
    *range = (value_range){(float)low, (float)high};
    return end != far_text && !*end && low >= 0 && range->high > range->low &&
           isfinite(range->high);
}

// The view options that correspond to the command line.
static view_options view_options_from(const render_values *values, double path_fps)
{
    value_range depth_range = {0, 0};
    if (values->depth_range)
        depth_range_parse(values->depth_range, &depth_range);
    const bool blurred = values->aperture > 0;
    const double rate = values->fps > 0 ? values->fps : fmax(path_fps, 0);
    return (view_options){.folder = values->output,
                          .aovs = values->aovs,
                          .axis_depth = values->depth == DEPTH_Z,
                          .png = values->format != FORMAT_EXR,
                          .depth_range = depth_range,
                          .reference = values->reference,
                          .encoding = (exr_encoding)values->encoding,
                          .compression = (sgs_exr_compression)values->compression,
                          .half = values->half,
                          .deep = values->deep,
                          .deep_options = {.struct_size = sizeof(sgs_deep_options),
                                           .tolerance = values->deep_tolerance,
                                           .max_samples = values->deep_max},
                          .samples = values->samples ? values->samples
                                     : blurred       ? BLUR_SAMPLES
                                                     : 1,
                          .aperture = values->aperture,
                          .focus = values->focus,
                          .overscan = values->overscan,
                          .film = values->film,
                          .fps = rate > 0 ? rate : DEFAULT_FPS,
                          .frame_rate = rate};
}

// Reads the regions of the model if requested. --aov all omits them if none were recorded.
static bool find_regions(const char *model_name, int iteration, const sgs_gaussians *model,
                         region_map *regions, unsigned *aovs)
{
    *regions = (region_map){0};
    if (!(*aovs & (AOV_REGION | AOV_SLACK)))
        return true;
    if (iteration && !region_map_read(model_name, iteration, model, regions))
        return false;
    if (regions->iteration)
        return true;
    if (*aovs != AOV_ALL) {
        fail_run("%s: no regions were recorded with this model; region and slack require a run "
                 "folder trained with --spare on",
                 model_name);
        return false;
    }
    *aovs &= ~(unsigned)(AOV_REGION | AOV_SLACK);
    print_note("%s: no regions were recorded with this model; region and slack are omitted",
               model_name);
    return true;
}

// What the ranks have rendered, as {"drawn": n, "draw": seconds, "write": seconds, "files":
// [paths]} of each: rank i % R has drawn view i, in order.
static void merge_drawn(const json_t *all, size_t views, bool filmed, json_t *before,
                        view_drawer *sum)
{
    const size_t count = json_array_size(all);
    json_t *files = json_copy(before), *film = NULL;
    json_t *first = json_object_get(json_array_get(all, 0), "files");
    if (filmed) { // the last file of rank 0
        film = json_incref(json_array_get(first, json_array_size(first) - 1));
        json_array_remove(first, json_array_size(first) - 1);
    }
    *sum = (view_drawer){0};
    for (size_t r = 0; r < count; ++r) {
        const json_t *own = json_array_get(all, r);
        sum->drawn += (size_t)json_integer_value(json_object_get(own, "drawn"));
        sum->draw_seconds =
            fmax(sum->draw_seconds, json_number_value(json_object_get(own, "draw")));
        sum->write_seconds =
            fmax(sum->write_seconds, json_number_value(json_object_get(own, "write")));
    }
    for (size_t i = 0; i < views; ++i) {
        const json_t *own = json_array_get(all, i % count), *list = json_object_get(own, "files");
        const size_t drawn = (size_t)json_integer_value(json_object_get(own, "drawn"));
        const size_t each = drawn ? json_array_size(list) / drawn : 0;
        for (size_t k = 0; k < each && i / count < drawn; ++k)
            json_array_append(files, json_array_get(list, i / count * each + k));
    }
    if (film)
        json_array_append_new(files, film);
    reported_files_restore(files);
}

// Reports `before` and the files of all ranks in the order of the views, and what was drawn.
static bool report_drawn(const view_drawer *drawer, size_t views, json_t *before)
{
    if (drawer->skipped)
        print_note("%zu view(s) skipped: their files exist", drawer->skipped);
    if (!group_ranks()) {
        print_note("%zu view(s): %.2f s rendering, %.2f s writing in parallel", drawer->drawn,
                   drawer->draw_seconds, drawer->write_seconds);
        return true;
    }
    json_t *own = json_pack("{s:I,s:f,s:f,s:o}", "drawn", (json_int_t)drawer->drawn, "draw",
                            drawer->draw_seconds, "write", drawer->write_seconds, "files",
                            reported_files_take());
    json_t *all = group_gather_json(own);
    view_drawer sum;
    if (!all)
        return !group_leads();
    merge_drawn(all, views, drawer->filmed, before, &sum);
    json_decref(all);
    print_note("%zu view(s) on %d ranks: up to %.2f s rendering, %.2f s writing in parallel",
               sum.drawn, group_count(), sum.draw_seconds, sum.write_seconds);
    return true;
}

// View i on rank i modulo their number. Each rank writes its files; the frames of a video go to
// rank 0 in every round.
static bool draw_views(view_drawer *drawer, const camera_list *cameras)
{
    const size_t ranks = (size_t)group_count(), rank = (size_t)sgs_ranks_rank(group_ranks());
    const bool films = drawer->options->film && group_ranks();
    bool done = true;
    progress_work_start();
    for (size_t first = 0; first < cameras->count; first += ranks) {
        if (!group_continues(first / ranks, films ? 1 : GROUP_ROUNDS, done))
            break;
        const size_t left = cameras->count - first, views = left < ranks ? left : ranks;
        const named_camera *view = rank < views ? &cameras->cameras[first + rank] : NULL;
        if (films)
            done = view_drawer_draw_round(drawer, view, views);
        else if (view && done && !interrupt_signal())
            done = view_drawer_draw(drawer, view);
        progress_work("render", first + views, cameras->count);
    }
    progress_end();
    return done;
}

// With `skip`, cameras whose files exist are removed from the list.
static bool render_views(const sgs_gaussians *model, camera_list *cameras, bool skip,
                         const view_options *options, const drawing_values *drawing, json_t *before)
{
    view_drawer drawer;
    bool done = group_all(view_drawer_open(&drawer, options, drawing, model) &&
                          view_drawer_prepare(&drawer, cameras));
    if (done && skip && !drawer.cancelled)
        done = view_drawer_skip_existing(&drawer, cameras);
    done = done && (drawer.cancelled || draw_views(&drawer, cameras));
    done = view_drawer_finish(&drawer) && done;
    done = group_all(done); // the last views of all ranks, before the video replaces another one
    const bool stopped = group_stop_requested();
    done = view_drawer_close(&drawer, done && !stopped) && done;
    done = group_all(done);
    group_stop_requested(); // all ranks then end alike
    done = done && report_drawn(&drawer, cameras->count, before);
    if (done && stopped && options->film)
        print_note("%s: stopped; no video was written", options->film);
    if (done && cameras->arc > 0)
        print_note("orbit: arc of %.0f degrees; use --arc 360 for a full circle", cameras->arc);
    return done;
}

typedef struct render_work {
    const camera_list *cameras;
    const drawing_values *drawing;
} render_work;

static bool describe_cameras(FILE *out, const void *context)
{
    const render_work *work = context;
    const camera_list *cameras = work->cameras;
    rank_work_write_drawing(out, work->drawing);
    fprintf(out, "number of views: %zu\n", cameras->count);
    for (size_t i = 0; i < cameras->count; ++i) {
        const named_camera *view = &cameras->cameras[i];
        fprintf(out, "camera of %s: %016" PRIx64 "\n", view->name,
                sgs_rank_camera_digest(&view->camera, &view->pose));
    }
    return true;
}

// The camera files to write.
static unsigned camera_formats(const render_values *values)
{
    const bool is_path = values->output && (values->orbit || values->spiral);
    return values->save_cameras ? values->save_cameras : is_path ? CAMERAS_JSON : 0;
}

// False after printing the error if the frames or the camera files would replace photos, the video,
// the cameras of a run, or those of --camera.
static bool spares_inputs(const render_values *values, const sgs_scene *scene,
                          const camera_list *cameras)
{
    const frame_outputs outputs = {values->output, values->aovs, values->format != FORMAT_EXR,
                                   values->deep, values->film};
    const bool spares = photo_guard_admits_frames(scene, &outputs, cameras);
    if (!spares || !values->output)
        return spares;
    const unsigned formats = camera_formats(values);
    char *json = format_text("%s/cameras.json", values->output),
         *chan = format_text("%s/cameras.chan", values->output),
         *usda = format_text("%s/cameras.usda", values->output),
         *config = format_text("%s/config.json", values->output);
    const bool is_run = formats & CAMERAS_JSON && file_exists(config);
    const char *input = NULL;
    if (values->camera && formats & CAMERAS_JSON && same_file(json, values->camera))
        input = json;
    if (values->camera && formats & CAMERAS_CHAN && same_file(chan, values->camera))
        input = chan;
    if (values->camera && formats & CAMERAS_USDA && same_file(usda, values->camera))
        input = usda;
    if (is_run)
        fail_run("%s: is the folder of a run, whose cameras.json would be replaced; choose another "
                 "folder with -o",
                 values->output);
    else if (input)
        fail_run("%s: is the input of --camera and would be replaced; choose another folder",
                 input);
    free(json);
    free(chan);
    free(usda);
    free(config);
    return !is_run && !input;
}

// Exports all cameras, then reduces them to those of `range` and renders these.
static bool render_model(const command_line *line, const model_path *located, camera_list *cameras,
                         const frame_range *range, drawing_values *drawing,
                         const render_values *values)
{
    sgs_gaussians *model = NULL;
    if (!model_read(located, drawing, &model))
        return false;
    const render_work work = {cameras, drawing};
    if (!rank_work_agrees(&(rank_work){line, model, describe_cameras, &work})) {
        sgs_gaussians_destroy(model);
        return false;
    }
    view_options options = view_options_from(values, cameras->fps);
    region_map regions = {0};
    options.regions = &regions;
    const unsigned formats = camera_formats(values);
    const bool exports = formats && group_leads();
    bool done = !exports || cameras_export(values->output, formats, cameras, options.fps);
    cameras_keep_frames(range, cameras);
    json_t *before = group_ranks() ? reported_files_take() : NULL;
    done = group_all(done) &&
           find_regions(located->run ? located->run : line->operands[0], located->iteration, model,
                        &regions, &options.aovs) &&
           render_views(model, cameras, values->skip_existing, &options, drawing, before);
    json_decref(before);
    region_map_free(&regions);
    sgs_gaussians_destroy(model);
    return done;
}

// Paths do not need photos, unless --images names their folder.
static sgs_scene *open_scene(const command_line *line, const camera_choice *choice,
                             const scene_values *data)
{
    const char *path = line->operands[1];
    const bool is_path = choice->orbit || choice->spiral;
    return is_path && !option_given(line, "images")
               ? scene_open_cameras(path, data, choice->width, choice->height)
               : scene_open(path, data, false);
}

// False after printing the error: a panorama has no directions beyond its edges.
static bool can_overscan(const camera_list *cameras)
{
    for (size_t i = 0; i < cameras->count; ++i)
        if (cameras->cameras[i].camera.model == SGS_CAMERA_EQUIRECTANGULAR) {
            fail_run("%s: --overscan has no effect on a panorama; omit it",
                     cameras->cameras[i].name);
            return false;
        }
    return true;
}

// False after printing the error: no name, camera file or range of frames would use the number.
static bool can_number(const command_line *line, const render_values *values,
                       const camera_list *cameras)
{
    if (option_given(line, "first-frame") && cameras->has_frames) {
        fail_run("%s: --first-frame has no effect: the time samples have frame numbers; omit it",
                 values->camera);
        return false;
    }
    if (!option_given(line, "first-frame") || cameras->is_numbered || values->frames ||
        camera_formats(values) & (CAMERAS_CHAN | CAMERAS_USDA))
        return true;
    fail_run("%s: --first-frame has no effect on cameras with names; omit it, or add "
             "--frames, or --save-cameras chan or usda",
             values->camera);
    return false;
}

// Other renderers write the depth of deep images along the camera axis, except where there is none.
static void note_deep_depth(const command_line *line, const render_values *values,
                            const camera_list *cameras)
{
    bool any = false;
    for (size_t i = 0; i < cameras->count && !any; ++i)
        any = camera_is_perspective(&cameras->cameras[i].camera);
    if (values->deep && any && !option_given(line, "depth"))
        print_note("--deep: Z is the distance along the ray; compositing programs usually merge "
                   "deep images by the depth along the camera axis, which --depth z writes");
}

static int run_render(const command_line *line, const render_values *values,
                      const camera_choice *choice, scene_values *data, drawing_values *drawing)
{
    model_path located;
    sgs_scene *scene = NULL;
    camera_list cameras = {0};
    int status = model_locate_of_run(line->operands[0], values->run, &located) ? -1 : EXIT_FAILED;
    if (status < 0)
        status = model_scene_resolve(data, line, &located);
    if (status < 0 && !values->camera) {
        scene = open_scene(line, choice, data);
        status = scene ? -1 : EXIT_FAILED;
    }
    if (status < 0 &&
        !(cameras_choose(choice, scene, &cameras) && can_number(line, values, &cameras) &&
          (!values->overscan || can_overscan(&cameras))))
        status = EXIT_FAILED;
    if (status < 0 && !spares_inputs(values, scene, &cameras))
        status = EXIT_FAILED;
    if (status < 0 && values->output && // without cameras the folder is removed
        !(make_folder(values->output) && check_writable(values->output)))
        status = EXIT_FAILED;
    if (status < 0) {
        drawing_resolve(drawing, line, located.config, data, scene);
        if (values->reference)
            drawing->compact_box = 1; // the reference has no tiles
        note_deep_depth(line, values, &cameras);
        const bool done = render_model(line, &located, &cameras, &choice->frames, drawing, values);
        status = done ? interrupt_status() : EXIT_FAILED;
    }
    camera_list_free(&cameras);
    sgs_scene_destroy(scene);
    model_path_free(&located);
    return status;
}

static bool has_extension(const char *path)
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path,
               *dot = strrchr(name, '.');
    return dot && dot > name && dot[1];
}

// Checks combinations of options and parses those with their own syntax. Returns -1 to continue, or
// an exit status.
static int check_values(const command_line *line, const render_values *values,
                        camera_choice *choice)
{
    *choice = (camera_choice){.view = values->view,
                              .file = values->camera,
                              .split = splits[values->split],
                              .split_given = option_given(line, "split"),
                              .orbit = values->orbit,
                              .spiral = values->spiral,
                              .arc = values->arc,
                              .first_frame = values->first_frame,
                              .keep_lens = values->path_lens != LENS_PINHOLE,
                              .pinhole = option_given(line, "path-lens") &&
                                         values->path_lens == LENS_PINHOLE,
                              .projection = values->projection};
    const int paths =
        (values->orbit > 0) + (values->spiral > 0) + (values->view != NULL) + choice->split_given;
    const bool sampled = values->samples > 1 || values->aperture > 0;
    if (line->operand_count == 2 && values->camera)
        return fail_usage("SCENE and --camera are mutually exclusive; omit one");
    if (line->operand_count < 2 && !values->camera)
        return fail_usage("render requires a SCENE or --camera FILE; usage: sparegs render %s",
                          line->synopsis);
    if (!values->output && !values->film)
        return fail_usage(
            "render requires an output folder, -o DIR (or --video FILE); usage: sparegs render %s",
            line->synopsis);
    if (values->film && !has_extension(values->film))
        return fail_usage("--video: '%s' has no extension, which selects the format; write for "
                          "example video.mp4",
                          values->film);
    if ((values->orbit > 0 || values->spiral > 0) && (paths > 1 || values->camera))
        return fail_usage("--orbit, --spiral, --view, --split and --camera are mutually exclusive; "
                          "choose one");
    if (choice->split_given && (values->view || values->camera))
        return refuse_idle(line, "split", values->view ? "with --view" : "with --camera");
    if (values->camera && chan_file_is(values->camera) && option_given(line, "first-frame"))
        return refuse_idle(line, "first-frame", "on a .chan file, which numbers its frames");
    if (values->view && !values->film && !option_given(line, "save-cameras") && values->fps > 0 &&
        !(values->camera && usd_camera_file_is(values->camera)))
        return refuse_idle(line, "fps", "on --view, a still image");
    if (values->frames && !frame_range_parse(values->frames, &choice->frames))
        return fail_usage("--frames: '%s' is not FIRST-LAST or FIRST-LAST:STEP with frame numbers",
                          values->frames);
    if (values->size && !size_parse(values->size, &choice->width, &choice->height))
        return fail_usage("--size: '%s' is not WIDTHxHEIGHT, each from 1 to 65536", values->size);
    value_range range;
    if (values->depth_range && !depth_range_parse(values->depth_range, &range))
        return fail_usage("--depth-range: '%s' is not NEAR:FAR with 0 <= NEAR < FAR",
                          values->depth_range);
    if (values->deep && (values->reference || sampled || !values->output))
        return fail_usage(
            "--deep and %s are mutually exclusive; deep files hold the hits of one ray per pixel",
            values->reference           ? "--reference"
            : values->aperture > 0      ? "--aperture"
            : values->output && sampled ? "--spp"
                                        : "--video without -o");
    if (values->format != FORMAT_EXR && values->compression != SGS_EXR_AUTO &&
        values->compression != SGS_EXR_ZIPS && values->compression != SGS_EXR_NONE)
        return fail_usage("--compression zip, piz and dwaa require --format exr; deep files have "
                          "zips, or none with --compression none");
    if (values->skip_existing && values->film)
        return fail_usage("--skip-existing and --video are mutually exclusive; a video requires "
                          "all of its frames");
    if (values->projection && option_given(line, "path-lens"))
        return refuse_idle(line, "path-lens", "with --projection equirectangular");
    if (values->overscan > 0 && (values->film || values->projection))
        return fail_usage("--overscan and %s are mutually exclusive; %s",
                          values->film ? "--video" : "--projection equirectangular",
                          values->film ? "the frames of a video have no data window"
                                       : "a panorama shows all directions");
    if (values->focus > 0 && !(values->aperture > 0))
        return fail_usage(
            "--focus has no effect with --aperture 0; set a lens diameter with --aperture");
    return -1;
}

// Warns about shared options that have no effect on these images.
static void warn_about_idle(const command_line *line, const render_values *values)
{
    const bool colors = values->output && (values->aovs & AOV_RGBA) != 0,
               exr = colors && values->format == FORMAT_EXR,
               pictures = values->film || (colors && values->format != FORMAT_EXR);
    warn_idle(line, "masks|invert-masks|alpha|image-cache|input-colorspace",
              "on render, which reads no photos");
    if (values->camera)
        warn_idle(line, "images|downscale|eval|test-every|test-images", "with --camera");
    else if (values->view || values->orbit || values->spiral)
        warn_idle(line, "eval|test-every|test-images",
                  values->view    ? "with --view"
                  : values->orbit ? "with --orbit"
                                  : "with --spiral");
    else if (option_given(line, "split") && splits[values->split] == SGS_SPLIT_ALL)
        warn_idle(line, "eval|test-every|test-images", "with --split all");
    if (!pictures)
        warn_idle(line, "background",
                  colors ? "on EXR files, which have no background" : "without --aov rgba");
    if (!exr && !values->deep)
        warn_idle(line, "white",
                  pictures ? "on PNG files and videos, which hold display values"
                           : "without --aov rgba");
    else if (values->encoding != EXR_LINEAR)
        warn_idle(line, "white", "with --exr-encoding srgb");
    if (values->reference)
        warn_idle(line, "compact-box", "with --reference, which has no tiles");
}

int command_render(int argc, char **argv)
{
    command_call call;
    scene_values data;
    drawing_values drawing;
    render_values values = {0};
    const command_spec spec = {.name = "render",
                               .synopsis = "MODEL SCENE|--camera FILE -o DIR [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 2,
                               .title = "Rendering",
                               .options = render_options,
                               .option_count = RENDER_OPTIONS,
                               .values = &values,
                               .scene = &data,
                               .drawing = &drawing};
    int status = command_parse(&spec, argc, argv, &call);
    camera_choice choice;
    if (status < 0)
        status = check_values(&call.line, &values, &choice);
    if (status < 0)
        status = common_apply(&call.common, &call.line);
    if (status >= 0)
        return status;
    warn_about_idle(&call.line, &values);
    interrupt_watch();
    const bool listed = group_ranks() && !call.common.json; // after all files are known
    if (call.common.json || listed)
        reported_files_begin();
    status = run_render(&call.line, &values, &choice, &data, &drawing);
    if (listed)
        reported_files_list();
    return !call.common.json || status == EXIT_FAILED || reported_files_print() ? status
                                                                                : EXIT_FAILED;
}
