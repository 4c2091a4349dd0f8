// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/run_record.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "arguments/model_path.h"
#include "arguments/shared_options.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"

void run_record_split(json_t *config, const sgs_scene *scene)
{
    json_t *list = json_array();
    bool complete = true;
    for (size_t v = 0; v < scene->view_count; ++v)
        if (scene->views[v].split == SGS_SPLIT_TEST)
            complete = !json_array_append_new(list, json_string(scene->views[v].name)) && complete;
    if (complete)
        json_object_set(config, "test_images", list);
    json_decref(list);
}

void run_record_milestones(json_t *config, const sgs_trainer *trainer, const sgs_scene *scene)
{
    const sgs_train_milestones m = sgs_trainer_milestones(trainer);
    json_t *json =
        json_pack("{s:i, s:i, s:i, s:i, s:i, s:i, s:i}", "densify_from", m.densify_from,
                  "densify_until", m.densify_until, "densify_interval", m.densify_interval,
                  "thin_until", m.thin_until, "reset_interval", m.reset_interval, "half_size_until",
                  m.half_size_until, "sh_interval", m.sh_interval);
    json_object_set_new(json, "gradient_factor", json_number(m.gradient_factor));
    json_object_set_new(json, "shape_factor", json_number(m.shape_factor));
    json_object_set_new(json, "sh_factor", json_number(m.sh_factor));
    json_object_set_new(json, "opacity_factor", json_number(m.opacity_factor));
    json_object_set_new(json, "ssim_weight", json_number(m.ssim_weight));
    json_object_set_new(json, "ssim_sigma", json_number(m.ssim_sigma));
    json_object_set_new(json, "optimizer",
                        json_string(m.optimizer == SGS_OPTIMIZER_DENSE ? "dense" : "sparse"));
    json_object_set_new(json, "max_gaussians", json_integer((json_int_t)m.max_gaussians));
    json_object_set_new(json, "image_reduction", json_number(scene->reduction));
    json_object_set_new(config, "milestones", json);
}

bool run_record_split_agrees(const char *config_path, const json_t *config, const sgs_scene *scene)
{
    const json_t *list = json_object_get(config, "test_images");
    for (size_t k = 0; k < json_array_size(list); ++k) {
        const char *name = json_string_value(json_array_get(list, k));
        const ptrdiff_t v = name ? sgs_scene_find_view(scene, name) : -1;
        if (v >= 0 && !strcmp(scene->views[v].name, name))
            continue;
        fail_run("%s: the held-out image '%s' is missing from %s; restore it to resume",
                 config_path, name ? name : "?", scene->path);
        return false;
    }
    return true;
}

// True if the entry of cameras.json has the camera centre of the view.
static bool has_center(const json_t *camera, const sgs_view *view, double tolerance)
{
    double center[3];
    const json_t *position = json_object_get(camera, "position");
    double distance = 0;
    sgs_pose_center(&view->pose, center);
    for (size_t c = 0; c < 3; ++c)
        distance = hypot(distance, json_number_value(json_array_get(position, c)) - center[c]);
    return distance <= tolerance;
}

// The cameras of a run, or NULL.
static json_t *load_cameras(const char *folder)
{
    char *path = format_text("%s/cameras.json", folder);
    json_t *cameras = load_json(path, 0, NULL);
    free(path);
    return cameras;
}

// sgs_scene_find_recorded for the names of a list, which are members of its elements, or the
// elements if `member` is NULL. Release with free(). NULL if out of memory.
static ptrdiff_t *find_views(const sgs_scene *scene, const json_t *list, const char *member)
{
    const size_t count = json_array_size(list);
    const char **names = malloc((count + 1) * sizeof *names);
    ptrdiff_t *views = names ? malloc((count + 1) * sizeof *views) : NULL;
    for (size_t k = 0; views && k < count; ++k) {
        const json_t *element = json_array_get(list, k);
        names[k] = json_string_value(member ? json_object_get(element, member) : element);
    }
    if (views)
        sgs_scene_find_recorded(scene, names, count, views);
    free(names);
    return views;
}

static bool is_center_of_any(const json_t *camera, const sgs_scene *scene, double tolerance)
{
    for (size_t v = 0; v < scene->view_count; ++v)
        if (has_center(camera, &scene->views[v], tolerance))
            return true;
    return false;
}

void run_record_check_scene(const char *folder, const sgs_scene *scene)
{
    json_t *cameras = load_cameras(folder);
    const size_t count = json_array_size(cameras);
    const double tolerance = 1e-4 * scene->extent;
    ptrdiff_t *views = find_views(scene, cameras, "img_name");
    size_t same = 0;
    for (size_t k = 0; views && k < count; ++k) {
        const json_t *camera = json_array_get(cameras, k);
        const char *name = json_string_value(json_object_get(camera, "img_name"));
        if (views[k] >= 0)
            same += has_center(camera, &scene->views[views[k]], tolerance);
        else if (name && strchr(name, '?')) // instead of bytes that are not UTF-8
            same += is_center_of_any(camera, scene, tolerance);
    }
    free(views);
    if (count && 2 * same < scene->view_count)
        print_warning("%s: %zu of %zu cameras match those of the run %s; the scores compare "
                      "different scenes unless the model was transformed",
                      scene->path, same, scene->view_count, folder);
    json_decref(cameras);
}

// Sets used[v] to `value` for the views that the list names.
static bool mark_views(const sgs_scene *scene, const json_t *list, const char *member, bool *used,
                       bool value)
{
    ptrdiff_t *views = find_views(scene, list, member);
    for (size_t k = 0; views && k < json_array_size(list); ++k)
        if (views[k] >= 0)
            used[views[k]] = value;
    const bool done = views != NULL;
    free(views);
    return done;
}

ptrdiff_t run_record_trained(const char *folder, const json_t *config, const sgs_scene *scene,
                             sgs_split split)
{
    json_t *cameras = load_cameras(folder);
    const json_t *held_out = json_object_get(config, "test_images");
    bool *used = calloc(scene->view_count + 1, sizeof *used);
    ptrdiff_t trained = -1;
    if (used && json_array_size(cameras) && json_is_array(held_out) &&
        mark_views(scene, cameras, "img_name", used, true) &&
        mark_views(scene, held_out, NULL, used, false)) {
        trained = 0;
        for (size_t v = 0; v < scene->view_count; ++v)
            trained += view_in_split(&scene->views[v], split) && used[v];
    }
    free(used);
    json_decref(cameras);
    return trained;
}

bool run_record_init_agrees(const char *config_path, const json_t *stored, const json_t *now,
                            bool replaced)
{
    const json_t *before = json_object_get(stored, "init_hash");
    if (replaced || !before || json_equal(before, json_object_get(now, "init_hash")))
        return true;
    fail_run("%s: the model of --init changed since the run started; resume with the same model",
             config_path);
    return false;
}

json_t *run_record_seconds(const sgs_train_seconds *s, double load, double checkpoint)
{
    const struct {
        const char *name;
        double value;
    } phases[] = {
        {"gather", s->gather},       {"forward", s->forward},          {"project", s->project},
        {"loss", s->loss},           {"backward", s->backward},        {"optimizer", s->optimizer},
        {"bvh_refit", s->bvh_refit}, {"bvh_build", s->bvh_build},      {"density", s->density},
        {"spare", s->spare},         {"image_io", load + s->image_io}, {"checkpoint", checkpoint}};
    json_t *seconds = json_object();
    for (size_t i = 0; i < sizeof phases / sizeof *phases; ++i)
        json_object_set_new(seconds, phases[i].name, json_number(phases[i].value));
    return seconds;
}

const char *run_record_stop_reason(sgs_stop_reason stop)
{
    static const char *const reasons[] = {
        [SGS_STOP_NONE] = "schedule",           [SGS_STOP_SCHEDULE] = "schedule",
        [SGS_STOP_EQUILIBRIUM] = "equilibrium", [SGS_STOP_SIGNAL] = "signal",
        [SGS_STOP_TIME_LIMIT] = "time_limit",   [SGS_STOP_MEMORY_LIMIT] = "memory_limit"};
    return reasons[stop];
}

bool run_record_is_complete(const json_t *summary)
{
    const char *reason = json_string_value(json_object_get(summary, "stop_reason"));
    return reason && (!strcmp(reason, "schedule") || !strcmp(reason, "equilibrium"));
}

bool run_record_claim(run_folder *folder, const char *out, bool resume, bool overwrite,
                      json_t **stored)
{
    char *config_path = format_text("%s/config.json", out);
    json_error_t error = {0};
    bool claimed = true;
    if (resume && !file_exists(config_path)) {
        claimed = false; // do not create a folder for a mistyped name
        fail_run("%s: no run to resume: config.json does not exist; check the folder, or omit "
                 "--resume to start",
                 out);
    }
    claimed = claimed && run_folder_prepare(folder, out);
    if (claimed && resume) {
        *stored = load_json(config_path, 0, &error);
        claimed = *stored != NULL;
        if (!claimed) {
            char *fault = json_load_fault(config_path, &error);
            fail_run("%s; the run cannot be resumed, replace it with --overwrite", fault);
            free(fault);
        }
    } else if (claimed) {
        claimed = run_folder_admits(folder, overwrite,
                                    "continue it with --resume, or replace it with --overwrite");
    }
    if (claimed)
        run_folder_clean(folder);
    free(config_path);
    return claimed;
}
