// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs info`: describes a model or a data set. The description is built as JSON and, without
// --json, printed as indented text, so the two cannot disagree.

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "arguments/model_path.h"
#include "arguments/model_reader.h"
#include "arguments/shared_options.h"
#include "cli/commands.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "cli/value_order.h"
#include "sparegs/model_file.h"

static const char description[] =
    "Describes MODEL (a model file, or a run folder, whose latest iteration is used) or SCENE (a "
    "data set): counts, bounds, quantiles of scales and opacities, camera models, image sizes, "
    "split, warnings.";

// {"minimum":…, "1%":…, "median":…, "99%":…, "maximum":…}; sorts the values.
static json_t *quantiles(double *values, size_t count)
{
    static const struct {
        const char *name;
        double share;
    } rows[] = {{"minimum", 0}, {"1%", 0.01}, {"median", 0.5}, {"99%", 0.99}, {"maximum", 1}};
    json_t *object = json_object();
    qsort(values, count, sizeof *values, compare_doubles);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; ++i)
        json_object_set_new(
            object, rows[i].name,
            count ? json_number(values[(size_t)(rows[i].share * (double)(count - 1) + 0.5)])
                  : json_null());
    return object;
}

static json_t *numbers(const double *values, size_t count)
{
    json_t *list = json_array();
    for (size_t i = 0; i < count; ++i)
        json_array_append_new(list, json_number(values[i]));
    return list;
}

// null without points.
static json_t *bounds(const double low[3], const double high[3])
{
    if (low[0] > high[0])
        return json_null();
    json_t *object = json_object();
    json_object_set_new(object, "low", numbers(low, 3));
    json_object_set_new(object, "high", numbers(high, 3));
    return object;
}

static void widen(double low[3], double high[3], const float point[3])
{
    for (int k = 0; k < 3; ++k) {
        low[k] = fmin(low[k], (double)point[k]);
        high[k] = fmax(high[k], (double)point[k]);
    }
}

static void warnings_into(json_t *root)
{
    json_t *list = json_array();
    for (size_t k = 0; k < warning_count(); ++k)
        json_array_append_new(list, json_message(warning_text(k), strlen(warning_text(k))));
    json_object_set_new(root, "warnings", list);
}

// ---- A model ----

static bool describe_gaussians(const sgs_gaussians *model, json_t *root)
{
    double *values = malloc((3 * model->count + 1) * sizeof *values);
    if (!values) {
        fail_run("not enough memory to describe %zu primitives", model->count);
        return false;
    }
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t i = 0; i < model->count; ++i) {
        float mean[3];
        for (int k = 0; k < 3; ++k) {
            mean[k] = *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
            values[3 * i + (size_t)k] =
                exp((double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k));
        }
        widen(low, high, mean);
    }
    char hash[17];
    sgs_gaussians_hash(model, hash);
    json_object_set_new(root, "gaussians", json_integer((json_int_t)model->count));
    json_object_set_new(root, "sh_degree", json_integer(model->sh_degree));
    json_object_set_new(root, "bounds", bounds(low, high));
    json_object_set_new(root, "scale", quantiles(values, 3 * model->count));
    for (size_t i = 0; i < model->count; ++i)
        values[i] = 1 / (1 + exp(-(double)*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY)));
    json_object_set_new(root, "opacity", quantiles(values, model->count));
    json_object_set_new(root, "model_hash", json_string(hash));
    free(values);
    return true;
}

static bool describe_model(const char *path, json_t *root)
{
    model_path located;
    if (!model_locate(path, &located))
        return false;
    sgs_gaussians *model = NULL;
    sgs_model_info info;
    bool done = !model_reader_read(located.ply_path, NULL, &model, &info);
    if (!done)
        fail_library();
    json_object_set_new(root, "type", json_string("model"));
    json_object_set_new(root, "file", json_string_nocheck(located.ply_path));
    if (done) {
        json_object_set_new(root, "format",
                            json_string(model_reader_format(located.ply_path, &info)));
        if (info.version)
            json_object_set_new(root, "version", json_integer(info.version));
        json_object_set_new(root, "antialiased", json_boolean(info.antialiased));
        if (info.colors.space_known)
            json_object_set_new(
                root, "train_space",
                json_string(info.colors.space == SGS_SPACE_LINEAR ? "linear" : "srgb"));
        if (info.colors.white_point > 0)
            json_object_set_new(root, "white", json_number(info.colors.white_point));
        if (info.lod_count > 1)
            json_object_set_new(root, "levels_of_detail", json_integer(info.lod_count));
    }
    if (located.iteration)
        json_object_set_new(root, "iteration", json_integer(located.iteration));
    if (located.config) {
        json_object_set(root, "scene", json_object_get(located.config, "scene"));
        json_object_set(root, "options", json_object_get(located.config, "options"));
    }
    done = done && describe_gaussians(model, root);
    sgs_gaussians_destroy(model);
    model_path_free(&located);
    return done;
}

// ---- A data set ----

// Each distinct camera once, with its number of views.
static json_t *describe_cameras(const sgs_scene *scene)
{
    json_t *list = json_array();
    for (size_t v = 0; v < scene->view_count; ++v) {
        const sgs_camera *camera = &scene->views[v].camera;
        const char *name = sgs_camera_model_name(camera->model);
        json_t *params = numbers(camera->params, (size_t)sgs_camera_param_count(camera->model)),
               *found = NULL, *entry;
        size_t k;
        json_array_foreach(list, k, entry)
        {
            if (json_integer_value(json_object_get(entry, "width")) == camera->width &&
                json_integer_value(json_object_get(entry, "height")) == camera->height &&
                !strcmp(json_string_value(json_object_get(entry, "model")), name) &&
                json_equal(json_object_get(entry, "params"), params))
                found = entry;
        }
        if (found) {
            json_t *views = json_object_get(found, "views");
            json_integer_set(views, json_integer_value(views) + 1);
            json_decref(params);
            continue;
        }
        entry = json_object();
        json_object_set_new(entry, "model", json_string(name));
        json_object_set_new(entry, "width", json_integer(camera->width));
        json_object_set_new(entry, "height", json_integer(camera->height));
        json_object_set_new(entry, "params", params);
        json_object_set_new(entry, "views", json_integer(1));
        json_array_append_new(list, entry);
    }
    return list;
}

// The parts of a text that ", " separates. NULL: none.
static json_t *words(const char *text)
{
    json_t *list = json_array();
    while (text && *text) {
        const char *comma = strstr(text, ", ");
        const size_t length = comma ? (size_t)(comma - text) : strlen(text);
        json_array_append_new(list, json_message(text, length));
        text += length + (comma ? 2 : 0);
    }
    return list;
}

static bool describe_scene(const char *path, const scene_values *data, json_t *root)
{
    static const char *const formats[] = {[SGS_SCENE_COLMAP_BINARY] = "COLMAP, binary",
                                          [SGS_SCENE_COLMAP_TEXT] = "COLMAP, text",
                                          [SGS_SCENE_TRANSFORMS] = "transforms (NeRF, nerfstudio)",
                                          [SGS_SCENE_MEMORY] = "memory"};
    sgs_scene *scene = scene_open(path, data, false);
    if (!scene)
        return false;
    const size_t test = scene_split_count(scene, SGS_SPLIT_TEST);
    json_object_set_new(root, "type", json_string("scene"));
    json_object_set_new(root, "format", json_string(formats[scene->format]));
    json_object_set_new(root, "file", json_string_nocheck(scene->model_path));
    json_object_set_new(root, "views", json_integer((json_int_t)scene->view_count));
    json_object_set_new(root, "training_views",
                        json_integer((json_int_t)(scene->view_count - test)));
    json_object_set_new(root, "test_views", json_integer((json_int_t)test));
    json_object_set_new(root, "images_missing", json_integer((json_int_t)scene->images_missing));
    json_object_set_new(root, "images_unposed", json_integer((json_int_t)scene->images_unposed));
    json_object_set_new(root, "has_alpha", json_boolean(scene->has_alpha));
    json_object_set_new(root, "masks", json_integer((json_int_t)scene->masks));
    json_object_set_new(root, "linear_images", json_integer((json_int_t)scene->linear_images));
    json_object_set_new(root, "color_spaces", words(scene->color_spaces));
    json_object_set_new(root, "cameras", describe_cameras(scene));
    json_object_set_new(root, "center", numbers(scene->center, 3));
    json_object_set_new(root, "extent", json_number(scene->extent));
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t i = 0; i < scene->point_count; ++i)
        widen(low, high, scene->points + 3 * i);
    json_object_set_new(root, "points", json_integer((json_int_t)scene->point_count));
    json_object_set_new(root, "bounds", bounds(low, high));
    sgs_scene_destroy(scene);
    return true;
}

// ---- As text ----

// The distinct cameras of the scene grouped by model and size: one camera with its parameters, or
// several with their number and the range of each parameter.
static json_t *group_cameras(const json_t *cameras)
{
    json_t *groups = json_array(), *camera;
    size_t c;
    json_array_foreach(cameras, c, camera)
    {
        json_t *group = NULL, *entry;
        size_t g;
        json_array_foreach(groups, g, entry)
        {
            if (json_equal(json_object_get(entry, "model"), json_object_get(camera, "model")) &&
                json_equal(json_object_get(entry, "width"), json_object_get(camera, "width")) &&
                json_equal(json_object_get(entry, "height"), json_object_get(camera, "height")))
                group = entry;
        }
        if (!group) {
            json_array_append_new(groups, json_deep_copy(camera));
            continue;
        }
        const json_t *params = json_object_get(camera, "params");
        if (!json_object_get(group, "cameras")) {
            json_t *first = json_incref(json_object_get(group, "params"));
            json_object_del(group, "params");
            json_object_set_new(group, "cameras", json_integer(1));
            json_object_set_new(group, "params_minimum", json_deep_copy(first));
            json_object_set_new(group, "params_maximum", json_deep_copy(first));
            json_decref(first);
        }
        json_t *count = json_object_get(group, "cameras"), *views = json_object_get(group, "views");
        json_integer_set(count, json_integer_value(count) + 1);
        json_integer_set(views, json_integer_value(views) +
                                    json_integer_value(json_object_get(camera, "views")));
        for (size_t k = 0; k < json_array_size(params); ++k) {
            const double value = json_number_value(json_array_get(params, k));
            json_t *low = json_array_get(json_object_get(group, "params_minimum"), k),
                   *high = json_array_get(json_object_get(group, "params_maximum"), k);
            json_real_set(low, fmin(json_real_value(low), value));
            json_real_set(high, fmax(json_real_value(high), value));
        }
    }
    return groups;
}

static void print_value(const json_t *value)
{
    if (json_is_real(value)) {
        printf("%.6g", json_real_value(value));
    } else if (json_is_string(value)) {
        fputs(json_string_value(value), stdout);
    } else if (json_is_null(value)) {
        fputs("none", stdout);
    } else if (json_is_array(value)) {
        for (size_t i = 0; i < json_array_size(value); ++i) {
            fputs(!i ? "" : json_is_string(json_array_get(value, i)) ? ", " : " ", stdout);
            print_value(json_array_get(value, i));
        }
    } else {
        char *text = json_dumps(value, JSON_ENCODE_ANY);
        fputs(text ? text : "", stdout);
        free(text);
    }
}

static void print_members(json_t *object, int indent)
{
    const char *key;
    json_t *value;
    json_object_foreach(object, key, value)
    {
        if (json_is_array(value) && !json_array_size(value))
            continue;
        const bool list = json_is_array(value) && json_is_object(json_array_get(value, 0));
        printf("%*s%s:", indent, "", key);
        if (json_is_object(value) || list) {
            putchar('\n');
            for (size_t i = 0; i < (list ? json_array_size(value) : 1); ++i)
                print_members(list ? json_array_get(value, i) : value, indent + 2);
        } else if (!strcmp(key, "warnings")) {
            for (size_t i = 0; i < json_array_size(value); ++i)
                printf("\n%*s%s", indent + 2, "", json_string_value(json_array_get(value, i)));
            putchar('\n');
        } else {
            putchar(' ');
            print_value(value);
            putchar('\n');
        }
    }
}

// A file is a model, unless it is a scene's transforms.json.
static bool is_model(const char *path)
{
    struct stat info;
    const char *extension = strrchr(path, '.');
    return model_is(path) || (!stat(path, &info) && S_ISREG(info.st_mode) &&
                              !(extension && !strcasecmp(extension, ".json")));
}

// A run folder without a model, which is not a scene either.
static bool is_unsaved_run(const char *path)
{
    static const char *const scene_parts[] = {"sparse",          "colmap",
                                              "cameras.bin",     "cameras.txt",
                                              "transforms.json", "transforms_train.json"};
    for (size_t i = 0; i < sizeof scene_parts / sizeof *scene_parts; ++i) {
        char *part = format_text("%s/%s", path, scene_parts[i]);
        const bool present = file_exists(part);
        free(part);
        if (present)
            return false;
    }
    char *record = format_text("%s/config.json", path);
    json_t *config = json_load_file(record, 0, NULL);
    const bool run = json_is_object(json_object_get(config, "options"));
    json_decref(config);
    free(record);
    return run;
}

int command_info(int argc, char **argv)
{
    command_call call;
    scene_values data;
    const command_spec spec = {.name = "info",
                               .synopsis = "MODEL|SCENE [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 1,
                               .scene = &data};
    int status = command_parse(&spec, argc, argv, &call);
    if (status < 0)
        status = scene_resolve(&data, &call.line, NULL);
    if (status < 0)
        status = common_apply(&call.common, &call.line);
    if (status >= 0)
        return status;
    const char *path = call.line.operands[0];
    if (!file_exists(path))
        return fail_run("%s: no such file or folder; specify a model file, a run folder or a data "
                        "set",
                        path);
    if (!is_model(path) && is_unsaved_run(path))
        return fail_run("%s: is a run without a saved model yet; wait for its first save", path);
    if (model_is(path))
        warn_idle(&call.line, "images|masks|input-colorspace|downscale|eval|test-every|test-images",
                  "on a model");
    warn_idle(&call.line, "invert-masks|alpha|image-cache|train-space|white",
              "on info, which reads no photos");
    json_t *root = json_object();
    const bool done =
        is_model(path) ? describe_model(path, root) : describe_scene(path, &data, root);
    if (!done) {
        json_decref(root);
        return EXIT_FAILED;
    }
    warnings_into(root);
    if (call.common.json) {
        const char *file = json_string_value(json_object_get(root, "file"));
        json_object_set_new(root, "file", json_text(file)); // as text the path is printed as it is
        return print_json(root) ? EXIT_DONE : EXIT_FAILED;
    }
    if (json_object_get(root, "cameras"))
        json_object_set_new(root, "cameras", group_cameras(json_object_get(root, "cameras")));
    print_members(root, 0);
    json_decref(root);
    return EXIT_DONE;
}
