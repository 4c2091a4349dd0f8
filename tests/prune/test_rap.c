// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// RAP's features against the definitions written out with sorting and loops; its network against a
// hand calculation; the reader of the weight file with valid and damaged archives.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/compare.h"
#include "base/core.h"
#include "base/threads.h"
#include "sparegs/prune.h"
#include "support/files_support.h"
#include "support/oracle_support.h"

enum { COUNT = 400, LAYERS = 4 };

static int one_thread(void **state)
{
    (void)state;
    sgsi_threads_set(1);
    return 0;
}

// ---- Features ----

typedef struct near_point {
    double distance;
    size_t index;
} near_point;

static int by_distance(const void *a, const void *b)
{
    const near_point *p = a, *q = b;
    return p->distance < q->distance ? -1 : p->distance > q->distance;
}

static double sh(const double *c, double x, double y, double z)
{
    return 0.28209479177387814 * c[0] - 0.4886025119029199 * y * c[1] +
           0.4886025119029199 * z * c[2] - 0.4886025119029199 * x * c[3] +
           1.0925484305920792 * x * y * c[4] - 1.0925484305920792 * y * z * c[5] +
           0.31539156525252005 * (2 * z * z - x * x - y * y) * c[6] -
           1.0925484305920792 * x * z * c[7] + 0.5462742152960396 * (x * x - y * y) * c[8] -
           0.5900435899266435 * y * (3 * x * x - y * y) * c[9] +
           2.890611442640554 * x * y * z * c[10] -
           0.4570457994644658 * y * (4 * z * z - x * x - y * y) * c[11] +
           0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y) * c[12] -
           0.4570457994644658 * x * (4 * z * z - x * x - y * y) * c[13] +
           1.445305721320277 * z * (x * x - y * y) * c[14] -
           0.5900435899266435 * x * (x * x - 3 * y * y) * c[15];
}

// The coefficients of "channel" c are the elements 16 c to 16 c + 15 of the array [16][3].
static double anisotropy(const double *params)
{
    double total = 0, colors[60];
    for (int c = 0; c < 3; ++c) {
        double mean = 0;
        for (int i = 0; i < 60; ++i) {
            const double u = i + 0.5, phi = acos(1 - 2 * u / 60), theta = M_PI * (1 + sqrt(5)) * u;
            const double v = sh(params + SGS_PARAM_SH_DC + 16 * c, sin(phi) * cos(theta),
                                sin(phi) * sin(theta), cos(phi));
            colors[i] = fmin(fmax(v + 0.5, 0), 1);
            mean += colors[i] / 60;
        }
        for (int i = 0; i < 60; ++i)
            total += (colors[i] - mean) * (colors[i] - mean);
    }
    return sqrt(total / 180);
}

// The column of z_loc of a quantity.
static void local_column(const double *f, near_point (*near)[COUNT], double *z)
{
    for (size_t i = 0; i < COUNT; ++i) {
        double mean = 0, variance = 0;
        for (size_t k = 0; k < 128; ++k)
            mean += f[near[i][k].index] / 128;
        for (size_t k = 0; k < 128; ++k)
            variance += pow(f[near[i][k].index] - mean, 2) / 128;
        z[i] = (f[i] - mean) / (sqrt(variance) + 1e-8);
    }
}

static void global_column(const double *f, double *z)
{
    double mean = 0, variance = 0;
    for (size_t i = 0; i < COUNT; ++i)
        mean += log(f[i]) / COUNT;
    for (size_t i = 0; i < COUNT; ++i)
        variance += pow(log(f[i]) - mean, 2) / (COUNT - 1);
    for (size_t i = 0; i < COUNT; ++i)
        z[i] = (log(f[i]) - mean) / sqrt(variance);
}

static void scale_column(double *z)
{
    double sorted[COUNT], edges[2];
    memcpy(sorted, z, sizeof sorted);
    qsort(sorted, COUNT, sizeof *sorted, sgsi_compare_doubles);
    for (int side = 0; side < 2; ++side) {
        const double at = (side ? 0.99 : 0.01) * (COUNT - 1);
        const size_t k = (size_t)at;
        edges[side] = sorted[k] * (1 - (at - (double)k)) + sorted[k + 1] * (at - (double)k);
    }
    for (size_t i = 0; i < COUNT; ++i)
        z[i] = (fmin(fmax(z[i], edges[0]), edges[1]) - edges[0]) / (edges[1] - edges[0]);
}

// D, A, three scales, V, o, r, g, b.
static void quantities(const oracle_scene *model, near_point (*near)[COUNT], double (*f)[COUNT])
{
    for (size_t i = 0; i < COUNT; ++i) {
        const double *p = model->params + i * SGS_PARAM_COUNT;
        double s[3];
        f[0][i] = 0;
        for (size_t j = 0; j < COUNT; ++j) {
            const double *q = model->params + j * SGS_PARAM_COUNT;
            const double d = sqrt(pow(p[0] - q[0], 2) + pow(p[1] - q[1], 2) + pow(p[2] - q[2], 2));
            near[i][j] = (near_point){j == i ? INFINITY : d, j};
        }
        qsort(near[i], COUNT, sizeof near[i][0], by_distance);
        for (int k = 0; k < 128; ++k)
            f[0][i] += near[i][k].distance / 128;
        f[1][i] = anisotropy(p);
        for (int k = 0; k < 3; ++k) {
            s[k] = exp(p[SGS_PARAM_SCALE + k]);
            f[7 + k][i] = fmin(fmax(0.28209479177387814 * p[SGS_PARAM_SH_DC + k] + 0.5, 0), 1);
        }
        qsort(s, 3, sizeof *s, sgsi_compare_doubles);
        for (int k = 0; k < 3; ++k)
            f[2 + k][i] = s[k];
        f[5][i] = s[0] * s[1] * s[2];
        f[6][i] = 1 / (1 + exp(-p[SGS_PARAM_OPACITY]));
    }
}

static void features_are_those_of_the_definitions(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(21, COUNT, NULL);
    near_point(*near)[COUNT] = oracle_memory(COUNT, sizeof *near);
    double f[10][COUNT], columns[SGS_RAP_FEATURES][COUNT], part[COUNT];
    quantities(&model, near, f);
    // Quantity of each column; -1: the colours.
    static const int of[SGS_RAP_FEATURES] = {0, 0, 1, 1, 2, 3, 4, 2, 3, 4, 5, 5, 6, 6, -1};
    static const char kinds[] = "lglglllggglglg";
    for (int k = 0; k < SGS_RAP_FEATURES; ++k) {
        memset(columns[k], 0, sizeof columns[k]);
        if (of[k] >= 0 && kinds[k] == 'l')
            local_column(f[of[k]], near, columns[k]);
        else if (of[k] >= 0)
            global_column(f[of[k]], columns[k]);
        for (int c = 0; of[k] < 0 && c < 3; ++c) {
            local_column(f[7 + c], near, part);
            for (size_t i = 0; i < COUNT; ++i)
                columns[k][i] += part[i] / 3;
        }
        scale_column(columns[k]);
    }
    float *features = oracle_memory(COUNT, SGS_RAP_FEATURES * sizeof *features);
    assert_int_equal(sgs_rap_features(model.model, NULL, NULL, features), 0);
    for (size_t i = 0; i < COUNT; ++i)
        for (int k = 0; k < SGS_RAP_FEATURES; ++k)
            if (!(fabs((double)features[i * SGS_RAP_FEATURES + (size_t)k] - columns[k][i]) <= 2e-5))
                fail_msg("primitive %zu, %s: %g, not %g", i, sgs_rap_feature_name(k),
                         (double)features[i * SGS_RAP_FEATURES + (size_t)k], columns[k][i]);
    free(near);
    free(features);
    oracle_scene_free(&model);
}

static void features_do_not_depend_on_threads(void **state)
{
    (void)state;
    enum { MANY = 40000 }; // more than one step
    oracle_scene model = oracle_random_model(3, MANY, NULL);
    float *a = oracle_memory(MANY, SGS_RAP_FEATURES * sizeof *a);
    float *b = oracle_memory(MANY, SGS_RAP_FEATURES * sizeof *b);
    assert_int_equal(sgs_rap_features(model.model, NULL, NULL, a), 0);
    sgsi_threads_set(3);
    assert_int_equal(sgs_rap_features(model.model, NULL, NULL, b), 0);
    sgsi_threads_set(1);
    assert_memory_equal(a, b, MANY * SGS_RAP_FEATURES * sizeof *a);
    free(a);
    free(b);
    oracle_scene_free(&model);
}

static bool stop(void *user, size_t done, size_t total)
{
    (void)user;
    return done < total / 2;
}

// Few, equal, or extreme primitives give finite features.
static void degenerate_models_have_finite_features(void **state)
{
    (void)state;
    float features[300 * SGS_RAP_FEATURES];
    oracle_scene model = oracle_random_model(3, 300, NULL);
    assert_int_equal(sgs_rap_features(model.model, stop, NULL, features), SGS_STATUS_CANCELLED);
    for (size_t i = 0; i < 300; ++i)
        oracle_set_ball(oracle_primitive(&model, i), 1, 2, 3, 1e-9, 0.5);
    oracle_primitive(&model, 7)[SGS_PARAM_SCALE] = 1e20;
    oracle_primitive(&model, 8)[SGS_PARAM_OPACITY] = -90;
    oracle_primitive(&model, 9)[SGS_PARAM_MEAN] = 1e30;
    oracle_scene_round(&model);
    assert_int_equal(sgs_rap_features(model.model, NULL, NULL, features), 0);
    for (size_t k = 0; k < sizeof features / sizeof *features; ++k)
        assert_true(features[k] >= 0 && features[k] <= 1);
    oracle_scene_free(&model);
    model = oracle_random_model(3, 2, NULL);
    assert_int_equal(sgs_rap_features(model.model, NULL, NULL, features), 0);
    model.model->count = 1;
    assert_int_equal(sgs_rap_features(model.model, NULL, NULL, features),
                     SGS_STATUS_INVALID_ARGUMENT);
    oracle_scene_free(&model);
}

static void models_that_are_not_finite_are_refused(void **state)
{
    (void)state;
    enum { ENOUGH = 150 }; // more than there are neighbours
    static const float values[] = {INFINITY, -INFINITY, NAN};
    float features[ENOUGH * SGS_RAP_FEATURES];
    oracle_scene model = oracle_random_model(3, ENOUGH, NULL);
    for (size_t v = 0; v < 3; ++v)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            if (k == SGS_PARAM_OPACITY && !isnan(values[v]))
                continue; // opacity 0 or 1
            float *at = sgs_gaussians_at(model.model, 120, k);
            const float kept = *at;
            *at = values[v];
            assert_int_equal(sgs_rap_features(model.model, NULL, NULL, features),
                             SGS_STATUS_INVALID_ARGUMENT);
            assert_string_equal(sgs_last_error(),
                                "primitive 120 has a parameter that is not finite; remove it");
            *at = kept;
        }
    *sgs_gaussians_at(model.model, 120, SGS_PARAM_OPACITY) = INFINITY;
    *sgs_gaussians_at(model.model, 121, SGS_PARAM_OPACITY) = -INFINITY;
    assert_int_equal(sgs_rap_features(model.model, NULL, NULL, features), 0);
    for (size_t k = 0; k < sizeof features / sizeof *features; ++k)
        assert_true(features[k] >= 0 && features[k] <= 1);
    oracle_scene_free(&model);
}

// ---- The network and its file ----

static const int widths[LAYERS + 1] = {15, 32, 32, 16, 2};

typedef struct zip {
    uint8_t bytes[1 << 15];
    size_t size, offsets[9];
} zip;

static void put(zip *z, uint64_t value, int bytes)
{
    for (int k = 0; k < bytes; ++k)
        z->bytes[z->size++] = (uint8_t)(value >> (8 * k));
}

static uint32_t crc32_of(const uint8_t *bytes, size_t size)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < size; ++i) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; ++bit)
            crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0);
    }
    return ~crc;
}

static float weight_of(int tensor, int i)
{
    return (float)(0.6 * sgsi_random_uniform((uint64_t)tensor + 5, (uint64_t)i) - 0.3);
}

static int tensor_floats(int tensor)
{
    return widths[tensor / 2 + 1] * (tensor % 2 ? 1 : widths[tensor / 2]);
}

// An archive as torch.save writes it: another entry, then eight tensors, each aligned to 64 bytes.
// `skip`: a tensor to omit, or -1; `shorter`: a tensor that lacks its last value, or -1.
static zip make_zip(int skip, int shorter)
{
    zip z = {.size = 0};
    char names[9][32] = {"model/data.pkl"};
    uint32_t sizes[9] = {5}, crcs[9];
    for (int k = 0; k < 9; ++k) {
        if (k)
            snprintf(names[k], sizeof names[k], "model/data/%d", k - 1);
        if (k - 1 == skip && k)
            snprintf(names[k], sizeof names[k], "model/other%d", k - 1);
        z.offsets[k] = z.size;
        const size_t name = strlen(names[k]);
        const size_t extra = 4 + (64 - (z.size + 30 + name + 4) % 64) % 64;
        put(&z, 0x04034B50, 4);
        z.size += 22;
        put(&z, name, 2);
        put(&z, extra, 2);
        memcpy(z.bytes + z.size, names[k], name);
        z.size += name + extra;
        const size_t at = z.size;
        if (k) {
            for (int i = 0; i < tensor_floats(k - 1) - (k - 1 == shorter); ++i) {
                const float value = weight_of(k - 1, i);
                memcpy(z.bytes + z.size, &value, 4);
                z.size += 4;
            }
            sizes[k] = (uint32_t)(z.size - at);
        } else {
            memcpy(z.bytes + z.size, "hello", 5);
            z.size += 5;
        }
        crcs[k] = crc32_of(z.bytes + at, sizes[k]);
    }
    const size_t directory = z.size;
    for (int k = 0; k < 9; ++k) {
        const size_t name = strlen(names[k]);
        put(&z, 0x02014B50, 4);
        z.size += 12;
        put(&z, crcs[k], 4);
        put(&z, sizes[k], 4);
        put(&z, sizes[k], 4);
        put(&z, name, 2);
        z.size += 12;
        put(&z, z.offsets[k], 4);
        memcpy(z.bytes + z.size, names[k], name);
        z.size += name;
    }
    const size_t end = z.size;
    put(&z, 0x06054B50, 4);
    z.size += 4;
    put(&z, 9, 2);
    put(&z, 9, 2);
    put(&z, end - directory, 4);
    put(&z, directory, 4);
    put(&z, 0, 2);
    return z;
}

static void the_network_is_the_one_in_the_file(void **state)
{
    (void)state;
    temp_folder folder = temp_folder_make();
    const zip z = make_zip(-1, -1);
    file_put(temp_path(&folder, "net.pth"), z.bytes, z.size);
    sgs_rap_network *network;
    if (sgs_rap_read(temp_path(&folder, "net.pth"), &network))
        fail_msg("%s", sgs_last_error());
    for (uint64_t example = 0; example < 20; ++example) {
        float features[15];
        double values[32] = {0}, next[32] = {0};
        for (int k = 0; k < 15; ++k)
            values[k] = features[k] = (float)sgsi_random_uniform(77, 15 * example + (uint64_t)k);
        for (int layer = 0; layer < LAYERS; ++layer) {
            const int in = widths[layer], out = widths[layer + 1];
            for (int o = 0; o < out; ++o) {
                next[o] = (double)weight_of(2 * layer + 1, o);
                for (int i = 0; i < in; ++i)
                    next[o] += (double)weight_of(2 * layer, o * in + i) * values[i];
                if (layer < LAYERS - 1)
                    next[o] = fmax(next[o], 0);
            }
            memcpy(values, next, sizeof values);
        }
        const double expected = exp(values[0]) / (exp(values[0]) + exp(values[1]));
        assert_true(fabs(sgs_rap_score(network, features) - expected) < 1e-12);
    }
    sgs_rap_destroy(network);
    sgs_rap_destroy(NULL);
    temp_folder_remove(&folder);
}

static void refuses(const temp_folder *folder, const uint8_t *bytes, size_t size, const char *part)
{
    sgs_rap_network *network = (sgs_rap_network *)&size;
    file_put(temp_path(folder, "net.pth"), bytes, size);
    const sgs_status status = sgs_rap_read(temp_path(folder, "net.pth"), &network);
    if (status != SGS_STATUS_FORMAT || network || !strstr(sgs_last_error(), part) ||
        !strstr(sgs_last_error(), "net.pth"))
        fail_msg("'%s' does not contain '%s'", sgs_last_error(), part);
}

static void damaged_files_are_refused(void **state)
{
    (void)state;
    temp_folder folder = temp_folder_make();
    const zip good = make_zip(-1, -1);
    zip bad = make_zip(3, -1);
    refuses(&folder, bad.bytes, bad.size, "a tensor is missing");
    bad = make_zip(-1, 4);
    refuses(&folder, bad.bytes, bad.size, "a tensor does not have the size");
    refuses(&folder, (const uint8_t *)"no archive at all", 17, "not a zip archive");
    refuses(&folder, good.bytes, 0, "not a zip archive");
    bad = good;
    bad.bytes[good.offsets[2] + 100] ^= 1; // data of the second tensor
    refuses(&folder, bad.bytes, bad.size, "the checksum of a tensor is wrong");
    bad = good;
    bad.bytes[good.offsets[2]] ^= 1;
    refuses(&folder, bad.bytes, bad.size, "the archive is damaged");
    // Any prefix and any flipped bit is refused or reads as the same network, without a crash.
    for (size_t size = 0; size < good.size; size += 97)
        refuses(&folder, good.bytes, size, "net_f15.pth");
    for (size_t at = good.size - 700; at < good.size; ++at) {
        bad = good;
        bad.bytes[at] ^= 0x40;
        sgs_rap_network *network;
        file_put(temp_path(&folder, "net.pth"), bad.bytes, bad.size);
        sgs_rap_read(temp_path(&folder, "net.pth"), &network);
        sgs_rap_destroy(network);
    }
    sgs_rap_network *network;
    assert_int_equal(sgs_rap_read(temp_path(&folder, "none"), &network), SGS_STATUS_IO);
    assert_null(network);
    temp_folder_remove(&folder);
}

static void scores_require_the_network(void **state)
{
    (void)state;
    temp_folder folder = temp_folder_make();
    const zip z = make_zip(-1, -1);
    file_put(temp_path(&folder, "net.pth"), z.bytes, z.size);
    oracle_scene model = oracle_random_model(3, 200, NULL);
    sgs_prune_options options = sgs_prune_options_default();
    options.method = SGS_PRUNE_RAP;
    double scores[200];
    float features[200 * SGS_RAP_FEATURES];
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_INVALID_ARGUMENT);
    sgs_rap_network *network;
    assert_int_equal(sgs_rap_read(temp_path(&folder, "net.pth"), &network), 0);
    options.rap = network;
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), 0);
    assert_int_equal(sgs_rap_features(model.model, NULL, NULL, features), 0);
    for (size_t i = 0; i < 200; ++i)
        assert_true(scores[i] == sgs_rap_score(network, features + i * SGS_RAP_FEATURES));
    sgs_rap_destroy(network);
    oracle_scene_free(&model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(features_are_those_of_the_definitions),
        cmocka_unit_test(features_do_not_depend_on_threads),
        cmocka_unit_test(degenerate_models_have_finite_features),
        cmocka_unit_test(models_that_are_not_finite_are_refused),
        cmocka_unit_test(the_network_is_the_one_in_the_file),
        cmocka_unit_test(damaged_files_are_refused),
        cmocka_unit_test(scores_require_the_network),
    };
    return cmocka_run_group_tests(tests, one_thread, NULL);
}
