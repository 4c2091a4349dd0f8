// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Messages of the viewer's page: what a camera becomes, and hostile texts.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "viewer/view_message.h"

static named_camera cameras[1] = {
    {.name = (char *)"a.png",
     .camera = {SGS_CAMERA_OPENCV, 64, 48, {50, 51, 32, 24, 0.1, 0.01, 0.001, 0.002}},
     .pose = {{0, 1, 0, -1, 0, 0, 0, 0, 1}, {0.1, 0.2, 0.3}}}};
static const camera_list views = {.cameras = cameras, .count = 1};

static const char *parse(const char *text, view_message *message)
{
    return view_message_parse(text, strlen(text), &views, message);
}

static void a_view_is_its_camera_bit_for_bit(void **state)
{
    (void)state;
    view_message message;
    assert_null(parse("{\"type\":\"camera\",\"serial\":7,\"width\":64,\"height\":48,\"view\":0}",
                      &message));
    assert_int_equal(message.type, MESSAGE_CAMERA);
    assert_int_equal(message.request.serial, 7);
    assert_memory_equal(&message.request.camera, &cameras[0].camera, sizeof(sgs_camera));
    assert_memory_equal(&message.request.pose, &cameras[0].pose, sizeof(sgs_pose));
    assert_int_equal(message.request.samples, 1);
    assert_int_equal(message.request.aov, AOV_INDEX_RGBA);
    assert_false(message.request.moving);
}

static void a_free_camera_is_that_of_a_camera_path(void **state)
{
    (void)state;
    view_message message;
    assert_null(
        parse("{\"type\":\"camera\",\"serial\":1,\"width\":100,\"height\":50,\"moving\":true,"
              "\"camera_to_world\":[1,0,0,3,0,1,0,4,0,0,1,5,0,0,0,1],\"fov\":90,"
              "\"aov\":\"depth\",\"range\":[1,2],\"log\":true,\"samples\":16}",
              &message));
    const view_request *request = &message.request;
    assert_int_equal(request->camera.model, SGS_CAMERA_PINHOLE);
    assert_true(fabs(request->camera.params[0] - 25) < 1e-12); // half the height for 90 degrees
    double center[3];
    sgs_pose_center(&request->pose, center);
    assert_true(center[0] == 3 && center[1] == 4 && center[2] == 5);
    assert_true(request->pose.rotation[8] == -1); // the camera looks along -z
    assert_true(request->moving && request->is_log && request->samples == 16);
    assert_int_equal(request->aov, AOV_INDEX_DEPTH);
    assert_true(request->range.low == 1 && request->range.high == 2);
}

static void a_lens_of_a_view_keeps_its_vertical_field_of_view(void **state)
{
    (void)state;
    view_message message;
    assert_null(parse("{\"type\":\"camera\",\"serial\":1,\"width\":200,\"height\":96,\"lens\":0,"
                      "\"camera_to_world\":[1,0,0,3,0,1,0,4,0,0,1,5,0,0,0,1],\"fov\":90}",
                      &message));
    assert_int_equal(message.request.camera.model, SGS_CAMERA_OPENCV);
    assert_true(message.request.camera.params[1] == 2 * 51.0);
}

static void a_crop_has_the_limits_of_the_message(void **state)
{
    (void)state;
    view_message message;
    assert_null(parse("{\"type\":\"camera\",\"serial\":1,\"width\":64,\"height\":48,\"view\":0,"
                      "\"crop\":{\"preview\":\"hide\",\"box\":[null,1,2,3,null,5],"
                      "\"sphere\":[1,2,3,4],\"opacity\":0.25,\"size\":2,\"floaters\":true}}",
                      &message));
    const view_crop *crop = &message.request.crop;
    assert_int_equal(crop->preview, CROP_HIDE);
    assert_true(crop->has_box && crop->has_sphere && crop->floaters);
    assert_true(crop->box[0] == -INFINITY && crop->box[1] == 1 && crop->box[4] == INFINITY);
    assert_true(crop->sphere[3] == 4 && crop->opacity == 0.25 && crop->size == 2);
    view_crop other = *crop;
    assert_true(view_crop_equal(crop, &other));
    other.box[5] = 6;
    assert_false(view_crop_equal(crop, &other));
    assert_null(parse("{\"type\":\"crop\",\"crop\":{\"opacity\":0.5}}", &message));
    assert_true(message.has_crop && crop->opacity == 0.5 && crop->slack == -INFINITY);
    assert_null(parse("{\"type\":\"crop\"}", &message));
    assert_false(message.has_crop);
}

static void every_wrong_message_is_refused(void **state)
{
    (void)state;
#define CAMERA(rest) "{\"type\":\"camera\",\"serial\":1," rest "}"
#define POSE "\"camera_to_world\":[1,0,0,3,0,1,0,4,0,0,1,5,0,0,0,1],\"fov\":90"
    static const char *const texts[] = {
        "",
        "{",
        "[]",
        "null",
        "1",
        "\"camera\"",
        "{}",
        "{\"type\":1}",
        "{\"type\":\"\"}",
        "{\"type\":\"shutdown\"}",
        "{\"type\":\"run\"}",
        "{\"type\":\"run\",\"action\":\"rm\"}",
        "{\"type\":\"probe\"}",
        "{\"type\":\"probe\",\"x\":-1,\"y\":0}",
        "{\"type\":\"probe\",\"x\":0.5,\"y\":0}",
        "{\"type\":\"probe\",\"x\":1e300,\"y\":0}",
        "{\"type\":\"ray\",\"x\":\"1\",\"y\":0}",
        "{\"type\":\"ack\"}",
        "{\"type\":\"region\",\"number\":4294967296}",
        "{\"type\":\"ack\",\"number\":-1}",
        "{\"type\":\"crop\",\"crop\":{\"opacity\":2}}",
        CAMERA("\"width\":0,\"height\":10,\"view\":0"),
        CAMERA("\"width\":8193,\"height\":10,\"view\":0"),
        CAMERA("\"width\":8192,\"height\":8192,\"view\":0"),
        CAMERA("\"width\":10,\"height\":10"),
        CAMERA("\"width\":10,\"height\":10,\"view\":1"),
        CAMERA("\"width\":10,\"height\":10,\"view\":-1"),
        CAMERA("\"width\":10,\"height\":10,\"lens\":3," POSE),
        CAMERA("\"width\":10,\"height\":10,\"view\":0,\"samples\":0"),
        CAMERA("\"width\":10,\"height\":10,\"view\":0,\"samples\":65"),
        "{\"type\":\"crop\",\"crop\":{\"box\":[1,2,3,4,5]}}",
        CAMERA("\"width\":10,\"height\":10,\"camera_to_world\":[1],\"fov\":9"),
        CAMERA("\"width\":10,\"height\":10,\"camera_to_world\":[2,0,0,3,0,1,0,4,0,0,1,5,0,0,0,1],"
               "\"fov\":9"),
        CAMERA("\"width\":10,\"height\":10,\"camera_to_world\":[1,0,0,1e999,0,1,0,4,0,0,1,5,0,0,0,"
               "1],\"fov\":9"),
        CAMERA("\"width\":10,\"height\":10,\"camera_to_world\":[1,0,0,3,0,1,0,4,0,0,1,5,0,0,0,1]"),
        CAMERA("\"width\":10,\"height\":10,\"camera_type\":\"x\"," POSE),
        "{\"type\":\"camera\",\"width\":10,\"height\":10,\"view\":0}",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; ++i) {
        view_message message;
        const char *problem = parse(texts[i], &message);
        if (!problem || !*problem || message.type != MESSAGE_INVALID)
            fail_msg("accepted: %s", texts[i]);
    }
}

// The camera is drawn with the measured range, or the whole model.
static void wrong_colours_or_crops_leave_the_camera(void **state)
{
    (void)state;
#define SHOWN(rest) CAMERA("\"width\":10,\"height\":10,\"view\":0," rest)
    static const char *const texts[] = {
        SHOWN("\"range\":[2,1]"),
        SHOWN("\"range\":[\"a\",3]"),
        SHOWN("\"range\":[-1,1],\"log\":true"),
        SHOWN("\"range\":[0,5],\"log\":true"),
        SHOWN("\"range\":[1e-50,5],\"log\":true"), // 0 as a float
        SHOWN("\"aov\":\"secret\""),
        SHOWN("\"crop\":{\"preview\":\"hide\",\"box\":[1,2,3,4,5]}"),
        SHOWN("\"crop\":{\"preview\":\"hide\",\"box\":[1,2,3,4,5,\"6\"]}"),
        SHOWN("\"crop\":{\"preview\":\"hide\",\"sphere\":[1,2,3,-4]}"),
        SHOWN("\"crop\":{\"preview\":\"hide\",\"sphere\":[1,2,3,null]}"),
        SHOWN("\"crop\":{\"preview\":\"hide\",\"opacity\":2}"),
        SHOWN("\"crop\":{\"preview\":\"hide\",\"size\":-1}"),
        SHOWN("\"crop\":{\"preview\":\"hide\",\"region\":4294967296}"),
    };
    view_message message, plain;
    assert_null(parse(SHOWN("\"samples\":1"), &plain));
    assert_null(plain.refused);
    for (size_t i = 0; i < sizeof texts / sizeof *texts; ++i) {
        const char *problem = parse(texts[i], &message);
        if (problem || !message.refused || !*message.refused || message.type != MESSAGE_CAMERA)
            fail_msg("not drawn: %s", texts[i]);
        message.request.is_log = false;
        if (!view_request_same(&message.request, &plain.request))
            fail_msg("drawn with wrong values: %s", texts[i]);
    }
    // One is refused, the other is used.
    assert_null(
        parse(SHOWN("\"range\":[2,1],\"crop\":{\"preview\":\"hide\",\"opacity\":0.5}"), &message));
    assert_true(message.request.crop.preview == CROP_HIDE && message.request.crop.opacity == 0.5);
    assert_null(
        parse(SHOWN("\"aov\":\"depth\",\"range\":[1,2],\"crop\":{\"opacity\":2}"), &message));
    assert_int_equal(message.request.aov, AOV_INDEX_DEPTH);
    assert_true(message.request.range.low == 1 && message.request.range.high == 2);
}

static void long_and_deep_messages_are_not_parsed(void **state)
{
    (void)state;
    const size_t size = MESSAGE_BYTES;
    char *text = malloc(size + 1);
    view_message message;
    assert_non_null(text);
    memset(text, '[', size + 1);
    assert_string_equal(view_message_parse(text, size, &views, &message),
                        "the message is nested too deeply");
    assert_string_equal(view_message_parse(text, size + 1, &views, &message),
                        "the message is too long");
    // Brackets within strings hide none: { "a":"]]..", "b":[[.. } and an escaped quote.
    for (int escaped = 0; escaped < 2; ++escaped) {
        snprintf(text, size, "{\"%s", escaped ? "\\\"" : "");
        const size_t begin = strlen(text);
        memset(text + begin, ']', 3000);
        snprintf(text + begin + 3000, size - begin - 3000, "\":");
        const size_t end = strlen(text);
        memset(text + end, '[', 1500);
        memset(text + end + 1500, ']', 1500);
        text[end + 3000] = '}';
        assert_string_equal(view_message_parse(text, end + 3001, &views, &message),
                            "the message is nested too deeply");
    }
    assert_string_equal(parse("{\"type\":\"[[[[[[[[[[\"}", &message), "type is unknown");
    free(text);
}

// Every prefix of a message, and every single changed byte, is refused or gives a valid camera.
static void damaged_messages_are_refused_or_valid(void **state)
{
    (void)state;
    static const char text[] =
        CAMERA("\"width\":10,\"height\":10,\"aov\":\"hits\",\"range\":[1,2]," POSE);
    view_message message;
    for (size_t i = 0; i + 1 < sizeof text - 1; ++i)
        assert_non_null(view_message_parse(text, i, &views, &message));
    for (size_t i = 0; i < sizeof text - 1; ++i)
        for (int byte = 0; byte < 256; ++byte) {
            char copy[sizeof text];
            memcpy(copy, text, sizeof text);
            copy[i] = (char)byte;
            const char *problem = view_message_parse(copy, sizeof text - 1, &views, &message);
            assert_true((problem == NULL) == (message.type != MESSAGE_INVALID));
            if (message.type == MESSAGE_CAMERA)
                assert_false(sgs_camera_validate(&message.request.camera));
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_view_is_its_camera_bit_for_bit),
        cmocka_unit_test(a_free_camera_is_that_of_a_camera_path),
        cmocka_unit_test(a_lens_of_a_view_keeps_its_vertical_field_of_view),
        cmocka_unit_test(a_crop_has_the_limits_of_the_message),
        cmocka_unit_test(every_wrong_message_is_refused),
        cmocka_unit_test(wrong_colours_or_crops_leave_the_camera),
        cmocka_unit_test(long_and_deep_messages_are_not_parsed),
        cmocka_unit_test(damaged_messages_are_refused_or_valid),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
