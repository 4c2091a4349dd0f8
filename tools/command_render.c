// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs render`: views of a stored model as EXR or PNG, by the tracer or, with --reference, by the brute-force
// renderer that defines what the tracer must compute.

#include <stdlib.h>
#include <string.h>

#include "camera_file.h"
#include "commands.h"
#include "frame_files.h"
#include "interrupt.h"
#include "output.h"
#include "progress.h"
#include "shared_options.h"

static const char description[] =
    "Draws MODEL (a PLY file, or the folder of a training run: its newest iteration) from the cameras\n"
    "of SCENE, or from those of a cameras.json. Writes DIR/STEM.exr with all quantities as layers, or\n"
    "DIR/STEM.png and DIR/STEM.AOV.png, STEM being the view's image name without its extension, and\n"
    "prints the paths. EXR colours are premultiplied by alpha, without background, and scene-linear:\n"
    "trained colours are display (sRGB) values and are decoded, unless --exr-encoding srgb keeps them.\n"
    "PNGs are laid over the background.";

typedef struct render_values {
    const char *output, *view, *camera;
    int split, format, encoding, depth, compression;
    unsigned aovs;
    bool reference, deep;
    double deep_tolerance;
    int deep_max;
} render_values;

#define AT(member) offsetof(render_values, member)

static const option render_options[] = {
    {"output", 'o', OPTION_TEXT, AT(output), 0, 0, "DIR", NULL, NULL, NULL, "folder to write to; needed"},
    {"view", 0, OPTION_TEXT, AT(view), 0, 0, "NAME", NULL, "see --split", NULL,
     "draw this view only: an image name, with or without folder and extension"},
    {"split", 0, OPTION_CHOICE, AT(split), 0, 0, "test|train|all", "test", "test, or all when no image is held out",
     NULL, "the views to draw"},
    {"camera", 0, OPTION_TEXT, AT(camera), 0, 0, "FILE", NULL, "none", NULL,
     "draw from the cameras of this cameras.json instead of a SCENE"},
    {"aov", 0, OPTION_SET, AT(aovs), 0, 0, AOV_WORDS, "rgba,depth", NULL, NULL, "quantities to write"},
    {"depth", 0, OPTION_CHOICE, AT(depth), 0, 0, "ray|z", "ray", NULL, NULL,
     "distances are along the ray, or along the camera's axis"},
    {"format", 0, OPTION_CHOICE, AT(format), 0, 0, "exr|png", "exr", NULL, NULL, "file format"},
    {"exr-encoding", 0, OPTION_CHOICE, AT(encoding), 0, 0, "linear|srgb", "linear", NULL, NULL,
     "colours of an EXR: decoded to scene-linear, or the display values as trained"},
    {"compression", 0, OPTION_CHOICE, AT(compression), 0, 0, "zip|zips|piz|none", "zip", NULL, NULL,
     "how an EXR's pixels are packed"},
    {"deep", 0, OPTION_FLAG, AT(deep), 0, 0, NULL, NULL, NULL, NULL,
     "write DIR/STEM.deep.exr too: the samples of every ray, which flatten to the image"},
    {"deep-tolerance", 0, OPTION_REAL, AT(deep_tolerance), 0, 1, "X", "0.01", NULL, "of the distance",
     "hits closer than this to the first of a sample join it"},
    {"deep-max", 0, OPTION_INTEGER, AT(deep_max), 1, 256, "N", "32", NULL, "samples",
     "per pixel at most; where there are more, the tolerance grows"},
    {"reference", 0, OPTION_FLAG, AT(reference), 0, 0, NULL, NULL, NULL, NULL,
     "draw by brute force in double precision: exact and slow"},
};

enum { FORMAT_EXR = 0, DEPTH_Z = 1 };
static const sgs_split splits[] = {SGS_SPLIT_TEST, SGS_SPLIT_TRAIN, SGS_SPLIT_ALL};

typedef struct rendering {
    const render_values *values;
    const drawing_values *drawing;
    const sgs_gaussians *model;
    sgs_renderer *renderer; // NULL with --reference
    double *params;         // with --reference
    sgs_frame frame;        // of the last view, for the next of its size
    size_t drawn;
    double draw_seconds, write_seconds;
} rendering;

static bool draw_reference(const rendering *job, const sgs_camera *camera, const sgs_pose *pose,
                           const sgs_render_options *options, sgs_frame *frame)
{
    sgs_reference_frame exact = {0};
    bool done = !sgs_reference_frame_create(camera->width, camera->height, &exact) &&
                !sgs_reference_render(job->params, job->model->count, camera, pose, options, &exact);
    const double *const from[] = {exact.color[0],    exact.color[1],     exact.color[2],    exact.transmittance,
                                  exact.depth_mean,  exact.depth_median, exact.depth_first, exact.hits,
                                  exact.normal[0],   exact.normal[1],    exact.normal[2],   exact.position[0],
                                  exact.position[1], exact.position[2]};
    float *const to[] = {frame->color[0],    frame->color[1],     frame->color[2],    frame->transmittance,
                         frame->depth_mean,  frame->depth_median, frame->depth_first, frame->hits,
                         frame->normal[0],   frame->normal[1],    frame->normal[2],   frame->position[0],
                         frame->position[1], frame->position[2]};
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    for (size_t k = 0; k < sizeof to / sizeof *to && done; ++k)
        for (size_t i = 0; i < pixels && to[k]; ++i)
            to[k][i] = (float)from[k][i];
    for (size_t i = 0; i < pixels && done && frame->primitive; ++i)
        frame->primitive[i] = exact.primitive[i] < 0 ? SGS_NO_PRIMITIVE : (uint32_t)exact.primitive[i];
    sgs_reference_frame_free(&exact);
    return done;
}

// False after telling it, when some ray of the lens runs sideways or back.
static bool has_axis_depth(const char *name, const sgs_camera *camera)
{
    for (int i = 0; sgs_camera_is_fisheye(camera->model) && i < camera->width * camera->height; ++i) {
        const double pixel[2] = {i % camera->width + 0.5, i / camera->width + 0.5};
        double direction[3];
        if (sgs_camera_unproject(camera, pixel, direction) && !(direction[2] > 0)) {
            fail_run("%s: --depth z has no meaning for a lens that sees beyond 90 degrees; use --depth ray", name);
            return false;
        }
    }
    return true;
}

// Gives the job's frame the size of a view.
static bool prepare_frame(rendering *job, const sgs_camera *camera)
{
    sgs_frame *frame = &job->frame;
    if (frame->width == camera->width && frame->height == camera->height)
        return true;
    sgs_frame_free(frame);
    if (!sgs_frame_create_with(camera->width, camera->height, aov_planes(job->values->aovs), frame))
        return true;
    fail_library();
    return false;
}

static bool draw_flat(rendering *job, const frame_files *files, const sgs_render_options *options)
{
    const bool done = job->renderer
                          ? !sgs_renderer_render(job->renderer, files->camera, files->pose, options, &job->frame)
                          : draw_reference(job, files->camera, files->pose, options, &job->frame);
    if (!done)
        fail_library();
    return done;
}

// Renders into the frame, and the deep file on the way.
static bool draw_deep(rendering *job, const frame_files *files, const sgs_render_options *options)
{
    sgs_deep_options deep = {.tolerance = job->values->deep_tolerance, .max_samples = job->values->deep_max};
    deep_file *file = deep_file_open(files, &job->frame, deep.max_samples);
    if (!file)
        return false;
    const bool done = !sgs_renderer_render_deep(job->renderer, files->camera, files->pose, options, &deep, &job->frame,
                                                deep_file_rows, file);
    if (!done)
        fail_library();
    return deep_file_close(file, done);
}

static bool draw(rendering *job, const char *name, const sgs_camera *camera, const sgs_pose *pose)
{
    const render_values *values = job->values;
    sgs_render_options options = sgs_render_options_default();
    options.filter = (sgs_filter)job->drawing->filter;
    options.axis_depth = values->depth == DEPTH_Z;
    if (options.axis_depth && !has_axis_depth(name, camera))
        return false;
    frame_files files = {.folder = values->output,
                         .name = name,
                         .camera = camera,
                         .pose = pose,
                         .aovs = values->aovs,
                         .axis_depth = options.axis_depth,
                         .encoding = (exr_encoding)values->encoding,
                         .compression = (sgs_exr_compression)values->compression,
                         .space = job->drawing->space,
                         .white = (float)job->drawing->white};
    memcpy(files.background, job->drawing->background.rgb, sizeof files.background);
    const double start = clock_seconds();
    bool done = prepare_frame(job, camera) &&
                (values->deep ? draw_deep(job, &files, &options) : draw_flat(job, &files, &options));
    const double drawn = clock_seconds();
    if (done)
        done =
            values->format == FORMAT_EXR ? frame_write_exr(&files, &job->frame) : frame_write_png(&files, &job->frame);
    job->draw_seconds += drawn - start;
    job->write_seconds += clock_seconds() - drawn;
    ++job->drawn;
    return done;
}

static bool draw_scene(rendering *job, const sgs_scene *scene, bool split_given)
{
    if (job->values->view) {
        const ptrdiff_t v = sgs_scene_find_view(scene, job->values->view);
        if (v >= 0)
            return draw(job, scene->views[v].name, &scene->views[v].camera, &scene->views[v].pose);
        const char **names = calloc(scene->view_count + 1, sizeof *names);
        for (size_t i = 0; names && i < scene->view_count; ++i)
            names[i] = scene->views[i].name;
        const char *nearest = names ? nearest_word(job->values->view, names, scene->view_count) : NULL;
        fail_run("%s: has no view '%s'; the nearest is '%s'", scene->path, job->values->view, nearest ? nearest : "");
        free(names);
        return false;
    }
    sgs_split split = splits[job->values->split];
    if (!split_given && !scene_split_count(scene, split))
        split = SGS_SPLIT_ALL;
    const size_t total = scene_split_count(scene, split);
    if (!total) {
        fail_run("%s: no view is in this split; hold some out by --eval, --test-every or --test-images", scene->path);
        return false;
    }
    for (size_t v = 0; v < scene->view_count && !interrupt_signal(); ++v) {
        const sgs_view *view = &scene->views[v];
        if (view_in_split(view, split) && !draw(job, view->name, &view->camera, &view->pose))
            return false;
    }
    return true;
}

static bool draw_camera_file(rendering *job)
{
    named_camera *cameras;
    size_t count;
    if (!camera_file_read(job->values->camera, &cameras, &count))
        return false;
    bool done = true;
    for (size_t i = 0; i < count && done && !interrupt_signal(); ++i)
        if (!job->values->view || !strcmp(job->values->view, cameras[i].name))
            done = draw(job, cameras[i].name, &cameras[i].camera, &cameras[i].pose);
    if (done && !job->drawn && !interrupt_signal()) {
        fail_run("%s: has no camera '%s'", job->values->camera, job->values->view);
        done = false;
    }
    camera_file_free(cameras, count);
    return done;
}

// The model's parameters in double, row by row.
static double *exact_params(const sgs_gaussians *model)
{
    double *params = malloc((model->count + 1) * SGS_PARAM_COUNT * sizeof *params);
    for (size_t i = 0; params && i < model->count; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            params[i * SGS_PARAM_COUNT + (size_t)k] = (double)*sgs_gaussians_at(model, i, k);
    return params;
}

static bool render_model(const char *ply_path, const sgs_scene *scene, const drawing_values *drawing,
                         const render_values *values, bool split_given)
{
    sgs_gaussians *model = NULL;
    if (sgs_ply_read(ply_path, &model)) {
        fail_library();
        return false;
    }
    rendering job = {.values = values, .drawing = drawing, .model = model};
    bool done = true;
    if (values->reference) {
        job.params = exact_params(model);
        done = job.params != NULL;
        if (!done)
            fail_run("%s: no memory for %zu primitives in double precision", ply_path, model->count);
    } else if (sgs_renderer_create(model, &job.renderer)) {
        fail_library();
        done = false;
    }
    if (done)
        done = scene ? draw_scene(&job, scene, split_given) : draw_camera_file(&job);
    if (done)
        print_note("%zu view(s): %.2f s drawing, %.2f s writing", job.drawn, job.draw_seconds, job.write_seconds);
    sgs_frame_free(&job.frame);
    sgs_renderer_destroy(job.renderer);
    free(job.params);
    sgs_gaussians_destroy(model);
    return done;
}

static int run_render(const command_line *line, const render_values *values, scene_values *data,
                      drawing_values *drawing)
{
    model_path located;
    sgs_scene *scene = NULL;
    int status = model_locate(line->operands[0], &located) ? -1 : EXIT_FAILED;
    if (status < 0)
        status = scene_settle(data, line, located.config);
    if (status < 0 && !(make_folder(values->output) && check_writable(values->output)))
        status = EXIT_FAILED;
    if (status < 0 && !values->camera) {
        scene = scene_open(line->operands[1], data, false);
        status = scene ? -1 : EXIT_FAILED;
    }
    if (status < 0) {
        drawing_settle(drawing, line, located.config, scene);
        const bool done = render_model(located.ply_path, scene, drawing, values, option_given(line, "split"));
        status = done ? interrupt_status() : EXIT_FAILED;
    }
    sgs_scene_destroy(scene);
    model_path_free(&located);
    return status;
}

int command_render(int argc, char **argv)
{
    common_values common;
    scene_values data;
    drawing_values drawing;
    render_values values = {0};
    option_group groups[] = {{.title = "Rendering",
                              .options = render_options,
                              .count = sizeof render_options / sizeof *render_options,
                              .values = &values},
                             drawing_group(&drawing),
                             scene_group(&data),
                             common_group(&common)};
    command_line line = {.command = "render",
                         .synopsis = "MODEL SCENE|--camera FILE -o DIR [options]",
                         .description = description,
                         .groups = groups,
                         .group_count = sizeof groups / sizeof *groups,
                         .operand_minimum = 1,
                         .operand_maximum = 2};
    int status = command_line_parse(&line, argc, argv);
    if (status < 0 && (line.operand_count == 2) == (values.camera != NULL))
        status =
            fail_usage("render needs a SCENE or --camera FILE, one of them; usage: sparegs render %s", line.synopsis);
    if (status < 0 && !values.output)
        status = fail_usage("render needs -o DIR, the folder to write to; usage: sparegs render %s", line.synopsis);
    if (status < 0 && values.deep && values.reference)
        status = fail_usage("--deep and --reference exclude each other; the reference draws flat images");
    if (status < 0)
        status = common_apply(&common, &line);
    if (status >= 0)
        return status;
    interrupt_watch();
    return run_render(&line, &values, &data, &drawing);
}
