// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cameras/render_cameras.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "arguments/shared_options.h"
#include "cameras/camera_path.h"
#include "cameras/chan_file.h"
#include "cameras/lens_scale.h"
#include "cameras/usd_camera_file.h"
#include "cli/file_stems.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "options/options.h"

static bool parse_number(const char **at, int low, int high, int *value)
{
    char *end;
    const char *digits = *at + (low < 0 && **at == '-');
    if (*digits < '0' || *digits > '9')
        return false;
    const long number = strtol(*at, &end, 10);
    *at = end;
    *value = (int)number;
    return number >= low && number <= high;
}

bool frame_range_parse(const char *text, frame_range *range)
{
    enum { MAX_FRAME = 10000000 }; // some paths end after 1000000, the largest --first-frame
    const char *at = text;
    *range = (frame_range){.step = 1};
    if (!parse_number(&at, -MAX_FRAME, MAX_FRAME, &range->first))
        return false;
    range->last = range->first;
    if (*at == '-') {
        ++at;
        if (!parse_number(&at, -MAX_FRAME, MAX_FRAME, &range->last) || range->last < range->first)
            return false;
    }
    if (*at == ':' && (++at, !parse_number(&at, 1, MAX_FRAME, &range->step)))
        return false;
    return !*at;
}

bool size_parse(const char *text, int *width, int *height)
{
    const char *at = text;
    return parse_number(&at, 1, 65536, width) && *at++ == 'x' &&
           parse_number(&at, 1, 65536, height) && !*at;
}

static bool in_range(const frame_range *range, int frame)
{
    return !range->step || (frame >= range->first && frame <= range->last &&
                            (frame - range->first) % range->step == 0);
}

void cameras_keep_frames(const frame_range *range, camera_list *list)
{
    size_t count = 0;
    for (size_t i = 0; i < list->count; ++i) {
        if (in_range(range, list->cameras[i].frame))
            list->cameras[count++] = list->cameras[i];
        else
            named_camera_free(&list->cameras[i]);
    }
    list->count = count;
}

static void keep_camera(camera_list *list, size_t kept)
{
    for (size_t i = 0; i < list->count; ++i)
        if (i != kept)
            named_camera_free(&list->cameras[i]);
    list->cameras[0] = list->cameras[kept];
    list->count = 1;
}

static bool missing_view(const char *path, const char *view, const camera_list *list)
{
    const char **names = calloc(list->count + 1, sizeof *names);
    for (size_t i = 0; names && i < list->count; ++i)
        names[i] = list->cameras[i].name;
    char near[SUGGESTION_LENGTH];
    suggestion(near, "", view, names, names ? list->count : 0);
    if (!*near && list->count)
        fail_run("%s: no view named '%s'; its %zu views begin with '%s'", path, view, list->count,
                 list->cameras[0].name);
    else
        fail_run("%s: no view named '%s'%s", path, view, near);
    free(names);
    return false;
}

// Keeps the camera that `view` denotes; NULL: all. `path` is that of the cameras.
static bool keep_view(const char *path, const char *view, camera_list *list)
{
    size_t best = 0, other = 0; // other: a later one that it denotes as well; 0: none
    int least = -1;
    for (size_t i = 0; view && i < list->count; ++i) {
        const int match = sgs_view_name_match(list->cameras[i].name, view);
        if (match >= 0 && (least < 0 || match < least)) {
            least = match;
            best = i;
            other = 0;
        } else if (match > 0 && match == least && !other) {
            other = i;
        }
    }
    if (other) {
        fail_run("%s: --view '%s' is ambiguous: '%s' or '%s'; give the full name", path, view,
                 list->cameras[best].name, list->cameras[other].name);
        return false;
    }
    if (view && least < 0)
        return missing_view(path, view, list);
    if (view)
        keep_camera(list, best);
    return true;
}

static void keep_split(const sgs_scene *scene, sgs_split split, camera_list *list)
{
    list->count = 0;
    for (size_t v = 0; v < scene->view_count; ++v)
        if (view_in_split(&scene->views[v], split))
            list->cameras[list->count++] = list->cameras[v];
        else
            named_camera_free(&list->cameras[v]);
}

// Of all views before a selection, so that a view has the same name in each.
static bool name_files(camera_list *list)
{
    char **stems = file_stems(&list->cameras->name, sizeof *list->cameras, list->count);
    for (size_t i = 0; stems && i < list->count; ++i)
        list->cameras[i].stem = stems[i];
    free(stems);
    return stems != NULL;
}

static bool scene_cameras(const camera_choice *choice, const sgs_scene *scene, camera_list *list)
{
    list->first = choice->first_frame;
    const sgs_split split = choice->split_given || scene_split_count(scene, choice->split)
                                ? choice->split
                                : SGS_SPLIT_ALL;
    list->cameras = calloc(scene->view_count + 1, sizeof *list->cameras);
    if (!list->cameras) {
        fail_run("not enough memory for the cameras of %zu views", scene->view_count);
        return false;
    }
    for (size_t v = 0; v < scene->view_count; ++v) {
        const sgs_view *view = &scene->views[v];
        list->cameras[list->count++] = (named_camera){.name = format_text("%s", view->name),
                                                      .camera = view->camera,
                                                      .file_camera = view->file_camera,
                                                      .pose = view->pose,
                                                      .orientation = view->orientation};
    }
    if (!name_files(list))
        return false;
    if (choice->view)
        return keep_view(scene->path, choice->view, list);
    keep_split(scene, split, list);
    if (list->count)
        return true;
    fail_run(
        "%s: no views in this split; hold images out with --eval, --test-every or --test-images",
        scene->path);
    return false;
}

// Cameras of a COLMAP model or another data set, without its photos.
static bool data_set_cameras(const camera_choice *choice, camera_list *list)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.load_images = false;
    options.cameras_only = true;
    options.downscale = 1;
    options.view_width = choice->width;
    options.view_height = choice->height;
    sgs_scene *scene = NULL;
    if (sgs_scene_load(choice->file, &options, &scene)) {
        fail_library();
        return false;
    }
    camera_choice all = *choice;
    all.split = SGS_SPLIT_ALL;
    list->scene = scene;
    return scene_cameras(&all, scene, list);
}

// A view is a frame, or a camera with all of its frames.
static bool usd_cameras(const camera_choice *choice, camera_list *list)
{
    if (!usd_camera_file_read(choice->file, choice->first_frame, choice->width, choice->height,
                              list) ||
        !name_files(list) ||
        !((choice->view && usd_camera_file_keep(choice->view, list)) ||
          keep_view(choice->file, choice->view, list)))
        return false;
    usd_camera_file_number(list);
    return true;
}

static bool file_cameras(const camera_choice *choice, camera_list *list)
{
    struct stat status;
    const bool is_folder = !stat(choice->file, &status) && S_ISDIR(status.st_mode),
               is_chan = !is_folder && chan_file_is(choice->file);
    if (!is_folder && !is_chan && usd_camera_file_is(choice->file))
        return usd_cameras(choice, list);
    if (is_folder || (!is_chan && camera_file_is_scene(choice->file)))
        return data_set_cameras(choice, list);
    return (is_chan ? chan_file_read(choice->file, choice->width, choice->height, list)
                    : camera_file_read(choice->file, choice->first_frame, list)) &&
           name_files(list) && keep_view(choice->file, choice->view, list);
}

static bool source_cameras(const camera_choice *choice, const sgs_scene *scene, camera_list *list)
{
    if (choice->file)
        return file_cameras(choice, list);
    if (!choice->orbit && !choice->spiral)
        return scene_cameras(choice, scene, list);
    const path_options options = {.count = choice->orbit ? choice->orbit : choice->spiral,
                                  .first = choice->first_frame,
                                  .arc = choice->arc,
                                  .keep_lens = choice->keep_lens};
    return (choice->orbit ? camera_path_orbit : camera_path_spiral)(scene, &options, list) &&
           name_files(list);
}

// The aspect ratios differ by less than one pixel of the shorter side, in the smaller of the sizes:
// each may be the other, reduced or enlarged and rounded.
static bool same_shape(const sgs_camera *camera, int width, int height)
{
    const long long a = (long long)width * camera->height, b = (long long)height * camera->width;
    const int sides[4] = {width, height, camera->width, camera->height};
    long long longest = 0;
    for (int k = 0; k < 4; ++k)
        longest = sides[k] > longest ? sides[k] : longest;
    return (a < b ? b - a : a - b) < longest;
}

// The lens of a photo scales per axis to the sizes of its reductions, as in training.
static sgs_camera sized_camera(const named_camera *view, int width, int height)
{
    const sgs_camera *camera = &view->camera, *file = &view->file_camera;
    if (camera->width == width && camera->height == height)
        return *camera;
    if (file->width < 1)
        return sgs_camera_reframed(camera, width, height);
    return same_shape(file, width, height) ? sgs_camera_resized(file, width, height)
                                           : sgs_camera_reframed(file, width, height);
}

static void reshape(const camera_choice *choice, named_camera *view)
{
    sgs_camera *camera = &view->camera;
    const bool sized = choice->width > 0;
    const sgs_camera sphere = sgs_camera_equirectangular(camera->width, camera->height);
    if (choice->projection == PROJECTION_EQUIRECTANGULAR || sgs_camera_equal(camera, &sphere))
        *camera = sgs_camera_equirectangular(sized ? choice->width : 2 * camera->height,
                                             sized ? choice->height : camera->height);
    else if (sized)
        *camera = sized_camera(view, choice->width, choice->height);
}

// The numbers of the file (.chan, or one OpenUSD camera), or those counted from --first-frame.
static void number_frames(camera_list *list)
{
    for (size_t i = 0; i < list->count && !list->has_frames; ++i)
        list->cameras[i].frame = list->first + (int)i;
}

// Returns false. The range has no camera, whose frames are numbered from low to high.
static bool fail_frames(const frame_range *range, int low, int high, const camera_list *list)
{
    if (range->first > high || range->last < low) {
        fail_run("--frames: %d is out of range; choose from the frames %d to %d",
                 range->first > high ? range->first : range->last, low, high);
        return false;
    }
    int next = high;
    for (size_t i = 0; i < list->count; ++i) {
        const int frame = list->cameras[i].frame;
        next = frame >= range->first && frame < next ? frame : next;
    }
    fail_run("--frames: no frame is selected; of the frames %d to %d, the first one from %d on is "
             "%d",
             low, high, range->first, next);
    return false;
}

static bool frames_exist(const frame_range *range, const camera_list *list)
{
    for (size_t i = 0; range->step && !list->has_frames && i < list->count; ++i)
        if (list->cameras[i].prim) {
            fail_run("--frames: the file has several cameras; choose one with --view, such as '%s'",
                     list->cameras[i].prim);
            return false;
        }
    int low = list->cameras[0].frame, high = low;
    bool any = false;
    for (size_t i = 0; i < list->count; ++i) {
        const int frame = list->cameras[i].frame;
        low = frame < low ? frame : low;
        high = frame > high ? frame : high;
        any = any || in_range(range, frame);
    }
    if (!any)
        return fail_frames(range, low, high, list);
    if (range->step && range->first < low)
        print_warning("--frames: %d is out of range; the first frame is %d", range->first, low);
    if (range->step && range->last > high)
        print_warning("--frames: %d is out of range; the last frame is %d", range->last, high);
    return true;
}

static sgs_camera pinhole_of(const sgs_camera *camera)
{
    sgs_camera out = {
        .model = SGS_CAMERA_PINHOLE, .width = camera->width, .height = camera->height};
    camera_paraxial(camera, &out.params[0], &out.params[1], &out.params[2], &out.params[3]);
    return out;
}

// False after printing the error.
static bool undistort(named_camera *view)
{
    if (view->camera.model == SGS_CAMERA_EQUIRECTANGULAR) {
        fail_run("%s: is a panorama, which --path-lens pinhole cannot show; omit the option",
                 view->name);
        return false;
    }
    view->camera = pinhole_of(&view->camera);
    if (view->file_camera.width > 0)
        view->file_camera = pinhole_of(&view->file_camera);
    return true;
}

bool cameras_choose(const camera_choice *choice, const sgs_scene *scene, camera_list *list)
{
    *list = (camera_list){0};
    bool done = source_cameras(choice, scene, list);
    if (done) {
        number_frames(list);
        done = frames_exist(&choice->frames, list);
    }
    for (size_t i = 0; i < list->count && done && choice->pinhole; ++i)
        done = undistort(&list->cameras[i]);
    if (!done) {
        camera_list_free(list);
        return false;
    }
    for (size_t i = 0; i < list->count; ++i)
        reshape(choice, &list->cameras[i]);
    return true;
}
