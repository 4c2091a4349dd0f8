// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One table of plain functions per instruction set, each compiled from simd_probe.inl, so that
// test_simd.c can test every operation of src/simd/simd.h through ordinary arrays. All arrays are
// 64-byte aligned.

#include <stddef.h>
#include <stdint.h>

// Rows of `arithmetic`.
enum {
    PROBE_ADD,
    PROBE_SUB,
    PROBE_MUL,
    PROBE_DIV,
    PROBE_FMA,
    PROBE_FNMA,
    PROBE_FMS,
    PROBE_SQRT,
    PROBE_ABS,
    PROBE_CLAMP,
    PROBE_ARITHMETIC_COUNT
};

// Words of `masks`, 16 bits each: comparisons of x and y, then logic of the bit patterns a and b.
enum {
    PROBE_LT,
    PROBE_LE,
    PROBE_GT,
    PROBE_GE,
    PROBE_AND,
    PROBE_OR,
    PROBE_ANDNOT,
    PROBE_NOT,
    PROBE_NONE,
    PROBE_ANY_A,
    PROBE_ANY_NONE,
    PROBE_MASK_COUNT
};

// Rows of `lanes`.
enum {
    PROBE_MIN,
    PROBE_MAX,
    PROBE_SELECT,
    PROBE_KEEP,
    PROBE_STORE_MASKED,
    PROBE_COPY_UNALIGNED,
    PROBE_SET1,
    PROBE_LANE_COUNT
};

// Rows of `integers`.
enum {
    PROBE_IADD,
    PROBE_ISUB,
    PROBE_SLL,
    PROBE_SRA,
    PROBE_ROUND,
    PROBE_BITS,
    PROBE_ISET1,
    PROBE_LOOKUP,
    PROBE_INTEGER_COUNT
};

// Rows of `halves`.
enum {
    PROBE_HALF_ADD,
    PROBE_HALF_MUL,
    PROBE_HALF_FMA,
    PROBE_HALF_FNMA,
    PROBE_HALF_LOAD,
    PROBE_HALF_ZERO,
    PROBE_HALF_COUNT
};

enum { PROBE_KEYS_MAX = 512 };

typedef struct simd_probe {
    const char *name;
    void (*exp2)(const float *x, float *y, size_t count); // count: a multiple of 16
    void (*log2)(const float *x, float *y, size_t count);
    void (*exp)(const float *x, float *y, size_t count);
    void (*arithmetic)(const float *x, const float *y, const float *z,
                       float out[PROBE_ARITHMETIC_COUNT][16]);
    // Each half separately, and joined again.
    void (*halves)(const float *x, const float *y, const float *z, float out[PROBE_HALF_COUNT][16]);
    void (*masks)(const float *x, const float *y, unsigned a, unsigned b,
                  unsigned out[PROBE_MASK_COUNT]);
    unsigned (*between)(const float *x, const float *low, const float *high);
    // STORE_MASKED writes x over -1; COPY_UNALIGNED uses odd addresses; SET1 broadcasts x[0].
    void (*lanes)(const float *x, const float *y, unsigned mask, float out[PROBE_LANE_COUNT][16]);
    // SLL by 23, SRA by 7; ROUND: floats to integers; BITS: round trip through vi_as_vf; ISET1
    // broadcasts p[0]; LOOKUP: in the first eight of q.
    void (*integers)(const int32_t *p, const int32_t *q, const float *x,
                     int32_t out[PROBE_INTEGER_COUNT][16]);
    void (*to_float)(const int32_t *p, float *out);
    float (*sum)(const float *x);
    void (*sum16)(const float x[16][16], float out[16]); // adds to out
    void (*transpose)(float x[16][16]);
    void (*load_u8)(const uint8_t *p, float out[16]);                    // p: any address
    unsigned (*compress)(const int32_t *p, unsigned mask, int32_t *out); // out: [16], any address
    void (*narrow)(const int32_t *p, int16_t *out);                      // out: [16], any address
    void (*rank)(const int16_t *keys, uint16_t *ranks, uint32_t count);  // count <= PROBE_KEYS_MAX
} simd_probe;

extern const simd_probe simd_probe_baseline, simd_probe_avx2, simd_probe_avx512;
