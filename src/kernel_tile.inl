// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// From the bin's candidates to the lists of a tile's blocks: sixteen candidates per step are tested
// against the tile, then, again sixteen per step, against each of the tile's blocks.
//
// Both tests bound the response over a rectangle |u - uc| <= hu, |v - vc| <= hv. With n = (A, B) at
// the centre, sqrt(A^2 + B^2) over the rectangle is at least n.(A, B) / |n| >= |n| - s / |n|, s =
// |n.(A1, B1)| hu + |n.(A2, B2)| hv. A hit needs E <= Emax = log2(255 o), that is A^2 + B^2 <= q^2
// C^2 with q^2 = Emax / (1 - Emax / kappa); inside the support (Emax >= kappa) anything goes. C is
// at most Cmax, and t > 0 needs C > 0. So a hit is impossible unless |n|^2 - s <= |n| q Cmax. The
// same bounds give a hit's distance: t >= |delta| / (Cmax (1 + q^2 / kappa)). A compact box asks
// with a share of Emax whether the tile gets the primitive; in the tile it counts as ever.

static void load_candidates(sgsi_scratch *scratch, const float *records, size_t count)
{
    for (size_t i = 0; i < count; i += 16) {
        vf rows[16];
        for (size_t k = 0; k < 16; ++k) {
            if (i + k < count) {
                rows[k] = vf_load(records + (size_t)scratch->candidates[i + k] * SGSI_RECORD);
            } else {
                float untraced[16] __attribute__((aligned(64))) = {0};
                untraced[SGSI_RECORD_LOG_OPACITY] = SGSI_UNTRACED;
                rows[k] = vf_load(untraced);
            }
        }
        vf_transpose16(rows);
        for (size_t k = 0; k < 16; ++k)
            vf_store(scratch->soa + (i + k) * 16, rows[k]);
    }
}

typedef struct tile_frame16 {
    vec3 d0, e1, e2;
} tile_frame16;

static inline tile_frame16 broadcast_frame(const float f[9])
{
    return (tile_frame16){{vf_set1(f[0]), vf_set1(f[1]), vf_set1(f[2])},
                          {vf_set1(f[3]), vf_set1(f[4]), vf_set1(f[5])},
                          {vf_set1(f[6]), vf_set1(f[7]), vf_set1(f[8])}};
}

// Fills rows[0..14] with the tile's coefficients of sixteen candidates; row 15 is the caller's.
static inline void tile_coefficients(const float *soa, const tile_frame16 *frame, vf rows[16])
{
    for (int k = 0; k < 3; ++k) {
        const vec3 row = {vf_load(soa + 16 * (3 * k)), vf_load(soa + 16 * (3 * k + 1)),
                          vf_load(soa + 16 * (3 * k + 2))};
        rows[3 * k] = dot3(row, frame->d0);
        rows[3 * k + 1] = dot3(row, frame->e1);
        rows[3 * k + 2] = dot3(row, frame->e2);
    }
    for (int k = SGSI_RECORD_LOG_OPACITY; k < SGSI_RECORD_REACH; ++k)
        rows[k] = vf_load(soa + 16 * k);
}

// q^2 of the hits with E <= e.
static inline vf support_slope2(vf e, vf inv_kappa)
{
    const vf room = vf_fnma(e, inv_kappa, vf_set1(1.0f)); // 1 - E / kappa
    const vm outside = vf_gt(room, vf_set1(1e-3f));
    return vf_select(outside, vf_div(e, room), vf_set1(1e18f));
}

static size_t tile_filter(sgsi_scratch *scratch, const sgsi_tile_rays *rays, size_t candidate_count,
                          float far, float compact_box)
{
    const tile_frame16 frame = broadcast_frame(rays->frame);
    const vf hu = vf_set1(rays->half_u), hv = vf_set1(rays->half_v), far16 = vf_set1(far);
    float *restrict records = scratch->tile_records;
    uint32_t *restrict ids = scratch->tile_ids;
    const vf one = vf_set1(1.0f), zero = vf_zero(), share = vf_set1(compact_box);
    size_t count = 0;
    for (size_t i = 0; i < candidate_count; i += 16) {
        vf r[16];
        tile_coefficients(scratch->soa + i * 16, &frame, r);
        const vf e_max = vf_add(r[9], vf_set1(SGSI_LOG2_255));
        const vf q2 = support_slope2(e_max, r[10]);
        r[15] = vf_sqrt(vf_max(q2, zero));
        const vf c_max = vf_fma(vf_abs(r[7]), hu, vf_fma(vf_abs(r[8]), hv, r[6]));
        const vf n2 = vf_fma(r[0], r[0], vf_mul(r[3], r[3]));
        const vf s = vf_fma(vf_abs(vf_fma(r[0], r[1], vf_mul(r[3], r[4]))), hu,
                            vf_mul(vf_abs(vf_fma(r[0], r[2], vf_mul(r[3], r[5]))), hv));
        const vf low = vf_max(vf_fnma(s, vf_set1(1.0001f), vf_mul(n2, vf_set1(0.9999f))), zero);
        const vf reach = vf_mul(r[15], c_max);
        vf reach2 = vf_mul(reach, reach);
        if (compact_box < 1.0f)
            reach2 = vf_mul(vf_max(support_slope2(vf_mul(e_max, share), r[10]), zero),
                            vf_mul(c_max, c_max));
        vm keep = vf_le(vf_mul(low, low), vf_mul(n2, vf_mul(reach2, vf_set1(1.001f))));
        keep = vm_and(keep, vm_and(vf_ge(e_max, zero), vf_gt(c_max, zero)));
        // t >= |delta| / (Cmax (1 + q^2 / kappa)), written without the division.
        keep = vm_and(keep, vf_le(r[11], vf_mul(far16, vf_mul(c_max, vf_fma(q2, r[10], one)))));
        const unsigned bits = vm_bits(keep);
        if (!bits)
            continue;
        vf_transpose16(r);
        const uint32_t *const candidates = scratch->candidates + i;
        // Every row is written where the next one to keep belongs: whether a candidate stays is
        // too hard to predict for a branch.
#pragma GCC unroll 16
        for (unsigned k = 0; k < 16; ++k) {
            vf_store(records + count * 16, r[k]);
            ids[count] = candidates[k];
            count += bits >> k & 1;
        }
    }
    return count;
}
