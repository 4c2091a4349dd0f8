// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// World axes of .chan are those of the scene, so that its cameras fit the position AOV and the
// worldToCamera matrix of the EXR files. Those of USD are y-up, as in the .usda models that this
// program writes: world y and z change sign, a turn by 180 degrees about x. .chan and USD cameras
// look down their -z axis with y up, ours look down z with y down: camera y and z change sign.
//
// .chan: frame, translation, rotation in degrees (order ZXY: about z first, then x, then y; Nuke's
// default), vertical field of view in degrees. Programs interpolate each angle between frames, so
// the angles of neighbouring frames must not jump by half or full turns.
//
// USD: a Camera prim with one time sample per frame. Apertures assume a film back 36 units wide
// (the width of full-frame film in mm). Its cameras have no pixel aspect ratio, which follows from
// the apertures and the size of the images only if the film is known to fit them: our attribute
// records it where pixels are not square.

#include "cameras/camera_export.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <stdlib.h>

#include "cameras/lens_scale.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "sparegs/scene.h"

#define PI 3.14159265358979323846

static const double FILM_WIDTH = 36; // mm

// Camera to world, row-major; columns are the camera's axes x right, y up, z backwards.
static void graphics_axes(const sgs_pose *pose, double axes[9])
{
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            axes[3 * i + j] = (j == 0 ? 1 : -1) * pose->rotation[3 * j + i];
}

static bool write_cameras_json(const char *path, const camera_list *list)
{
    sgs_named_camera *cameras = calloc(list->count + 1, sizeof *cameras);
    if (!cameras) {
        fail_run("%s: not enough memory for %zu cameras", path, list->count);
        return false;
    }
    for (size_t i = 0; i < list->count; ++i)
        cameras[i] = (sgs_named_camera){list->cameras[i].name, list->cameras[i].camera,
                                        list->cameras[i].pose, list->cameras[i].orientation};
    const bool done = !sgs_cameras_write_json(cameras, list->count, path);
    free(cameras);
    if (!done)
        fail_library();
    return done;
}

// Moves angles in degrees by full turns to those nearest to `last`. Returns the sum of the
// distances.
static double bring_near(const double last[3], double angles[3])
{
    double sum = 0;
    for (int k = 0; k < 3; ++k) {
        const double step = remainder(angles[k] - last[k], 360);
        angles[k] = last[k] + step;
        sum += fabs(step);
    }
    return sum;
}

// Rotation = R_y R_x R_z, of (x, y, z) or (180 - x, y + 180, z + 180) degrees: those nearer to
// `last`, the angles of the frame before, which are replaced.
static void chan_angles(const double axes[9], double last[3])
{
    const double level = hypot(axes[2], axes[8]), degrees = 180 / PI;
    double near[3] = {atan2(-axes[5], level) * degrees, atan2(axes[2], axes[8]) * degrees,
                      atan2(axes[3], axes[4]) * degrees};
    if (level < 1e-7) { // straight up or down, y and z turn about one axis: z stays
        near[2] = last[2];
        near[1] = atan2(-axes[6], axes[0]) * degrees + (axes[5] < 0 ? last[2] : -last[2]);
    }
    double other[3] = {180 - near[0], near[1] + 180, near[2] + 180};
    const bool is_other = bring_near(last, other) < bring_near(last, near);
    memcpy(last, is_other ? other : near, sizeof near);
}

// `angles`: of the line before; those of this one are stored there.
static void chan_line(FILE *out, const named_camera *camera, double angles[3])
{
    double axes[9], center[3], fx, fy, cx, cy;
    graphics_axes(&camera->pose, axes);
    sgs_pose_center(&camera->pose, center);
    camera_paraxial(&camera->camera, &fx, &fy, &cx, &cy);
    chan_angles(axes, angles);
    fprintf(out, "%d\t%.9g\t%.9g\t%.9g\t%.9g\t%.9g\t%.9g\t%.9g\n", camera->frame, center[0],
            center[1], center[2], angles[0], angles[1], angles[2],
            2 * atan2(0.5 * camera->camera.height, fy) * 180 / PI);
}

static void write_chan(FILE *out, const camera_list *list, double fps)
{
    (void)fps;              // not in this format
    double angles[3] = {0}; // those of the first line are as small as possible
    for (size_t i = 0; i < list->count; ++i)
        chan_line(out, &list->cameras[i], angles);
}

// Values of a camera in USD's terms.
typedef struct film {
    double focal, width, height, offset_x, offset_y, pixel_aspect;
} film;

static film film_of(const sgs_camera *camera)
{
    double fx, fy, cx, cy;
    camera_paraxial(camera, &fx, &fy, &cx, &cy);
    const double focal = fx / camera->width * FILM_WIDTH, height = camera->height / fy * focal;
    return (film){.focal = focal,
                  .width = FILM_WIDTH,
                  .height = height,
                  .offset_x = (0.5 - cx / camera->width) * FILM_WIDTH,
                  .offset_y = (cy / camera->height - 0.5) * height,
                  .pixel_aspect = camera_pixel_aspect(camera)};
}

static void usd_samples(FILE *out, const camera_list *list, const char *declaration, size_t offset)
{
    fprintf(out, "    %s.timeSamples = {\n", declaration);
    for (size_t i = 0; i < list->count; ++i) {
        const film values = film_of(&list->cameras[i].camera);
        double value;
        memcpy(&value, (const char *)&values + offset, sizeof value);
        fprintf(out, "        %d: %.9g,\n", list->cameras[i].frame, value);
    }
    fputs("    }\n", out);
}

static void write_usda(FILE *out, const camera_list *list, double fps)
{
    fprintf(out,
            "#usda 1.0\n(\n    defaultPrim = \"camera\"\n    startTimeCode = %d\n"
            "    endTimeCode = %d\n    timeCodesPerSecond = %.9g\n    framesPerSecond = %.9g\n"
            "    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n\ndef Camera \"camera\"\n{\n"
            "    token projection = \"perspective\"\n    float2 clippingRange = (0.01, 100000)\n",
            list->cameras[0].frame, list->cameras[list->count - 1].frame, fps, fps);
    usd_samples(out, list, "float focalLength", offsetof(film, focal));
    usd_samples(out, list, "float horizontalAperture", offsetof(film, width));
    usd_samples(out, list, "float verticalAperture", offsetof(film, height));
    usd_samples(out, list, "float horizontalApertureOffset", offsetof(film, offset_x));
    usd_samples(out, list, "float verticalApertureOffset", offsetof(film, offset_y));
    bool square = true;
    for (size_t i = 0; i < list->count && square; ++i)
        square = camera_pixel_aspect(&list->cameras[i].camera) == 1;
    if (!square)
        usd_samples(out, list, "custom float sparegs:pixelAspectRatio",
                    offsetof(film, pixel_aspect));
    fputs("    matrix4d xformOp:transform.timeSamples = {\n", out);
    for (size_t i = 0; i < list->count; ++i) { // row vectors: a row is an axis, or the centre
        double a[9], c[3];
        graphics_axes(&list->cameras[i].pose, a);
        sgs_pose_center(&list->cameras[i].pose, c);
        for (int k = 0; k < 3; ++k) { // y-up; without -0
            a[3 + k] = 0 - a[3 + k];
            a[6 + k] = 0 - a[6 + k];
            c[k] = k ? 0 - c[k] : c[k];
        }
        fprintf(out,
                "        %d: ((%.12g, %.12g, %.12g, 0), (%.12g, %.12g, %.12g, 0), "
                "(%.12g, %.12g, %.12g, 0), (%.12g, %.12g, %.12g, 1)),\n",
                list->cameras[i].frame, a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8], c[0],
                c[1], c[2]);
    }
    fputs("    }\n    uniform token[] xformOpOrder = [\"xformOp:transform\"]\n}\n", out);
}

static bool write_with(const char *path, const camera_list *list, double fps,
                       void (*write)(FILE *, const camera_list *, double))
{
    char *text = NULL;
    size_t size;
    FILE *memory = open_memstream(&text, &size);
    if (memory)
        write(memory, list, fps);
    if (!memory || fclose(memory)) {
        free(text);
        fail_run("%s: not enough memory for %zu cameras", path, list->count);
        return false;
    }
    const bool done = write_text(path, text);
    free(text);
    return done;
}

static bool is_distorted(const sgs_camera *camera)
{
    return camera->model != SGS_CAMERA_PINHOLE && camera->model != SGS_CAMERA_SIMPLE_PINHOLE;
}

static void warn_distorted(const char *format, size_t count)
{
    if (count)
        print_warning("cameras in %s have no lens distortion; that of %zu camera(s) is omitted",
                      format, count);
}

static size_t count_distorted(const camera_list *list)
{
    size_t count = 0;
    for (size_t i = 0; i < list->count; ++i)
        count += is_distorted(&list->cameras[i].camera);
    return count;
}

// .chan has no film offset and no pixel aspect ratio.
static void warn_intrinsics(const camera_list *list)
{
    size_t count = 0, oblong = 0;
    for (size_t i = 0; i < list->count; ++i) {
        const sgs_camera *camera = &list->cameras[i].camera;
        double fx, fy, cx, cy;
        sgs_camera_intrinsics(camera, &fx, &fy, &cx, &cy);
        count += fabs(cx - 0.5 * camera->width) > 0.5 || fabs(cy - 0.5 * camera->height) > 0.5;
        oblong += fabs(1 - fy / fx) * 0.5 * camera->width > 0.5;
    }
    if (count)
        print_warning("cameras in chan have the principal point in the image centre; that of %zu "
                      "camera(s) is moved by more than half a pixel",
                      count);
    if (oblong)
        print_warning("cameras in chan have square pixels; the width of the pixels of %zu "
                      "camera(s) is omitted, which moves the image borders by more than half a "
                      "pixel",
                      oblong);
}

bool camera_is_perspective(const sgs_camera *camera)
{
    return !sgs_camera_is_fisheye(camera->model) && camera->model != SGS_CAMERA_EQUIRECTANGULAR;
}

static bool are_perspective(const char *folder, const camera_list *list)
{
    for (size_t i = 0; i < list->count; ++i)
        if (!camera_is_perspective(&list->cameras[i].camera)) {
            fail_run("%s: camera %s is not perspective; .chan and USD hold perspective cameras "
                     "only, use --save-cameras json",
                     folder, list->cameras[i].name);
            return false;
        }
    return true;
}

bool cameras_export(const char *folder, unsigned formats, const camera_list *list, double fps)
{
    if (!list->count ||
        ((formats & (CAMERAS_CHAN | CAMERAS_USDA)) && !are_perspective(folder, list)))
        return !list->count;
    bool done = true;
    for (unsigned format = CAMERAS_JSON; format <= CAMERAS_USDA && done; format <<= 1) {
        if (!(formats & format))
            continue;
        const char *name = format == CAMERAS_JSON   ? "json"
                           : format == CAMERAS_CHAN ? "chan"
                                                    : "usda";
        char *path = format_text("%s/cameras.%s", folder, name);
        if (format != CAMERAS_JSON)
            warn_distorted(name, count_distorted(list));
        if (format == CAMERAS_CHAN)
            warn_intrinsics(list);
        done = format == CAMERAS_JSON
                   ? write_cameras_json(path, list)
                   : write_with(path, list, fps, format == CAMERAS_CHAN ? write_chan : write_usda);
        if (done)
            report_file(path);
        free(path);
    }
    return done;
}

void model_cameras_add(model_cameras *list, const char *name, const sgs_camera *camera,
                       const sgs_pose *pose)
{
    if (!camera_is_perspective(camera)) {
        ++list->omitted;
        list->first_omitted = list->first_omitted || !list->count;
        return;
    }
    sgs_model_camera *out = &list->cameras[list->count++];
    *out = (sgs_model_camera){.name = name, .width = camera->width, .height = camera->height};
    camera_paraxial(camera, &out->fx, &out->fy, &out->cx, &out->cy);
    memcpy(out->rotation, pose->rotation, sizeof out->rotation);
    memcpy(out->translation, pose->translation, sizeof out->translation);
    list->distorted += is_distorted(camera);
}

void model_cameras_warn(const model_cameras *list, sgs_model_format format)
{
    const char *name = sgs_model_format_name(format);
    warn_distorted(name, list->distorted);
    if (list->omitted)
        print_warning("cameras in %s are perspective; %zu camera(s) with a fisheye lens or a "
                      "panorama are omitted%s",
                      name, list->omitted,
                      format != SGS_MODEL_HTML || !list->first_omitted ? ""
                      : list->count ? ", and the page begins with another one"
                                    : ", and the page begins in front of the model");
}
