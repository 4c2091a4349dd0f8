// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Structs of options of programs that are older or newer than the library: the defaults fill the
// caller's struct and nothing past it.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/sparegs.h"

#define OPTIONS(X)                                                                                 \
    X(block)                                                                                       \
    X(compress)                                                                                    \
    X(deep)                                                                                        \
    X(finetune)                                                                                    \
    X(model_read)                                                                                  \
    X(model_write)                                                                                 \
    X(profile)                                                                                     \
    X(prune)                                                                                       \
    X(render)                                                                                      \
    X(scene)                                                                                       \
    X(train)                                                                                       \
    X(view_pass)

// The same functions for a struct of any type.
#define ERASE(name)                                                                                \
    static void init_##name(void *options, size_t size)                                            \
    {                                                                                              \
        sgs_##name##_options_init(options, size);                                                  \
    }                                                                                              \
    static size_t default_##name(void *options)                                                    \
    {                                                                                              \
        sgs_##name##_options made = sgs_##name##_options_default();                                \
        memcpy(options, &made, sizeof made);                                                       \
        return sizeof made;                                                                        \
    }
OPTIONS(ERASE)

static const struct {
    const char *name;
    void (*init)(void *options, size_t size);
    size_t (*make)(void *options);
} types[] = {
#define ROW(name) {#name, init_##name, default_##name},
    OPTIONS(ROW)
#undef ROW
};

enum { MAX_SIZE = 1024, CANARY = 0xA5 };

// Bytes of two structs that differ after struct_size, up to `size`; padding counts.
static bool same(const unsigned char *a, const unsigned char *b, size_t size)
{
    return size <= sizeof(size_t) ||
           !memcmp(a + sizeof(size_t), b + sizeof(size_t), size - sizeof(size_t));
}

static void defaults_fill_structs_of_any_size(void **state)
{
    (void)state;
    for (size_t t = 0; t < sizeof types / sizeof *types; ++t) {
        _Alignas(16) unsigned char full[MAX_SIZE], other[MAX_SIZE];
        memset(full, 0, sizeof full);
        const size_t whole = types[t].make(full);
        size_t stored;
        assert_true(whole < MAX_SIZE - 64);
        memcpy(&stored, full, sizeof stored);
        assert_int_equal(stored, whole);
        for (size_t size = sizeof size; size <= whole + 64; ++size) {
            memset(other, CANARY, sizeof other);
            types[t].init(other, size);
            memcpy(&stored, other, sizeof stored);
            const size_t known = size < whole ? size : whole;
            if (stored != size || !same(other, full, known))
                fail_msg("sgs_%s_options of %zu bytes: wrong defaults", types[t].name, size);
            for (size_t i = known; i < sizeof other; ++i)
                if (other[i] != (i < size ? 0 : CANARY))
                    fail_msg("sgs_%s_options of %zu bytes: byte %zu is %d", types[t].name, size, i,
                             other[i]);
        }
        memset(other, CANARY, sizeof other);
        types[t].init(other, sizeof(size_t) - 1); // not even struct_size
        assert_int_equal(other[0], CANARY);
    }
}

// Options that point to other options read the size of those.
static void options_inside_options_may_be_of_another_size(void **state)
{
    (void)state;
    static const uint8_t pixels[16 * 16 * 3];
    const sgs_view_source source = {.camera = {SGS_CAMERA_PINHOLE, 16, 16, {16, 16, 8, 8}},
                                    .pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}},
                                    .channels = 3,
                                    .pixels = pixels};
    sgs_scene *scene;
    sgs_gaussians *model;
    const float points[6] = {0, 0, 2, 0.1f, 0, 2};
    assert_int_equal(sgs_scene_create(&source, 1, NULL, NULL, 0, NULL, &scene), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_init_points(points, NULL, 2, 0.01, &model), SGS_STATUS_OK);
    // Structs that end early; what follows them would be refused.
    sgs_render_options render = sgs_render_options_default();
    sgs_view_pass_options views = sgs_view_pass_options_default();
    sgs_prune_options prune = sgs_prune_options_default();
    render.struct_size = offsetof(sgs_render_options, near_distance);
    render.near_distance = NAN;
    views.render = &render;
    views.struct_size = offsetof(sgs_view_pass_options, downscale);
    views.downscale = -1;
    prune.scene = scene;
    prune.views = &views;
    sgs_contribution contributions[2];
    double scores[2];
    assert_int_equal(sgs_contributions(model, scene, &views, contributions), SGS_STATUS_OK);
    assert_true(contributions[0].hits > 0);
    for (int method = SGS_PRUNE_LIGHTGAUSSIAN; method <= SGS_PRUNE_PUP; method += 2) {
        prune.method = (sgs_prune_method)method;
        assert_int_equal(sgs_prune_scores(model, &prune, scores), SGS_STATUS_OK);
        render.struct_size = sizeof render; // now near_distance is read
        assert_int_equal(sgs_prune_scores(model, &prune, scores), SGS_STATUS_INVALID_ARGUMENT);
        render.struct_size = sizeof render + 8;
        assert_int_equal(sgs_prune_scores(model, &prune, scores), SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), "sgs_render_options.struct_size"));
        render.struct_size = offsetof(sgs_render_options, near_distance);
        views.struct_size = 1;
        assert_int_equal(sgs_prune_scores(model, &prune, scores), SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), "sgs_view_pass_options.struct_size"));
        views.struct_size = offsetof(sgs_view_pass_options, downscale);
    }
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(defaults_fill_structs_of_any_size),
        cmocka_unit_test(options_inside_options_may_be_of_another_size),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
