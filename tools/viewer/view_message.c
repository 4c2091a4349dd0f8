// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A camera is one of
//   "view": K                     view K with its own lens and pose
//   "camera_to_world": [16], ...  a frame of a camera path, read by the code that reads the file,
//                                 so that `render --camera` draws the same picture
// with "width" and "height" in pixels, and optionally "lens": K, the lens of view K instead of the
// frame's own. A lens keeps its vertical field of view.

#include "viewer/view_message.h"

#include <jansson.h>
#include <math.h>
#include <string.h>

// An integer from 0 to `most`.
static bool read_index(const json_t *value, double most, uint32_t *index)
{
    const double number = json_number_value(value);
    if (!json_is_number(value) || !(number >= 0 && number <= most) || number != floor(number))
        return false;
    *index = (uint32_t)number;
    return true;
}

static const char *read_size(const json_t *root, int *width, int *height)
{
    uint32_t w, h;
    if (!read_index(json_object_get(root, "width"), VIEW_SIDE, &w) ||
        !read_index(json_object_get(root, "height"), VIEW_SIDE, &h) || !w || !h ||
        (size_t)w * h > VIEW_PIXELS)
        return "width and height are out of range";
    *width = (int)w;
    *height = (int)h;
    return NULL;
}

static sgs_camera lens_for(const sgs_camera *lens, int width, int height)
{
    return lens->width == width && lens->height == height
               ? *lens
               : sgs_camera_reframed(lens, width, height);
}

static const char *read_camera(const json_t *root, const camera_list *views, view_request *request)
{
    int width, height;
    const char *problem = read_size(root, &width, &height);
    if (problem)
        return problem;
    const json_t *view = json_object_get(root, "view"), *lens = json_object_get(root, "lens");
    const double last = (double)views->count - 1;
    uint32_t index;
    if (json_is_number(view)) {
        if (!read_index(view, last, &index))
            return "view is not a view of the scene";
        request->pose = views->cameras[index].pose;
        request->camera = lens_for(&views->cameras[index].camera, width, height);
    } else {
        const char *type = json_string_value(json_object_get(root, "camera_type"));
        problem = camera_path_frame(root, type ? type : "perspective", width, height,
                                    &request->camera, &request->pose);
        if (problem)
            return problem;
    }
    if (json_is_number(lens)) {
        if (!read_index(lens, last, &index))
            return "lens is not a view of the scene";
        request->camera = lens_for(&views->cameras[index].camera, width, height);
    }
    return sgs_camera_validate(&request->camera) ? "the camera is out of range" : NULL;
}

static const char *read_colors(const json_t *root, view_request *request)
{
    const json_t *range = json_object_get(root, "range"), *aov = json_object_get(root, "aov");
    request->aov = AOV_INDEX_RGBA;
    if (json_is_string(aov)) {
        int row = AOV_ROWS - 1;
        while (row >= 0 && strcmp(aov_words[row], json_string_value(aov)) != 0)
            --row;
        if (row < 0)
            return "aov is unknown";
        request->aov = row;
    }
    request->is_log = json_is_true(json_object_get(root, "log"));
    if (json_is_array(range)) {
        const json_t *first = json_array_get(range, 0), *second = json_array_get(range, 1);
        const double low = json_number_value(first), high = json_number_value(second);
        if (!json_is_number(first) || !json_is_number(second) ||
            !(high > low && fabs(low) < 1e30 && fabs(high) < 1e30))
            return "range must be two ascending numbers";
        if (request->is_log && !((float)low > 0))
            return "a logarithmic range must be positive";
        request->range = (value_range){(float)low, (float)high};
    }
    return NULL;
}

static bool numbers_equal(const double *a, const double *b, size_t count)
{
    for (size_t i = 0; i < count; ++i)
        if (!(a[i] == b[i]))
            return false;
    return true;
}

bool view_request_same(const view_request *a, const view_request *b)
{
    return sgs_camera_equal(&a->camera, &b->camera) &&
           numbers_equal(a->pose.rotation, b->pose.rotation, 9) &&
           numbers_equal(a->pose.translation, b->pose.translation, 3) && a->aov == b->aov &&
           a->is_log == b->is_log && a->range.low == b->range.low &&
           a->range.high == b->range.high && a->samples == b->samples &&
           view_crop_equal(&a->crop, &b->crop);
}

bool view_crop_equal(const view_crop *a, const view_crop *b)
{
    return a->preview == b->preview && a->has_box == b->has_box && a->has_sphere == b->has_sphere &&
           a->floaters == b->floaters && a->opacity == b->opacity && a->size == b->size &&
           a->slack == b->slack && a->region == b->region && numbers_equal(a->box, b->box, 6) &&
           numbers_equal(a->sphere, b->sphere, 4);
}

// `count` finite numbers; null is `absent` if that is infinite.
static bool read_limits(const json_t *array, const double *absent, double *values, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        const json_t *value = json_array_get(array, i);
        const bool none = absent && json_is_null(value);
        values[i] = none ? absent[i] : json_number_value(value);
        if (!none && !(json_is_number(value) && fabs(values[i]) < 1e30))
            return false;
    }
    return json_array_size(array) == count;
}

static const char *read_crop(const json_t *crop, view_crop *out)
{
    static const double none[6] = {-INFINITY, -INFINITY, -INFINITY, INFINITY, INFINITY, INFINITY};
    const json_t *box = json_object_get(crop, "box"), *sphere = json_object_get(crop, "sphere");
    const char *preview = json_string_value(json_object_get(crop, "preview"));
    const json_t *slack = json_object_get(crop, "slack"), *region = json_object_get(crop, "region");
    *out = (view_crop){.slack = -INFINITY, .region = -1};
    if (!json_is_object(crop))
        return NULL;
    if (json_is_number(slack))
        out->slack = json_number_value(slack);
    if (json_is_integer(region))
        out->region = json_integer_value(region);
    if (out->region < -1 || out->region > UINT32_MAX)
        return "region is out of range";
    out->has_box = json_is_array(box);
    out->has_sphere = json_is_array(sphere);
    if (out->has_box && !read_limits(box, none, out->box, 6))
        return "box must be six numbers";
    if (out->has_sphere && (!read_limits(sphere, NULL, out->sphere, 4) || out->sphere[3] < 0))
        return "sphere must be a centre and a radius";
    out->opacity = json_number_value(json_object_get(crop, "opacity"));
    out->size = json_number_value(json_object_get(crop, "size"));
    out->floaters = json_is_true(json_object_get(crop, "floaters"));
    if (!(out->opacity >= 0 && out->opacity <= 1 && out->size >= 0 && out->size < 1e30))
        return "opacity or size is out of range";
    out->preview = preview && !strcmp(preview, "mark")   ? CROP_MARK
                   : preview && !strcmp(preview, "hide") ? CROP_HIDE
                                                         : CROP_OFF;
    return NULL;
}

// Colours and crop; wrong ones are not used. Returns NULL, or a description of the error.
static const char *read_looks(const json_t *root, view_request *request)
{
    const char *crop = read_crop(json_object_get(root, "crop"), &request->crop);
    if (crop)
        read_crop(NULL, &request->crop);
    const char *colors = read_colors(root, request);
    return crop ? crop : colors;
}

static const char *read_request(const json_t *root, const camera_list *views, view_message *message)
{
    view_request *request = &message->request;
    uint32_t samples = 1;
    const json_t *given = json_object_get(root, "samples");
    if (given && (!read_index(given, VIEW_SAMPLES, &samples) || !samples))
        return "samples is out of range";
    request->samples = (int)samples;
    request->moving = json_is_true(json_object_get(root, "moving"));
    if (!read_index(json_object_get(root, "serial"), 4294967295.0, &request->serial))
        return "serial must be a number";
    const char *problem = read_camera(root, views, request);
    if (!problem)
        message->refused = read_looks(root, request);
    return problem;
}

static const char *read_pixel(const json_t *root, view_message *message)
{
    uint32_t x, y;
    if (!read_index(json_object_get(root, "x"), VIEW_SIDE - 1, &x) ||
        !read_index(json_object_get(root, "y"), VIEW_SIDE - 1, &y))
        return "x and y must be a pixel";
    message->x = (int)x;
    message->y = (int)y;
    return NULL;
}

static const char *read_action(const json_t *root, run_action *action)
{
    static const char *const words[] = {"pause", "continue", "checkpoint", "stop"};
    const char *word = json_string_value(json_object_get(root, "action"));
    for (int k = 0; word && k < (int)(sizeof words / sizeof *words); ++k)
        if (!strcmp(word, words[k])) {
            *action = (run_action)k;
            return NULL;
        }
    return "action is unknown";
}

static const char *read_members(const json_t *root, const camera_list *views, view_message *message)
{
    static const struct {
        const char *word;
        view_message_type type;
    } types[] = {
        {"camera", MESSAGE_CAMERA}, {"ack", MESSAGE_ACK},       {"probe", MESSAGE_PROBE},
        {"ray", MESSAGE_RAY},       {"region", MESSAGE_REGION}, {"history", MESSAGE_HISTORY},
        {"run", MESSAGE_RUN},       {"exr", MESSAGE_EXR},       {"crop", MESSAGE_CROP}};
    const char *word = json_string_value(json_object_get(root, "type"));
    view_message_type type = MESSAGE_INVALID;
    for (size_t k = 0; word && k < sizeof types / sizeof *types; ++k)
        if (!strcmp(word, types[k].word))
            type = types[k].type;
    const char *problem = NULL;
    switch (type) {
    case MESSAGE_INVALID:
        return "type is unknown";
    case MESSAGE_CAMERA:
        problem = read_request(root, views, message);
        break;
    case MESSAGE_PROBE:
    case MESSAGE_RAY:
        problem = read_pixel(root, message);
        break;
    case MESSAGE_ACK:
    case MESSAGE_REGION:
        if (!read_index(json_object_get(root, "number"), 4294967295.0, &message->number))
            problem = "number is missing";
        break;
    case MESSAGE_RUN:
        problem = read_action(root, &message->action);
        break;
    case MESSAGE_CROP:
        problem = read_crop(json_object_get(root, "crop"), &message->request.crop);
        message->has_crop = json_is_object(json_object_get(root, "crop"));
        break;
    case MESSAGE_HISTORY:
    case MESSAGE_EXR:
        break;
    }
    if (!problem)
        message->type = type;
    return problem;
}

// True if brackets nest deeper than any message. The parser is recursive, and threads of the server
// have small stacks. Brackets within strings do not count: they would hide others. The parser ends
// at a bracket that closes none.
static bool is_deep(const char *text, size_t size)
{
    enum { DEPTH = 8 };
    int depth = 0;
    bool quoted = false;
    for (size_t i = 0; i < size; ++i) {
        if (quoted && text[i] == '\\')
            ++i;
        else if (text[i] == '"')
            quoted = !quoted;
        else if (!quoted)
            depth += (text[i] == '[' || text[i] == '{') - (text[i] == ']' || text[i] == '}');
        if (depth > DEPTH)
            return true;
    }
    return false;
}

const char *view_message_parse(const char *text, size_t size, const camera_list *views,
                               view_message *message)
{
    *message = (view_message){0};
    if (size > MESSAGE_BYTES)
        return "the message is too long";
    if (is_deep(text, size))
        return "the message is nested too deeply";
    json_t *root = json_loadb(text, size, 0, NULL);
    const char *problem =
        json_is_object(root) ? read_members(root, views, message) : "not a JSON object";
    json_decref(root);
    return problem;
}
