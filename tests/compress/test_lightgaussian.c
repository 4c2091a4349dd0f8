// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// LightGaussian: the nearest code against a search in double precision, which values are exact, the
// error of quantised SH coefficients, the optimiser of the distillation, and what is quantised
// after training.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compress/bit_stream.h"
#include "compress/distill.h"
#include "compress/vq.h"
#include "sparegs/prune.h"
#include "sparegs/runtime.h"
#include "support/compress_support.h"
#include "support/files_support.h"
#include "support/prune_support.h"

static void nearest_codes_are_found(void **state)
{
    (void)state;
    enum { CODES = 37, DIM = 11, ROWS = 150, STRIDE = 13 };
    float data[ROWS * STRIDE];
    uint32_t rows[ROWS], nearest[ROWS];
    sgsi_codebook codebook;
    assert_int_equal(sgsi_codebook_create(CODES, DIM, &codebook), 0);
    for (uint64_t k = 0; k < CODES * DIM; ++k)
        codebook.codes[k] = (float)sgsi_random_normal(1, k);
    for (uint64_t k = 0; k < ROWS * STRIDE; ++k)
        data[k] = (float)sgsi_random_normal(2, k);
    memcpy(codebook.codes + 9 * DIM, codebook.codes + 5 * DIM, DIM * sizeof(float)); // equal codes
    memcpy(data + 3 * STRIDE, codebook.codes + 5 * DIM, DIM * sizeof(float));
    for (uint32_t i = 0; i < ROWS; ++i)
        rows[i] = ROWS - 1 - i;
    for (int isa = 0; isa < 3; ++isa) {
        if (sgs_isa_set((sgs_isa)isa))
            continue;
        sgsi_codebook_assign(&codebook, data, STRIDE, rows, ROWS, nearest);
        for (size_t i = 0; i < ROWS; ++i) {
            double least = INFINITY, chosen = 0;
            for (size_t k = 0; k < CODES; ++k) {
                double distance = 0;
                for (size_t d = 0; d < DIM; ++d) {
                    const double e =
                        (double)data[rows[i] * STRIDE + d] - (double)codebook.codes[k * DIM + d];
                    distance += e * e;
                }
                least = fmin(least, distance);
                chosen = k == nearest[i] ? distance : chosen;
            }
            assert_true(chosen <= least + 1e-4);
        }
        assert_int_equal(nearest[ROWS - 1 - 3], 5); // the first of equal codes
    }
    sgsi_codebook_free(&codebook);
}

static void bits_are_packed_without_gaps(void **state)
{
    (void)state;
    for (int bits = 1; bits <= 25; ++bits) {
        uint8_t bytes[200] = {0};
        for (size_t i = 0; i < 50; ++i)
            sgsi_bits_put(bytes, i, bits, (uint32_t)(sgsi_random_bits(3, i) % (1u << bits)));
        for (size_t i = 0; i < 50; ++i)
            assert_int_equal(sgsi_bits_get(bytes, i, bits), sgsi_random_bits(3, i) % (1u << bits));
        assert_int_equal(sgsi_bit_bytes(50, bits), (50 * (size_t)bits + 7) / 8);
    }
    uint8_t one[2] = {0};
    sgsi_bits_put(one, 1, 3, 5);
    assert_int_equal(one[0], 5 << 2); // most significant bit first
    assert_int_equal(sgsi_bit_width(8192), 13);
    assert_int_equal(sgsi_bit_width(8193), 14);
}

static sgs_gaussians *through(const sgs_gaussians *model, const sgs_compress_options *options)
{
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *decoded;
    assert_int_equal(sgs_compress(model, options, temp_path(&folder, "pack"), NULL), 0);
    assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
    temp_folder_remove(&folder);
    return decoded;
}

// Eight different SH vectors and a codebook with room for all of them.
static void quantised_rows_are_close_and_others_exact(void **state)
{
    (void)state;
    enum { COUNT = 400, SH = 48 };
    sgs_gaussians *model = pack_model(COUNT, 3, 7);
    for (size_t i = 8; i < COUNT; ++i)
        for (int k = 0; k < SH; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + k) =
                *sgs_gaussians_at(model, i % 8, SGS_PARAM_SH_DC + k);
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_LIGHTGAUSSIAN;
    options.vq_ratio = 0.6;
    options.codebook = 64;
    options.vq_steps = 100;
    sgs_gaussians *decoded = through(model, &options);
    assert_int_equal(decoded->count, COUNT);
    size_t exact = 0;
    double error = 0, power = 0;
    for (size_t i = 0; i < COUNT; ++i) {
        float a[SGS_PARAM_COUNT], b[SGS_PARAM_COUNT];
        sgs_gaussians_get(model, i, a);
        sgs_gaussians_get(decoded, i, b);
        assert_memory_equal(a, b, SGS_PARAM_SH_DC * sizeof *a);
        size_t equal = 0;
        for (int k = SGS_PARAM_SH_DC; k < SGS_PARAM_COUNT; ++k) {
            equal += a[k] == b[k];
            error += pow((double)a[k] - (double)b[k], 2);
            power += pow((double)a[k], 2);
        }
        exact += equal == SH;
    }
    assert_int_equal(exact, COUNT - (size_t)(0.6 * COUNT));
    // Codes follow the sizes of the batches, as released: they do not converge.
    assert_true(error <= 0.01 * power);
    print_message("relative error %.2g\n", sqrt(error / power));
    sgs_gaussians_destroy(decoded);

    options.half = true;
    decoded = through(model, &options);
    for (size_t i = 0; i < COUNT; ++i)
        for (int k = 0; k < SGS_PARAM_SH_DC; ++k) {
            const double a = *sgs_gaussians_at(model, i, k), b = *sgs_gaussians_at(decoded, i, k);
            assert_true(fabs(a - b) <= (k < 3 ? 0 : fabs(a) / 2048 + 6.2e-5));
        }
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
}

// Lengths of quaternions beyond the range of 16-bit floats.
static void halves_keep_rotations_of_any_length(void **state)
{
    (void)state;
    enum { COUNT = 16 };
    sgs_gaussians *model = pack_model(COUNT, 0, 7);
    for (size_t i = 0; i < COUNT; ++i)
        for (int k = 0; k < 4; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_ROTATION + k) *= i % 2 ? 1e-6f : 1e6f;
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_LIGHTGAUSSIAN;
    options.vq_steps = 1;
    options.half = true;
    sgs_gaussians *decoded = through(model, &options);
    for (size_t i = 0; i < COUNT; ++i) {
        double dot = 0, a2 = 0, b2 = 0;
        for (int k = 0; k < 4; ++k) {
            const double a = *sgs_gaussians_at(model, i, SGS_PARAM_ROTATION + k),
                         b = *sgs_gaussians_at(decoded, i, SGS_PARAM_ROTATION + k);
            dot += a * b;
            a2 += a * a;
            b2 += b * b;
        }
        assert_true(fabs(dot) >= (1 - 1e-6) * sqrt(a2 * b2));
    }
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
}

// The release trains from iteration 30000 to 40000. Positions: get_expon_lr_func with
// --position_lr_max_steps 40000. Others: ExponentialLR with gamma 0.9, a step every 500 iterations.
static void distillation_rates_are_those_of_the_release(void **state)
{
    (void)state;
    static const struct {
        int param;
        double rate;
    } groups[] = {{SGS_PARAM_ROTATION, 0.001},
                  {SGS_PARAM_SCALE, 0.005},
                  {SGS_PARAM_OPACITY, 0},
                  {SGS_PARAM_SH_DC, 0.0025},
                  {SGS_PARAM_SH_REST, 0.0025 / 20}};
    const double extent = 4.5;
    for (int step = 1; step <= 10000; step += 833) {
        const double t = (30000.0 + step) / 40000;
        const double mean = extent * exp(log(0.00016) * (1 - t) + log(0.0000016) * t);
        assert_true(fabs(sgsi_distill_rate(SGS_PARAM_MEAN + 2, step, extent) / mean - 1) < 1e-12);
        double decay = 1;
        for (int k = 1; k <= step; ++k)
            decay *= k % 500 ? 1 : 0.9;
        for (size_t g = 0; g < sizeof groups / sizeof *groups; ++g)
            assert_true(fabs(sgsi_distill_rate(groups[g].param, step, extent) -
                             decay * groups[g].rate) < 1e-15);
    }
    assert_true(fabs(sgsi_distill_rate(SGS_PARAM_MEAN, 10000, 1) - 1.6e-6) < 1e-18);
}

// The gradient of a primitive outside of all views is 0: the weight decay of AdamW (0.01, the
// default of PyTorch) is all that changes it.
static void distillation_decays_what_no_view_sees(void **state)
{
    (void)state;
    enum { STEPS = 3 };
    sgs_gaussians *model = pack_model(100, 3, 7);
    *sgs_gaussians_at(model, 0, SGS_PARAM_MEAN) = 0;
    *sgs_gaussians_at(model, 0, SGS_PARAM_MEAN + 1) = 500;
    *sgs_gaussians_at(model, 0, SGS_PARAM_MEAN + 2) = 0;
    sgs_scene *scene = prune_scene(48, 32);
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_LIGHTGAUSSIAN;
    options.scene = scene;
    options.distill = STEPS;
    options.vq_steps = 1;
    options.codebook = 16;
    sgs_gaussians *decoded = through(model, &options);
    assert_int_equal(decoded->count, 100);
    assert_int_equal(decoded->sh_degree, 2);
    for (int k = SGS_PARAM_ROTATION; k < SGS_PARAM_SH_DC; ++k) {
        const double rate = k < SGS_PARAM_SCALE ? 0.001 : k < SGS_PARAM_OPACITY ? 0.005 : 0;
        const double before = (double)*sgs_gaussians_at(model, 0, k);
        const double expected = before * pow(1 - 0.01 * rate, STEPS);
        const double actual = (double)*sgs_gaussians_at(decoded, 0, k);
        if (!(fabs(actual - expected) <= 3e-7 * fabs(expected)))
            fail_msg("parameter %d: %.9g, expected %.9g", k, actual, expected);
    }
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

// Whether a primitive 0.1 in front of the only training camera is kept.
static bool keeps_what_is_near(const sgs_compress_options *options)
{
    sgs_gaussians *model = pack_model(100, 1, 7);
    double center[3], length = 0;
    sgs_pose_center(&options->scene->views[0].pose, center);
    for (int k = 0; k < 3; ++k)
        length += center[k] * center[k];
    for (int k = 0; k < 3; ++k) {
        *sgs_gaussians_at(model, 50, SGS_PARAM_MEAN + k) =
            (float)(center[k] * (1 - 0.1 / sqrt(length)));
        *sgs_gaussians_at(model, 50, SGS_PARAM_SCALE + k) = -4;
    }
    *sgs_gaussians_at(model, 50, SGS_PARAM_OPACITY) = 2;
    sgs_gaussians *decoded = through(model, options);
    bool kept = false;
    for (size_t i = 0; i < decoded->count; ++i) {
        double square = 0;
        for (int k = 0; k < 3; ++k)
            square += pow((double)*sgs_gaussians_at(decoded, i, k) -
                              (double)*sgs_gaussians_at(model, 50, k),
                          2);
        kept = kept || square < 1e-6;
    }
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
    return kept;
}

static void the_near_distance_is_that_of_the_scene(void **state)
{
    (void)state;
    sgs_scene *scene = prune_scene(48, 32);
    for (size_t k = 1; k < scene->view_count; ++k)
        scene->views[k].split = SGS_SPLIT_TEST;
    scene->extent = 0.25; // near distance 0.05
    const sgs_render_options render = sgs_render_options_default();
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_LIGHTGAUSSIAN;
    options.scene = scene;
    options.keep = 0.5;
    options.finetune = 0;
    options.distill = 1;
    options.vq_steps = 1;
    options.codebook = 16;
    assert_true(keeps_what_is_near(&options));
    options.render = &render; // of the caller: 0.2
    assert_false(keeps_what_is_near(&options));
    sgs_scene_destroy(scene);
}

// True if another row has the same SH coefficients: with a codebook of one entry, those that it
// replaces.
static bool shares_its_color(const sgs_gaussians *model, size_t row)
{
    size_t equal = 0;
    for (size_t i = 0; i < model->count && equal < 2; ++i) {
        int k = SGS_PARAM_SH_DC;
        while (k < SGS_PARAM_COUNT &&
               *sgs_gaussians_at(model, i, k) == *sgs_gaussians_at(model, row, k))
            ++k;
        equal += k == SGS_PARAM_COUNT;
    }
    return equal == 2;
}

// The training sorts the rows and changes their significance. What the codebook replaces must be
// the least significant rows of the stored model. Colours do not change the significance.
static void least_significant_rows_of_the_final_model_are_quantised(void **state)
{
    (void)state;
    enum { COUNT = 300, KEPT = 240 };
    static const struct {
        int finetune, distill;
    } runs[] = {{0, 0}, {1, 0}, {20, 0}, {0, 20}, {1, 1}};
    sgs_gaussians *model = pack_model(COUNT, 3, 7); // in no order
    sgs_scene *scene = prune_scene(96, 64);
    sgs_prune_options significance = sgs_prune_options_default();
    significance.method = SGS_PRUNE_LIGHTGAUSSIAN;
    significance.scene = scene;
    for (size_t r = 0; r < sizeof runs / sizeof *runs; ++r) {
        sgs_compress_options options = sgs_compress_options_default();
        options.method = SGS_COMPRESS_LIGHTGAUSSIAN;
        options.scene = scene;
        options.keep = 0.8;
        options.finetune = runs[r].finetune;
        options.distill = runs[r].distill;
        options.vq_ratio = 0.5;
        options.codebook = 1;
        options.vq_steps = 1;
        sgs_gaussians *decoded = through(model, &options);
        double scores[COUNT], most = 0, least = INFINITY;
        size_t quantised = 0;
        assert_int_equal(decoded->count, KEPT);
        assert_int_equal(sgs_prune_scores(decoded, &significance, scores), 0);
        for (size_t i = 0; i < KEPT; ++i) {
            const bool shares = shares_its_color(decoded, i);
            quantised += shares;
            most = shares ? fmax(most, scores[i]) : most;
            least = shares ? least : fmin(least, scores[i]);
        }
        assert_int_equal(quantised, KEPT / 2);
        if (!(most <= least && least > 0))
            fail_msg("run %zu: a row of significance %g is quantised, one of %g is exact", r, most,
                     least);
        sgs_gaussians_destroy(decoded);
    }
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nearest_codes_are_found),
        cmocka_unit_test(bits_are_packed_without_gaps),
        cmocka_unit_test(quantised_rows_are_close_and_others_exact),
        cmocka_unit_test(halves_keep_rotations_of_any_length),
        cmocka_unit_test(distillation_rates_are_those_of_the_release),
        cmocka_unit_test(distillation_decays_what_no_view_sees),
        cmocka_unit_test(the_near_distance_is_that_of_the_scene),
        cmocka_unit_test(least_significant_rows_of_the_final_model_are_quantised),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
