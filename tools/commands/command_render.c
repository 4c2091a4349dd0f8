// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs render`: views of a stored model as EXR or PNG, by the tracer or, with --reference, by
// the brute-force renderer that defines what the tracer must compute.

#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/interrupt.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cameras/render_cameras.h"
#include "draw/view_drawer.h"

static const char description[] =
    "Draws MODEL (a PLY file, or the folder of a training run: its newest iteration) from the "
    "cameras\n"
    "of SCENE, from a camera file, or along a path around the scene. Writes DIR/STEM.exr with all\n"
    "quantities as layers, or DIR/STEM.png and DIR/STEM.AOV.png, STEM being the view's image name\n"
    "without its extension, and prints the paths. EXR colours are premultiplied by alpha, without\n"
    "background, and scene-linear: trained colours are display (sRGB) values and are decoded, "
    "unless\n"
    "--exr-encoding srgb keeps them. PNGs and films are laid over the background.";

typedef struct render_values {
    const char *output, *view, *camera;
    int split, format, encoding, depth, compression;
    unsigned aovs;
    bool reference, deep;
    double deep_tolerance;
    int deep_max;
    const char *frames, *size, *film;
    int orbit, spiral, projection, samples;
    double aperture, focus, fps;
} render_values;

#define AT(member) offsetof(render_values, member)

static const option render_options[] = {
    {"output", 'o', OPTION_TEXT, AT(output), 0, 0, "DIR", NULL, "none", NULL,
     "folder to write to; needed unless there is --video"},
    {"video", 0, OPTION_TEXT, AT(film), 0, 0, "FILE.mp4", NULL, "none", NULL,
     "the pictures as a film, made by ffmpeg, which must be installed"},
    {"fps", 0, OPTION_REAL, AT(fps), 0.01, 1000, "X", NULL, "the camera path's, or 30",
     "pictures per second", "of --video"},
    {"view", 0, OPTION_TEXT, AT(view), 0, 0, "NAME", NULL, "see --split", NULL,
     "draw this view only: an image name, with or without folder and extension"},
    {"split", 0, OPTION_CHOICE, AT(split), 0, 0, "test|train|all", "test",
     "test, or all when no image is held out", NULL, "the views to draw"},
    {"camera", 0, OPTION_TEXT, AT(camera), 0, 0, "FILE", NULL, "none", NULL,
     "draw from this cameras.json, camera path of nerfstudio or folder of a COLMAP model (without "
     "photographs) "
     "instead of a SCENE"},
    {"orbit", 0, OPTION_INTEGER, AT(orbit), 1, 100000, "N", NULL, "none", "frames",
     "a circle around what the views of SCENE look at"},
    {"spiral", 0, OPTION_INTEGER, AT(spiral), 1, 100000, "N", NULL, "none", "frames",
     "two turns around the view in the middle of SCENE's"},
    {"frames", 0, OPTION_TEXT, AT(frames), 0, 0, "A-B[:STEP]", NULL, "all", NULL,
     "only these of the chosen views, counted from 0"},
    {"size", 0, OPTION_TEXT, AT(size), 0, 0, "WxH", NULL, "the view's", "pixels",
     "the same lens at another size (--downscale divides that of SCENE's photographs)"},
    {"projection", 0, OPTION_CHOICE, AT(projection), 0, 0, "view|equirectangular", "view", NULL,
     NULL, "the view's lens, or all directions around it as longitude and latitude"},
    {"spp", 0, OPTION_INTEGER, AT(samples), 1, 4096, "N", NULL, "1, or 64 with --aperture",
     "samples", "colours are the mean of N points of each pixel"},
    {"aperture", 0, OPTION_REAL, AT(aperture), 0, 1e6, "D", "0", NULL, "world units",
     "diameter of the lens: what is out of focus is blurred"},
    {"focus", 0, OPTION_REAL, AT(focus), 0, 1e9, "Z", NULL, "what stands in the middle",
     "world units", "distance along the axis that is in focus"},
    {"aov", 0, OPTION_SET, AT(aovs), 0, 0, AOV_WORDS, "rgba,depth", NULL, NULL,
     "quantities to write; region and slack need the folder of a run with SPARE-GS"},
    {"depth", 0, OPTION_CHOICE, AT(depth), 0, 0, "ray|z", "ray", NULL, NULL,
     "distances are along the ray, or along the camera's axis"},
    {"format", 0, OPTION_CHOICE, AT(format), 0, 0, "exr|png", "exr", NULL, NULL, "file format"},
    {"exr-encoding", 0, OPTION_CHOICE, AT(encoding), 0, 0, "linear|srgb", "linear", NULL, NULL,
     "colours of an EXR: decoded to scene-linear, or the display values as trained"},
    {"compression", 0, OPTION_CHOICE, AT(compression), 0, 0, "auto|zip|zips|piz|none|dwaa", "auto",
     NULL, NULL,
     "how an EXR's pixels are packed; auto is zip, but leaves as it is what would not shrink by a "
     "third; dwaa loses a "
     "little of the colours"},
    {"deep", 0, OPTION_FLAG, AT(deep), 0, 0, NULL, NULL, NULL, NULL,
     "write DIR/STEM.deep.exr too: the samples of every ray, which flatten to the image"},
    {"deep-tolerance", 0, OPTION_REAL, AT(deep_tolerance), 0, 1, "X", "0.01", NULL,
     "of the distance", "hits closer than this to the first of a sample join it"},
    {"deep-max", 0, OPTION_INTEGER, AT(deep_max), 1, 256, "N", "32", NULL, "samples",
     "per pixel at most; where there are more, the tolerance grows"},
    {"reference", 0, OPTION_FLAG, AT(reference), 0, 0, NULL, NULL, NULL, NULL,
     "draw by brute force in double precision: exact and slow"},
};

enum { FORMAT_EXR = 0, DEPTH_Z = 1, BLUR_SAMPLES = 64, DEFAULT_FPS = 30 };
static const sgs_split splits[] = {SGS_SPLIT_TEST, SGS_SPLIT_TRAIN, SGS_SPLIT_ALL};

// What the options ask for, in the words of those who do it.
static view_options view_options_from(const render_values *values, double path_fps)
{
    const bool blurred = values->aperture > 0;
    return (view_options){.folder = values->output,
                          .aovs = values->aovs,
                          .axis_depth = values->depth == DEPTH_Z,
                          .png = values->format != FORMAT_EXR,
                          .reference = values->reference,
                          .encoding = (exr_encoding)values->encoding,
                          .compression = (sgs_exr_compression)values->compression,
                          .deep = values->deep,
                          .deep_options = {values->deep_tolerance, values->deep_max},
                          .samples = values->samples ? values->samples
                                     : blurred       ? BLUR_SAMPLES
                                                     : 1,
                          .aperture = values->aperture,
                          .focus = values->focus,
                          .film = values->film,
                          .fps = values->fps > 0 ? values->fps
                                 : path_fps > 0  ? path_fps
                                                 : DEFAULT_FPS};
}

// Reads the regions of the model where they are wanted; --aov all goes without when there are none.
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
        fail_run("%s: there are no regions recorded with this model; region and slack need the "
                 "folder of a run with "
                 "--spare on",
                 model_name);
        return false;
    }
    *aovs &= ~(unsigned)(AOV_REGION | AOV_SLACK);
    print_note("%s: no regions are recorded with this model; region and slack are left out",
               model_name);
    return true;
}

static bool render_views(const sgs_gaussians *model, const camera_list *cameras,
                         const view_options *options, const drawing_values *drawing)
{
    view_drawer drawer;
    bool done = view_drawer_open(&drawer, options, drawing, model);
    for (size_t i = 0; i < cameras->count && done && !interrupt_signal(); ++i) {
        done = view_drawer_draw(&drawer, &cameras->cameras[i]);
        progress_count("render", i + 1, cameras->count);
    }
    progress_end();
    done = view_drawer_close(&drawer, done) && done;
    if (done)
        print_note("%zu view(s): %.2f s drawing, meanwhile %.2f s writing", drawer.drawn,
                   drawer.draw_seconds, drawer.write_seconds);
    return done;
}

static bool render_model(const char *name, const model_path *located, const camera_list *cameras,
                         const drawing_values *drawing, const render_values *values)
{
    sgs_gaussians *model = NULL;
    if (sgs_ply_read(located->ply_path, &model)) {
        fail_library();
        return false;
    }
    view_options options = view_options_from(values, cameras->fps);
    region_map regions;
    options.regions = &regions;
    const bool done = find_regions(name, located->iteration, model, &regions, &options.aovs) &&
                      render_views(model, cameras, &options, drawing);
    region_map_free(&regions);
    sgs_gaussians_destroy(model);
    return done;
}

static int run_render(const command_line *line, const render_values *values,
                      const camera_choice *choice, scene_values *data, drawing_values *drawing)
{
    model_path located;
    sgs_scene *scene = NULL;
    camera_list cameras = {0};
    int status = model_locate(line->operands[0], &located) ? -1 : EXIT_FAILED;
    if (status < 0)
        status = scene_resolve(data, line, located.config);
    if (status < 0 && values->output &&
        !(make_folder(values->output) && check_writable(values->output)))
        status = EXIT_FAILED;
    if (status < 0 && !values->camera) {
        scene = scene_open(line->operands[1], data, false);
        status = scene ? -1 : EXIT_FAILED;
    }
    if (status < 0 && !cameras_choose(choice, scene, &cameras))
        status = EXIT_FAILED;
    if (status < 0) {
        drawing_resolve(drawing, line, located.config, scene);
        if (values->reference && !option_given(line, "compact-box"))
            drawing->compact_box = 1; // it knows no tiles
        const bool done = render_model(line->operands[0], &located, &cameras, drawing, values);
        status = done ? interrupt_status() : EXIT_FAILED;
    }
    camera_list_free(&cameras);
    sgs_scene_destroy(scene);
    model_path_free(&located);
    return status;
}

// Options that exclude or need each other, and those with a form of their own. -1 to go on.
static int check_values(const command_line *line, const render_values *values,
                        camera_choice *choice)
{
    *choice = (camera_choice){.view = values->view,
                              .file = values->camera,
                              .split = splits[values->split],
                              .split_given = option_given(line, "split"),
                              .orbit = values->orbit,
                              .spiral = values->spiral,
                              .projection = values->projection};
    const int paths =
        (values->orbit > 0) + (values->spiral > 0) + (values->view != NULL) + choice->split_given;
    const bool sampled = values->samples > 1 || values->aperture > 0;
    if ((line->operand_count == 2) == (values->camera != NULL))
        return fail_usage(
            "render needs a SCENE or --camera FILE, one of them; usage: sparegs render %s",
            line->synopsis);
    if (!values->output && !values->film)
        return fail_usage("render needs -o DIR, the folder to write to (or --video FILE); usage: "
                          "sparegs render %s",
                          line->synopsis);
    if ((values->orbit > 0 || values->spiral > 0) && (paths > 1 || values->camera))
        return fail_usage(
            "--orbit, --spiral, --view, --split and --camera exclude each other; give one of them");
    if (values->frames && !frame_range_parse(values->frames, &choice->frames))
        return fail_usage("--frames: '%s' is not FIRST-LAST nor FIRST-LAST:STEP, counted from 0",
                          values->frames);
    if (values->size && !size_parse(values->size, &choice->width, &choice->height))
        return fail_usage("--size: '%s' is not WIDTHxHEIGHT, each from 1 to 65536", values->size);
    if (values->deep && (values->reference || sampled || !values->output))
        return fail_usage(
            "--deep and %s exclude each other; deep files hold the hits of one ray per pixel",
            values->reference           ? "--reference"
            : values->aperture > 0      ? "--aperture"
            : values->output && sampled ? "--spp"
                                        : "--video without -o");
    if (values->focus > 0 && !(values->aperture > 0))
        return fail_usage("--focus needs --aperture: a lens without width is in focus everywhere");
    return -1;
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
                               .option_count = sizeof render_options / sizeof *render_options,
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
    interrupt_watch();
    if (call.common.json)
        told_files_begin();
    status = run_render(&call.line, &values, &choice, &data, &drawing);
    return !call.common.json || status == EXIT_FAILED || told_files_print() ? status : EXIT_FAILED;
}
