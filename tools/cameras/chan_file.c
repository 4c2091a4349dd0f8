// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The inverse of camera_export.c: camera to world = R_y R_x R_z with the axes x right, y up, z
// backwards; camera y and z change sign.

#include "cameras/chan_file.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/input_file.h"
#include "cli/output.h"
#include "cli/progress.h"

enum { FRAME, POSITION, ANGLES = 4, FIELD_OF_VIEW = 7, COLUMNS = 8, MAX_FRAME = 1000000 };

bool chan_file_is(const char *path)
{
    return name_has_ending(path, ".chan");
}

// Returns the number of finite numbers in the line, of which the first COLUMNS are stored; -1 if it
// has anything else.
static int read_columns(const char *line, double columns[COLUMNS])
{
    int count = 0;
    for (const char *at = line + strspn(line, " \t\r\n"); *at; at += strspn(at, " \t\r\n")) {
        char *end;
        const double value = strtod(at, &end);
        if (end == at || !isfinite(value) || !strchr(" \t\r\n", *end))
            return -1;
        if (count < COLUMNS)
            columns[count] = value;
        ++count;
        at = end;
    }
    return count;
}

// False if the translation is out of range.
static bool read_pose(const double columns[COLUMNS], sgs_pose *pose)
{
    const double degree = acos(-1) / 180, x = columns[ANGLES] * degree,
                 y = columns[ANGLES + 1] * degree, z = columns[ANGLES + 2] * degree;
    // R_y R_x R_z, with the signs of camera y and z changed.
    const double rotation[9] = {cos(y) * cos(z) + sin(y) * sin(x) * sin(z),
                                cos(y) * sin(z) - sin(y) * sin(x) * cos(z),
                                -sin(y) * cos(x),
                                cos(x) * sin(z),
                                -cos(x) * cos(z),
                                sin(x),
                                -sin(y) * cos(z) + cos(y) * sin(x) * sin(z),
                                -sin(y) * sin(z) - cos(y) * sin(x) * cos(z),
                                -cos(y) * cos(x)};
    return !sgs_pose_from_axes(rotation, columns + POSITION, pose);
}

// Returns NULL, or a description of the error.
static const char *read_camera(const char *line, int width, int height, named_camera *camera)
{
    double columns[COLUMNS];
    const int count = read_columns(line, columns);
    if (count == FIELD_OF_VIEW)
        return "has no field of view; export it with the camera";
    if (count != COLUMNS)
        return "must be eight numbers: frame, translation, rotation and vertical field of view";
    if (!(fabs(columns[FRAME]) <= MAX_FRAME) || columns[FRAME] != floor(columns[FRAME]))
        return "must begin with a frame number from -1000000 to 1000000";
    if (!(columns[FIELD_OF_VIEW] > 0 && columns[FIELD_OF_VIEW] < 179))
        return "must end with a field of view between 0 and 179 degrees";
    camera->camera = camera_pinhole(width, height, columns[FIELD_OF_VIEW]);
    if (!read_pose(columns, &camera->pose))
        return "has a translation that is out of range";
    if (sgs_camera_validate(&camera->camera))
        return sgs_last_error();
    camera->frame = (int)columns[FRAME];
    camera->name = format_text("frame_%05d", camera->frame);
    return NULL;
}

// Makes room for one more camera.
static bool grow(camera_list *list, size_t *capacity)
{
    if (list->count < *capacity)
        return true;
    const size_t wanted = 2 * *capacity + 16;
    named_camera *cameras = realloc(list->cameras, wanted * sizeof *cameras);
    if (!cameras)
        return false;
    list->cameras = cameras;
    *capacity = wanted;
    return true;
}

static bool read_lines(const char *path, FILE *file, int width, int height, camera_list *list)
{
    char line[512];
    size_t capacity = 0, number = 0;
    bool done = true;
    while (done && fgets(line, sizeof line, file)) {
        ++number;
        const char *text = line + strspn(line, " \t\r\n");
        if (!*text || *text == '#')
            continue;
        named_camera camera = {0};
        const char *problem = strlen(line) == sizeof line - 1
                                  ? "is too long for a line of eight numbers"
                                  : read_camera(text, width, height, &camera);
        if (!problem && !grow(list, &capacity)) {
            named_camera_free(&camera);
            problem = "not enough memory for the camera";
        }
        if (problem) {
            fail_run("%s: line %zu: %s", path, number, problem);
            done = false;
        } else {
            list->cameras[list->count++] = camera;
        }
    }
    if (done && ferror(file)) {
        fail_run("%s: cannot be read", path);
        done = false;
    }
    return done;
}

static int compare_frames(const void *a, const void *b)
{
    const int x = ((const named_camera *)a)->frame, y = ((const named_camera *)b)->frame;
    return (x > y) - (x < y);
}

// Sorts the cameras by frame: videos show them in this order. False after printing the error.
static bool sort_frames(const char *path, camera_list *list)
{
    const named_camera *cameras = list->cameras;
    qsort(list->cameras, list->count, sizeof *list->cameras, compare_frames);
    for (size_t i = 1; i < list->count; ++i)
        if (cameras[i].frame == cameras[i - 1].frame) {
            fail_run("%s: contains frame %d more than once", path, cameras[i].frame);
            return false;
        }
    return true;
}

bool chan_file_read(const char *path, int width, int height, camera_list *list)
{
    *list = (camera_list){.has_frames = true};
    if (width < 1) {
        fail_run("%s: a .chan file has no image size; give it with --size", path);
        return false;
    }
    FILE *file = fopen(path, "r");
    if (!file) {
        fail_run("%s: %s", path, strerror(errno));
        return false;
    }
    bool done = read_lines(path, file, width, height, list);
    fclose(file);
    if (done && !list->count) {
        fail_run("%s: contains no cameras", path);
        done = false;
    }
    done = done && sort_frames(path, list);
    if (!done)
        camera_list_free(list);
    return done;
}
