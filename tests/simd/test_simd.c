// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The sixteen lanes of src/simd/simd.h on every instruction set of the machine: each operation
// against its scalar C definition, the exponential against double precision over its whole range,
// sums against the documented tree bit by bit, and AVX2 against AVX-512 bit by bit. The last test
// ensures that a training run gives the same model on both.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/skip_support.h"

#include "base/core.h"
#include "simd/simd_probe.h"
#include "sparegs/runtime.h"

static const simd_probe *probes[SGS_ISA_COUNT];
static int probe_count;

static int find_probes(void **state)
{
    (void)state;
    probes[probe_count++] = &simd_probe_baseline;
#ifdef SGSI_AVX_KERNELS
    if (sgs_isa_supported(SGS_ISA_AVX2))
        probes[probe_count++] = &simd_probe_avx2;
    if (sgs_isa_supported(SGS_ISA_AVX512))
        probes[probe_count++] = &simd_probe_avx512;
#endif
    return 0;
}

static float random_float(uint64_t seed, uint64_t counter, double low, double high)
{
    return (float)(low + (high - low) * sgsi_random_uniform(seed, counter));
}

static void fill(float *x, size_t count, uint64_t seed, double low, double high)
{
    for (size_t i = 0; i < count; ++i)
        x[i] = random_float(seed, i, low, high);
}

static uint32_t bits_of(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

// ---- The exponential ----

enum { GRID = 1 << 20 };

// Dense around zero, random over the range, and multiples of 1/8 with their neighbours.
static size_t exp2_arguments(float *x)
{
    size_t count = 0;
    for (; count < GRID; ++count)
        x[count] = (float)((double)count / GRID - 0.5);
    for (; count < 2 * GRID; ++count)
        x[count] = random_float(1, count, -120, 126);
    for (int part = -960; part <= 1008; ++part) {
        const float at = 0.125f * (float)part;
        const float around[3] = {nextafterf(at, -1000), at, nextafterf(at, 1000)};
        for (int k = 0; k < 3; ++k)
            if (around[k] >= -120.0f && around[k] <= 126.0f)
                x[count++] = around[k];
    }
    while (count % 16)
        x[count++] = 0.0f;
    return count;
}

static void exp2_is_within_1_2e_7_of_double_over_its_whole_range(void **state)
{
    (void)state;
    float *x = sgsi_alloc(2 * GRID + 8192, sizeof *x), *y = sgsi_alloc(2 * GRID + 8192, sizeof *y);
    const size_t count = exp2_arguments(x);
    for (int k = 0; k < probe_count; ++k) {
        double worst = 0;
        probes[k]->exp2(x, y, count);
        for (size_t i = 0; i < count; ++i) {
            const double expected = exp2((double)x[i]), error = fabs(y[i] - expected) / expected;
            if (!(error <= worst))
                worst = error;
        }
        print_message("exp2 %s: worst relative error %.3g\n", probes[k]->name, worst);
        assert_true(worst <= 1.2e-7);
    }
    sgsi_free(x);
    sgsi_free(y);
}

static void exp2_of_minus_127_is_zero(void **state)
{
    (void)state;
    float x[16] __attribute__((aligned(64))), y[16] __attribute__((aligned(64)));
    for (int i = 0; i < 16; ++i)
        x[i] = i % 2 ? -127.0f : (float)-i;
    for (int k = 0; k < probe_count; ++k) {
        probes[k]->exp2(x, y, 16);
        for (int i = 0; i < 16; ++i)
            assert_true(i % 2 ? y[i] == 0.0f && !signbit(y[i]) : y[i] == exp2f((float)-i));
    }
}

// Without a fused multiply-add the argument is rounded in the conversion to base 2, by 2^-24 of |x
// log2(e)|.
static void exp_is_as_good_as_exp2_where_products_are_exact(void **state)
{
    (void)state;
    float x[4096] __attribute__((aligned(64))), y[4096] __attribute__((aligned(64)));
    fill(x, 4096, 2, -83, 87);
    for (int k = 0; k < probe_count; ++k) {
        const bool fused = probes[k] != &simd_probe_baseline;
        double worst = 0;
        probes[k]->exp(x, y, 4096);
        for (int i = 0; i < 4096; ++i) {
            const double expected = exp((double)x[i]), error = fabs(y[i] - expected) / expected;
            assert_true(error <= (fused ? 2e-7 : 1.2e-7 * (1 + fabs((double)x[i]))));
            worst = fmax(worst, error);
        }
        print_message("exp %s: worst relative error %.3g\n", probes[k]->name, worst);
    }
}

// ---- The logarithm ----

// Mantissas from 1/2 to 2 in steps, random exponents, and the neighbours of powers of two and of
// the points where the exponent changes.
static size_t log2_arguments(float *x)
{
    size_t count = 0;
    for (; count < GRID; ++count)
        x[count] = (float)(0.5 + 1.5 * (double)count / GRID);
    for (; count < 2 * GRID; ++count)
        x[count] = exp2f(random_float(12, count, -126, 127));
    for (int twice = -252; twice < 254; ++twice) {
        const float at = (float)exp2(0.5 * twice);
        const float around[3] = {nextafterf(at, 0), at, nextafterf(at, INFINITY)};
        for (int k = 0; k < 3; ++k)
            if (around[k] >= 0x1p-126f)
                x[count++] = around[k];
    }
    while (count % 16)
        x[count++] = 1.0f;
    return count;
}

static void log2_is_within_2_5e_7_of_double_for_every_normal_number(void **state)
{
    (void)state;
    float *x = sgsi_alloc(2 * GRID + 2048, sizeof *x), *y = sgsi_alloc(2 * GRID + 2048, sizeof *y);
    const size_t count = log2_arguments(x);
    for (int k = 0; k < probe_count; ++k) {
        double worst = 0;
        probes[k]->log2(x, y, count);
        for (size_t i = 0; i < count; ++i) {
            const double expected = log2((double)x[i]), error = fabs(y[i] - expected);
            const double n = floor(expected + 0.5);
            const double share = error / fmax(2.5e-7 * fabs(expected), 1.2e-7 * fabs(n));
            if (!(share <= worst) && error > 0)
                worst = share;
        }
        print_message("log2 %s: worst error %.3g of what is allowed\n", probes[k]->name, worst);
        assert_true(worst <= 1);
    }
    const float nothing[16] __attribute__((aligned(64))) = {0.0f, 1e-45f, 1e-39f};
    for (int k = 0; k < probe_count; ++k) {
        probes[k]->log2(nothing, y, 16);
        for (int i = 0; i < 16; ++i)
            assert_true(y[i] >= -127.0f && y[i] <= -126.0f);
    }
    sgsi_free(x);
    sgsi_free(y);
}

// ---- Lane by lane ----

static void arithmetic_is_ieee_and_fma_is_fused_on_vector_isas(void **state)
{
    (void)state;
    float x[16] __attribute__((aligned(64))), y[16] __attribute__((aligned(64))),
        z[16] __attribute__((aligned(64)));
    float out[PROBE_ARITHMETIC_COUNT][16] __attribute__((aligned(64)));
    for (uint64_t seed = 0; seed < 200; ++seed) {
        fill(x, 16, 3 * seed, -1, 1);
        fill(y, 16, 3 * seed + 1, -2, 2);
        fill(z, 16, 3 * seed + 2, -1, 1);
        for (int k = 0; k < probe_count; ++k) {
            const bool fused = probes[k] != &simd_probe_baseline;
            probes[k]->arithmetic(x, y, z, out);
            for (int i = 0; i < 16; ++i) {
                const float product = x[i] * y[i];
                assert_true(out[PROBE_ADD][i] == x[i] + y[i]);
                assert_true(out[PROBE_SUB][i] == x[i] - y[i]);
                assert_true(out[PROBE_MUL][i] == product);
                assert_true(out[PROBE_DIV][i] == x[i] / y[i]);
                assert_true(out[PROBE_FMA][i] == (fused ? fmaf(x[i], y[i], z[i]) : product + z[i]));
                assert_true(out[PROBE_FNMA][i] ==
                            (fused ? fmaf(-x[i], y[i], z[i]) : z[i] - product));
                assert_true(out[PROBE_FMS][i] ==
                            (fused ? fmaf(x[i], y[i], -z[i]) : product - z[i]));
                assert_true(out[PROBE_ABS][i] == fabsf(x[i]));
                assert_true(out[PROBE_SQRT][i] == sqrtf(fabsf(x[i])));
                assert_true(out[PROBE_CLAMP][i] == fminf(fmaxf(x[i], -0.25f), 0.5f));
            }
        }
    }
}

static void halves_are_the_lanes_in_order(void **state)
{
    (void)state;
    float x[16] __attribute__((aligned(64))), y[16] __attribute__((aligned(64))),
        z[16] __attribute__((aligned(64)));
    float whole[PROBE_ARITHMETIC_COUNT][16] __attribute__((aligned(64))),
        out[PROBE_HALF_COUNT][16] __attribute__((aligned(64)));
    for (uint64_t seed = 0; seed < 200; ++seed) {
        fill(x, 16, 3 * seed, -1, 1);
        fill(y, 16, 3 * seed + 1, -2, 2);
        fill(z, 16, 3 * seed + 2, -1, 1);
        for (int k = 0; k < probe_count; ++k) {
            probes[k]->arithmetic(x, y, z, whole);
            probes[k]->halves(x, y, z, out);
            assert_memory_equal(out[PROBE_HALF_ADD], whole[PROBE_ADD], sizeof *out);
            assert_memory_equal(out[PROBE_HALF_MUL], whole[PROBE_MUL], sizeof *out);
            assert_memory_equal(out[PROBE_HALF_FMA], whole[PROBE_FMA], sizeof *out);
            assert_memory_equal(out[PROBE_HALF_FNMA], whole[PROBE_FNMA], sizeof *out);
            assert_memory_equal(out[PROBE_HALF_LOAD], x, sizeof *out);
            for (int i = 0; i < 16; ++i)
                assert_int_equal(bits_of(out[PROBE_HALF_ZERO][i]), 0);
        }
    }
}

// Pairs of all kinds: ordinary, equal, signed zeros, infinities, NaN on either side.
static void special_pairs(float x[16], float y[16])
{
    const float values[16][2] = {
        {1, 2},        {2, 1},        {3, 3},        {-1, 1},        {0.0f, -0.0f},
        {-0.0f, 0.0f}, {INFINITY, 1}, {1, INFINITY}, {-INFINITY, 1}, {INFINITY, INFINITY},
        {NAN, 1},      {1, NAN},      {NAN, NAN},    {1e-30f, 0},    {-3, -2},
        {-2, -3}};
    for (int i = 0; i < 16; ++i) {
        x[i] = values[i][0];
        y[i] = values[i][1];
    }
}

// A comparison with NaN is false; min and max return the second operand when either is NaN.
static void comparisons_select_and_minimum_agree_with_c_even_for_nan(void **state)
{
    (void)state;
    float x[16] __attribute__((aligned(64))), y[16] __attribute__((aligned(64)));
    float out[PROBE_LANE_COUNT][16] __attribute__((aligned(64)));
    special_pairs(x, y);
    for (int k = 0; k < probe_count; ++k) {
        unsigned words[PROBE_MASK_COUNT];
        probes[k]->masks(x, y, 0, 0, words);
        probes[k]->lanes(x, y, 0xA5C3, out);
        for (int i = 0; i < 16; ++i) {
            const unsigned chosen = 0xA5C3u >> i & 1;
            assert_int_equal(words[PROBE_LT] >> i & 1, x[i] < y[i]);
            assert_int_equal(words[PROBE_LE] >> i & 1, x[i] <= y[i]);
            assert_int_equal(words[PROBE_GT] >> i & 1, x[i] > y[i]);
            assert_int_equal(words[PROBE_GE] >> i & 1, x[i] >= y[i]);
            assert_int_equal(bits_of(out[PROBE_MIN][i]), bits_of(x[i] < y[i] ? x[i] : y[i]));
            assert_int_equal(bits_of(out[PROBE_MAX][i]), bits_of(x[i] > y[i] ? x[i] : y[i]));
            assert_int_equal(bits_of(out[PROBE_SELECT][i]), bits_of(chosen ? x[i] : y[i]));
            assert_int_equal(bits_of(out[PROBE_KEEP][i]), chosen ? bits_of(x[i]) : 0);
            assert_int_equal(bits_of(out[PROBE_STORE_MASKED][i]), bits_of(chosen ? x[i] : -1.0f));
            assert_int_equal(bits_of(out[PROBE_COPY_UNALIGNED][i]), bits_of(x[i]));
            assert_int_equal(bits_of(out[PROBE_SET1][i]), bits_of(x[0]));
        }
    }
}

// All pairs of non-negative bounds, with numbers of every kind, the bounds and their successors.
static void between_leaves_the_lower_bound_out_and_nan(void **state)
{
    (void)state;
    static const float bounds[6] = {0.0f, 1e-40f, 0.2f, 1.0f, 3e38f, INFINITY};
    float x[2][16] __attribute__((aligned(64))) = {
        {-0.0f, -1e-40f, -0.2f, -1.0f, -3e38f, -INFINITY, NAN, -NAN, 0.5f, 1e-38f}};
    float low[16] __attribute__((aligned(64))), high[16] __attribute__((aligned(64)));
    memcpy(x[1], x[0], sizeof x[1]);
    for (int i = 0; i < 6; ++i) {
        x[0][10 + i] = bounds[i];
        x[1][10 + i] = nextafterf(bounds[i], INFINITY);
    }
    for (int pair = 0; pair < 36; ++pair) {
        for (int i = 0; i < 16; ++i) {
            low[i] = bounds[pair / 6];
            high[i] = bounds[pair % 6];
        }
        if (low[0] > high[0])
            continue;
        for (int k = 0; k < 2 * probe_count; ++k) {
            const float *values = x[k % 2];
            const unsigned bits = probes[k / 2]->between(values, low, high);
            for (int i = 0; i < 16; ++i)
                assert_int_equal(bits >> i & 1, values[i] > low[i] && values[i] <= high[i]);
        }
    }
}

static void masks_are_sixteen_bits(void **state)
{
    (void)state;
    const float zero[16] __attribute__((aligned(64))) = {0};
    for (int k = 0; k < probe_count; ++k) {
        for (uint64_t seed = 0; seed < 500; ++seed) {
            unsigned a = (unsigned)(sgsi_random_bits(5, seed) & 0xFFFF), words[PROBE_MASK_COUNT];
            const unsigned b = (unsigned)(sgsi_random_bits(6, seed) & 0xFFFF);
            if (seed < 18)
                a = seed < 16 ? 1u << seed : seed == 16 ? 0xFFFFu : 0;
            probes[k]->masks(zero, zero, a, b, words);
            assert_int_equal(words[PROBE_AND], a & b);
            assert_int_equal(words[PROBE_OR], a | b);
            assert_int_equal(words[PROBE_ANDNOT], a & ~b);
            assert_int_equal(words[PROBE_NOT], ~a & 0xFFFF);
            assert_int_equal(words[PROBE_NONE], 0);
            assert_int_equal(words[PROBE_ANY_A], a != 0);
            assert_int_equal(words[PROBE_ANY_NONE], 0);
        }
    }
}

static void integers_wrap_shift_and_round_to_even(void **state)
{
    (void)state;
    int32_t p[16] __attribute__((aligned(64))), q[16] __attribute__((aligned(64)));
    int32_t out[PROBE_INTEGER_COUNT][16] __attribute__((aligned(64)));
    float back[16] __attribute__((aligned(64)));
    const float x[16] __attribute__((aligned(64))) = {
        0.5f,  1.5f, 2.5f,       -0.5f, -1.5f, 0.49999997f, 0.50000006f, 1e6f,
        -3.7f, 3.7f, 8388608.5f, -0.0f, 7,     -7,          2.4999998f,  100000.5f};
    for (int i = 0; i < 16; ++i) {
        p[i] = (int32_t)sgsi_random_bits(7, (uint64_t)i);
        q[i] = (int32_t)sgsi_random_bits(8, (uint64_t)i);
    }
    p[0] = INT32_MAX, q[0] = 1, p[1] = -1, p[2] = INT32_MIN;
    for (int k = 0; k < probe_count; ++k) {
        probes[k]->integers(p, q, x, out);
        probes[k]->to_float(p, back);
        for (int i = 0; i < 16; ++i) {
            assert_int_equal((uint32_t)out[PROBE_IADD][i], (uint32_t)p[i] + (uint32_t)q[i]);
            assert_int_equal((uint32_t)out[PROBE_ISUB][i], (uint32_t)p[i] - (uint32_t)q[i]);
            assert_int_equal((uint32_t)out[PROBE_SLL][i], (uint32_t)p[i] << 23);
            assert_int_equal(out[PROBE_SRA][i], (int32_t)floor(p[i] / 128.0));
            assert_int_equal(out[PROBE_ROUND][i], (int32_t)nearbyintf(x[i]));
            assert_int_equal(out[PROBE_BITS][i], p[i]);
            assert_int_equal(out[PROBE_ISET1][i], p[0]);
            assert_int_equal(out[PROBE_LOOKUP][i], q[(uint32_t)p[i] % 8]);
            assert_true(back[i] == (float)p[i]);
        }
    }
}

static void compressed_lanes_keep_their_order_and_narrow_ones_their_value(void **state)
{
    (void)state;
    int32_t p[16] __attribute__((aligned(64))), out[17];
    int16_t narrow[17];
    for (int i = 0; i < 16; ++i)
        p[i] = (int32_t)(sgsi_random_bits(9, (uint64_t)i) & 0xFFFF) - 0x8000;
    for (int k = 0; k < probe_count; ++k) {
        for (unsigned mask = 0; mask < 0x10000; mask += mask < 64 ? 1 : 37) {
            unsigned expected = 0;
            const unsigned count = probes[k]->compress(p, mask, out + 1);
            for (int i = 0; i < 16; ++i) {
                if (mask >> i & 1)
                    assert_int_equal(out[1 + expected++], p[i]);
            }
            assert_int_equal(count, expected);
        }
        probes[k]->narrow(p, narrow + 1);
        for (int i = 0; i < 16; ++i)
            assert_int_equal(narrow[1 + i], p[i]);
    }
}

// Compared with the definition by counting; keys with many ties, nearly sorted keys and random
// keys.
static void rank_is_number_of_smaller_lanes(void **state)
{
    (void)state;
    enum { MAX_COUNT = 400 };
    static const uint64_t spans[3] = {0x8000, 9, 30};
    int16_t keys[MAX_COUNT + 32] __attribute__((aligned(64)));
    uint16_t ranks[MAX_COUNT + 32] __attribute__((aligned(64)));
    for (uint32_t count = 0; count <= MAX_COUNT; count += count < 70 ? 1 : 13) {
        for (uint32_t i = 0; i < MAX_COUNT; ++i)
            keys[i] =
                (int16_t)(sgsi_random_bits(count, i) % spans[count % 3] + (count % 3 == 2 ? i : 0));
        for (int k = 0; k < probe_count; ++k) {
            probes[k]->rank(keys, ranks, count);
            for (uint32_t i = 0; i < count; ++i) {
                uint32_t before = 0;
                for (uint32_t j = 0; j < count; ++j)
                    before += keys[j] < keys[i] || (keys[j] == keys[i] && j < i);
                assert_int_equal(ranks[i], before);
            }
        }
    }
}

static void bytes_become_floats_at_any_address(void **state)
{
    (void)state;
    uint8_t bytes[256 + 16];
    float out[16] __attribute__((aligned(64)));
    for (int i = 0; i < 272; ++i)
        bytes[i] = (uint8_t)(i * 89);
    for (int k = 0; k < probe_count; ++k) {
        for (int offset = 0; offset <= 256; ++offset) {
            probes[k]->load_u8(bytes + offset, out);
            for (int i = 0; i < 16; ++i)
                assert_true(out[i] == (float)bytes[offset + i]);
        }
    }
}

// ---- Across lanes ----

static float tree_sum(const float *x)
{
    float a[8], b[4];
    for (int i = 0; i < 8; ++i)
        a[i] = x[i] + x[i + 8];
    for (int i = 0; i < 4; ++i)
        b[i] = a[i] + a[i + 4];
    return (b[0] + b[2]) + (b[1] + b[3]);
}

static void sums_follow_the_documented_tree_to_the_bit(void **state)
{
    (void)state;
    float x[16][16] __attribute__((aligned(64))), out[16] __attribute__((aligned(64)));
    for (uint64_t seed = 0; seed < 300; ++seed) {
        fill(x[0], 256, seed, -1, 1);
        for (int i = 0; i < 16; ++i) // many magnitudes, so that any other tree differs
            for (int k = 0; k < 16; ++k)
                x[i][k] *= exp2f(random_float(99, seed * 256 + (uint64_t)(16 * i + k), -12, 12));
        for (int k = 0; k < probe_count; ++k) {
            for (int i = 0; i < 16; ++i)
                out[i] = (float)i;
            probes[k]->sum16((const float(*)[16])x, out);
            for (int i = 0; i < 16; ++i) {
                assert_int_equal(bits_of(probes[k]->sum(x[i])), bits_of(tree_sum(x[i])));
                assert_int_equal(bits_of(out[i]), bits_of((float)i + tree_sum(x[i])));
            }
        }
    }
}

static void transpose_moves_every_lane_to_its_place(void **state)
{
    (void)state;
    float x[16][16] __attribute__((aligned(64)));
    for (int k = 0; k < probe_count; ++k) {
        for (int i = 0; i < 16; ++i)
            for (int j = 0; j < 16; ++j)
                x[i][j] = (float)(16 * i + j);
        probes[k]->transpose(x);
        for (int i = 0; i < 16; ++i)
            for (int j = 0; j < 16; ++j)
                assert_true(x[i][j] == (float)(16 * j + i));
    }
}

static void avx2_and_avx512_give_the_same_bits(void **state)
{
    (void)state;
#ifdef SGSI_AVX_KERNELS
    if (!sgs_isa_supported(SGS_ISA_AVX512))
        skip_because("no AVX-512");
    const simd_probe *narrow = &simd_probe_avx2, *wide = &simd_probe_avx512;
    static float x[1 << 16] __attribute__((aligned(64))), y[1 << 16] __attribute__((aligned(64)));
    static float left[1 << 16] __attribute__((aligned(64))),
        right[1 << 16] __attribute__((aligned(64)));
    fill(x, 1 << 16, 10, -126, 126);
    fill(y, 1 << 16, 11, -3, 3);
    narrow->exp2(x, left, 1 << 16);
    wide->exp2(x, right, 1 << 16);
    assert_memory_equal(left, right, sizeof left);
    narrow->log2(right, left, 1 << 16);
    wide->log2(right, right, 1 << 16);
    assert_memory_equal(left, right, sizeof left);
    float a[PROBE_ARITHMETIC_COUNT][16] __attribute__((aligned(64))),
        b[PROBE_ARITHMETIC_COUNT][16] __attribute__((aligned(64)));
    for (size_t i = 0; i + 48 <= 1 << 16; i += 48) {
        narrow->arithmetic(x + i, y + i, x + i + 32, a);
        wide->arithmetic(x + i, y + i, x + i + 32, b);
        assert_memory_equal(a, b, sizeof a);
    }
#else
    skip_because("a build without AVX kernels");
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exp2_is_within_1_2e_7_of_double_over_its_whole_range),
        cmocka_unit_test(exp2_of_minus_127_is_zero),
        cmocka_unit_test(exp_is_as_good_as_exp2_where_products_are_exact),
        cmocka_unit_test(log2_is_within_2_5e_7_of_double_for_every_normal_number),
        cmocka_unit_test(arithmetic_is_ieee_and_fma_is_fused_on_vector_isas),
        cmocka_unit_test(halves_are_the_lanes_in_order),
        cmocka_unit_test(comparisons_select_and_minimum_agree_with_c_even_for_nan),
        cmocka_unit_test(between_leaves_the_lower_bound_out_and_nan),
        cmocka_unit_test(masks_are_sixteen_bits),
        cmocka_unit_test(integers_wrap_shift_and_round_to_even),
        cmocka_unit_test(compressed_lanes_keep_their_order_and_narrow_ones_their_value),
        cmocka_unit_test(rank_is_number_of_smaller_lanes),
        cmocka_unit_test(bytes_become_floats_at_any_address),
        cmocka_unit_test(sums_follow_the_documented_tree_to_the_bit),
        cmocka_unit_test(transpose_moves_every_lane_to_its_place),
        cmocka_unit_test(avx2_and_avx512_give_the_same_bits),
    };
    return cmocka_run_group_tests(tests, find_probes, NULL);
}
