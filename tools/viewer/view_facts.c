// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/view_facts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cameras/camera_path.h"
#include "cameras/lens_scale.h"
#include "cli/input_file.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "draw/aov_list.h"
#include "draw/colormap.h"
#include "sparegs/runtime.h"

static json_t *numbers_json(const double *values, int count)
{
    json_t *array = json_array();
    for (int k = 0; k < count; ++k)
        json_array_append_new(array, json_real(values[k]));
    return array;
}

// ---- Cameras ----

// Camera to world, row-major, with OpenGL's camera axes, as in a camera path.
static json_t *matrix_json(const sgs_pose *pose)
{
    double center[3], m[16] = {[15] = 1};
    sgs_pose_center(pose, center);
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j)
            m[4 * i + j] = (j ? -1 : 1) * pose->rotation[3 * j + i];
        m[4 * i + 3] = center[i];
    }
    return numbers_json(m, 16);
}

static json_t *view_json(const named_camera *view, bool is_test, bool has_photo)
{
    double fx, fy, cx, cy;
    double axial[4];
    sgs_camera_intrinsics(&view->camera, &fx, &fy, &cx, &cy);
    camera_paraxial(&view->camera, &axial[0], &axial[1], &axial[2], &axial[3]);
    json_t *name = json_string(view->name);
    const double fov = 2 * atan(0.5 * view->camera.height / axial[1]) * 180 / 3.141592653589793;
    const double intrinsics[4] = {fx, fy, cx, cy};
    const char *lens = sgs_camera_model_name(view->camera.model);
    return json_pack("{s:o,s:i,s:i,s:b,s:b,s:o,s:f,s:o,s:b,s:s,s:o}", "name",
                     name ? name : json_string("?"), "width", view->camera.width, "height",
                     view->camera.height, "test", is_test, "photo", has_photo, "camera_to_world",
                     matrix_json(&view->pose), "fov", fov, "intrinsics",
                     numbers_json(intrinsics, 4), "fisheye",
                     sgs_camera_is_fisheye(view->camera.model), "lens", lens ? lens : "?", "params",
                     numbers_json(view->camera.params, sgs_camera_param_count(view->camera.model)));
}

static json_t *views_json(const view_source *source)
{
    json_t *list = json_array();
    for (size_t i = 0; i < source->views.count; ++i) {
        const sgs_view *view = source->scene ? &source->scene->views[i] : NULL;
        json_array_append_new(list, view_json(&source->views.cameras[i],
                                              view && view->split == SGS_SPLIT_TEST, view != NULL));
    }
    return list;
}

// ---- Model and run ----

// 64 colours of the ramp of scalar AOVs, from low to high.
static json_t *ramp_json(void)
{
    enum { STEPS = 64 };
    float values[STEPS];
    for (int i = 0; i < STEPS; ++i)
        values[i] = 1 + (float)i / (STEPS - 1);
    sgs_image8 image;
    json_t *list = json_array();
    if (!plane_colored(values, STEPS, 1, (value_range){1, 2}, &image))
        return list;
    for (int i = 0; i < STEPS; ++i)
        json_array_append_new(list, json_pack("[i,i,i]", image.pixels[i], image.pixels[STEPS + i],
                                              image.pixels[2 * STEPS + i]));
    sgs_image8_free(&image);
    return list;
}

static json_t *aovs_json(bool has_regions)
{
    json_t *list = json_array();
    for (int k = 0; k < AOV_ROWS; ++k)
        if (has_regions || !(1U << k & (AOV_REGION | AOV_SLACK)))
            json_array_append_new(list, json_pack("{s:s,s:b}", "name", aov_words[k], "ramp",
                                                  aov_rows[k].picture == AOV_PICTURE_RAMP));
    return list;
}

// A JSON file of the run's folder; null without one.
static json_t *file_json(const view_source *source, const char *name)
{
    char *path = source->is_run ? format_text("%s/%s", source->folder, name) : NULL;
    json_t *root = path ? load_json(path, 0, NULL) : NULL;
    free(path);
    return root ? root : json_null();
}

json_t *view_facts(view_source *source, bool training)
{
    double center[3], up[3];
    json_t *root = json_object();
    memcpy(center, source->center, sizeof center);
    json_object_set_new(root, "gaussians", json_integer((json_int_t)atomic_load(&source->count)));
    json_object_set_new(root, "iteration", json_integer(atomic_load(&source->iteration)));
    camera_path_up(source->scene, &source->views, up);
    if (source->views.count > 2)
        camera_path_target(&source->views, center);
    json_t *name = json_string(source->name);
    json_object_set_new(root, "type", json_string("hello"));
    json_object_set_new(root, "version", json_string(sgs_version()));
    json_object_set_new(root, "model", name ? name : json_string("model"));
    json_object_set_new(root, "marks", json_string(source->marks ? source->marks : ""));
    json_object_set_new(root, "training", json_boolean(training));
    json_object_set_new(root, "run", json_boolean(source->is_run));
    json_object_set_new(root, "target", numbers_json(center, 3));
    json_object_set_new(root, "extent", json_real(source->extent));
    json_object_set_new(root, "up", numbers_json(up, 3));
    json_object_set_new(root, "aovs",
                        aovs_json(source->expects_regions || view_source_has_regions(source)));
    json_object_set_new(root, "ramp", ramp_json());
    json_object_set_new(root, "views", views_json(source));
    json_object_set_new(root, "config", file_json(source, "config.json"));
    json_object_set_new(root, "summary", file_json(source, "summary.json"));
    return root;
}

// ---- Tables ----

// Splits a line at its commas, in place. Returns the number of fields, at most `most`.
static int split_line(char *line, char **fields, int most)
{
    int count = 0;
    line[strcspn(line, "\r\n")] = 0;
    for (char *at = line; at && count < most; ++count) {
        fields[count] = at;
        at = strchr(at, ',');
        if (at)
            *at++ = 0;
    }
    return count;
}

// A CSV file of numbers as {column: [numbers]}. Incomplete last lines are ignored.
static json_t *table_json(const view_source *source, const char *name)
{
    enum { COLUMNS = 32 };
    char line[4096], head[4096], *columns[COLUMNS], *fields[COLUMNS];
    json_t *table = json_object();
    char *path = format_text("%s/%s", source->folder, name);
    FILE *file = source->is_run ? open_input(path, NULL) : NULL;
    free(path);
    const int count =
        file && fgets(head, sizeof head, file) ? split_line(head, columns, COLUMNS) : 0;
    for (int k = 0; k < count; ++k)
        json_object_set_new(table, columns[k], json_array());
    while (count && fgets(line, sizeof line, file)) {
        if (!strchr(line, '\n') || split_line(line, fields, COLUMNS) != count)
            continue;
        for (int k = 0; k < count; ++k)
            json_array_append_new(json_object_get(table, columns[k]),
                                  json_number(strtod(fields[k], NULL)));
    }
    if (file)
        fclose(file);
    return table;
}

json_t *view_history(const view_source *source)
{
    return json_pack("{s:s,s:o,s:o}", "type", "history", "train", table_json(source, "train.csv"),
                     "spare", table_json(source, "spare.csv"));
}
