// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The functions of simd_probe.h for one instruction set. Included by simd_probe_<isa>.c, which
// defines SGSI_ISA.

#include "simd/simd.h"
#include "simd/simd_probe.h"

static void probe_exp2(const float *x, float *y, size_t count)
{
    for (size_t i = 0; i < count; i += 16)
        vf_store(y + i, vf_exp2(vf_load(x + i)));
}

static void probe_log2(const float *x, float *y, size_t count)
{
    for (size_t i = 0; i < count; i += 16)
        vf_store(y + i, vf_log2(vf_load(x + i)));
}

static void probe_exp(const float *x, float *y, size_t count)
{
    for (size_t i = 0; i < count; i += 16)
        vf_store(y + i, vf_exp(vf_load(x + i)));
}

static void probe_arithmetic(const float *px, const float *py, const float *pz,
                             float out[PROBE_ARITHMETIC_COUNT][16])
{
    const vf x = vf_load(px), y = vf_load(py), z = vf_load(pz);
    vf_store(out[PROBE_ADD], vf_add(x, y));
    vf_store(out[PROBE_SUB], vf_sub(x, y));
    vf_store(out[PROBE_MUL], vf_mul(x, y));
    vf_store(out[PROBE_DIV], vf_div(x, y));
    vf_store(out[PROBE_FMA], vf_fma(x, y, z));
    vf_store(out[PROBE_FNMA], vf_fnma(x, y, z));
    vf_store(out[PROBE_FMS], vf_fms(x, y, z));
    vf_store(out[PROBE_SQRT], vf_sqrt(vf_abs(x)));
    vf_store(out[PROBE_ABS], vf_abs(x));
    vf_store(out[PROBE_CLAMP], vf_clamp(x, vf_set1(-0.25f), vf_set1(0.5f)));
}

static void probe_halves(const float *px, const float *py, const float *pz,
                         float out[PROBE_HALF_COUNT][16])
{
    vh x[2], y[2], z[2], rows[PROBE_HALF_COUNT][2];
    vf_halves(vf_load(px), x);
    vf_halves(vf_load(py), y);
    vf_halves(vf_load(pz), z);
    for (int k = 0; k < 2; ++k) {
        rows[PROBE_HALF_ADD][k] = vh_add(x[k], y[k]);
        rows[PROBE_HALF_MUL][k] = vh_mul(x[k], y[k]);
        rows[PROBE_HALF_FMA][k] = vh_fma(x[k], y[k], z[k]);
        rows[PROBE_HALF_FNMA][k] = vh_fnma(x[k], y[k], z[k]);
        rows[PROBE_HALF_LOAD][k] = vh_load(px + 8 * (size_t)k);
        rows[PROBE_HALF_ZERO][k] = vh_zero();
    }
    for (int i = 0; i < PROBE_HALF_COUNT; ++i)
        vf_store(out[i], vf_join(rows[i]));
}

static void probe_masks(const float *px, const float *py, unsigned a, unsigned b,
                        unsigned out[PROBE_MASK_COUNT])
{
    const vf x = vf_load(px), y = vf_load(py);
    const vm ma = vm_from_bits(a), mb = vm_from_bits(b);
    out[PROBE_LT] = vm_bits(vf_lt(x, y));
    out[PROBE_LE] = vm_bits(vf_le(x, y));
    out[PROBE_GT] = vm_bits(vf_gt(x, y));
    out[PROBE_GE] = vm_bits(vf_ge(x, y));
    out[PROBE_AND] = vm_bits(vm_and(ma, mb));
    out[PROBE_OR] = vm_bits(vm_or(ma, mb));
    out[PROBE_ANDNOT] = vm_bits(vm_andnot(ma, mb));
    out[PROBE_NOT] = vm_bits(vm_not(ma));
    out[PROBE_NONE] = vm_bits(vm_none());
    out[PROBE_ANY_A] = vm_any(ma) != 0;
    out[PROBE_ANY_NONE] = vm_any(vm_none()) != 0;
}

static unsigned probe_between(const float *x, const float *low, const float *high)
{
    return vm_bits(vf_between(vf_load(x), vf_load(low), vf_load(high)));
}

static void probe_lanes(const float *px, const float *py, unsigned mask,
                        float out[PROBE_LANE_COUNT][16])
{
    const vf x = vf_load(px), y = vf_load(py);
    const vm m = vm_from_bits(mask);
    float odd[34];
    vf_store(out[PROBE_MIN], vf_min(x, y));
    vf_store(out[PROBE_MAX], vf_max(x, y));
    vf_store(out[PROBE_SELECT], vf_select(m, x, y));
    vf_store(out[PROBE_KEEP], vf_keep(m, x));
    vf_store(out[PROBE_STORE_MASKED], vf_set1(-1.0f));
    vf_store_masked(out[PROBE_STORE_MASKED], m, x);
    vf_store_u(odd + 1, x);
    vf_store_u(odd + 18, vf_load_u(odd + 1));
    vf_store(out[PROBE_COPY_UNALIGNED], vf_load_u(odd + 18));
    vf_store(out[PROBE_SET1], vf_set1(px[0]));
}

static void probe_integers(const int32_t *pp, const int32_t *pq, const float *x,
                           int32_t out[PROBE_INTEGER_COUNT][16])
{
    const vi p = vi_load(pp), q = vi_load(pq);
    vi_store(out[PROBE_IADD], vi_add(p, q));
    vi_store(out[PROBE_ISUB], vi_sub(p, q));
    vi_store(out[PROBE_SLL], vi_sll(p, 23));
    vi_store(out[PROBE_SRA], vi_sra(p, 7));
    vi_store(out[PROBE_ROUND], vf_to_vi(vf_load(x)));
    vi_store(out[PROBE_BITS], vf_as_vi(vi_as_vf(p)));
    vi_store(out[PROBE_ISET1], vi_set1(pp[0]));
    vi_store(out[PROBE_LOOKUP], vi_lookup8(pq, p));
}

static void probe_to_float(const int32_t *p, float *out)
{
    vf_store(out, vi_to_vf(vi_load(p)));
}

static float probe_sum(const float *x)
{
    return vf_sum(vf_load(x));
}

static void probe_sum16(const float x[16][16], float out[16])
{
    vh halves[16];
    for (int i = 0; i < 16; ++i)
        halves[i] = vf_fold(vf_load(x[i]));
    vh_add_sums(out, halves);
}

static void probe_transpose(float x[16][16])
{
    vf rows[16];
    for (int i = 0; i < 16; ++i)
        rows[i] = vf_load(x[i]);
    vf_transpose16(rows);
    for (int i = 0; i < 16; ++i)
        vf_store(x[i], rows[i]);
}

static void probe_load_u8(const uint8_t *p, float out[16])
{
    vf_store(out, vf_load_u8(p));
}

static unsigned probe_compress(const int32_t *p, unsigned mask, int32_t *out)
{
    return vi_compress_store(out, vm_from_bits(mask), vi_load_u(p));
}

static void probe_narrow(const int32_t *p, int16_t *out)
{
    vi_store_i16(out, vi_load(p));
}

static void probe_rank(const int16_t *keys, uint16_t *ranks, uint32_t count)
{
    int16_t least[PROBE_KEYS_MAX / 32], most[PROBE_KEYS_MAX / 32];
    simd_extremes(keys, count, least, most);
    simd_rank(keys, ranks, count, least, most);
}

const simd_probe SGSI_KERNEL(simd_probe) = {
    .name = SGSI_ISA == 2   ? "avx512"
            : SGSI_ISA == 1 ? "avx2"
                            : "baseline",
    .exp2 = probe_exp2,
    .log2 = probe_log2,
    .exp = probe_exp,
    .arithmetic = probe_arithmetic,
    .halves = probe_halves,
    .masks = probe_masks,
    .between = probe_between,
    .lanes = probe_lanes,
    .integers = probe_integers,
    .to_float = probe_to_float,
    .sum = probe_sum,
    .sum16 = probe_sum16,
    .transpose = probe_transpose,
    .load_u8 = probe_load_u8,
    .compress = probe_compress,
    .narrow = probe_narrow,
    .rank = probe_rank,
};
