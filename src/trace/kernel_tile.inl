// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// From the primitives reported by the BVH to the candidates of a tile. Sixteen primitives at a time
// are transformed to the frame of their macrotile and tested against each of its tiles.
// (kernel_sort.inl tests the candidates of a tile against its blocks in the same way.)
//
// A test bounds the response over a rectangle |u - uc| <= hu, |v - vc| <= hv. Let n = (A, B) at the
// centre and A_u, A_v the derivatives of A. Over the rectangle
//     sqrt(A^2 + B^2) >= n.(A, B) / |n| >= |n| - s / |n|,
//     s = |n.(A_u, B_u)| hu + |n.(A_v, B_v)| hv.
// A hit requires E <= Emax = log2(255 o), that is
//     A^2 + B^2 <= q^2 C^2,    q^2 = Emax / (1 - Emax / kappa).
// If the camera is inside the support (Emax >= kappa), any ray can hit. C is at t_max Cmax, and t >
// 0 requires C > 0. A hit is therefore impossible unless |n|^2 - s <= |n| q Cmax. The same bounds
// limit the distance: t >= |delta| / (Cmax (1 + q^2 / kappa)). A compact box applies a fraction of
// Emax when it assigns primitives to tiles; inside the tile the full support counts.

typedef struct macrotile_frame16 {
    vec3 d0, e1, e2;
} macrotile_frame16;

static inline macrotile_frame16 broadcast_frame(const float f[9])
{
    return (macrotile_frame16){{vf_set1(f[0]), vf_set1(f[1]), vf_set1(f[2])},
                               {vf_set1(f[3]), vf_set1(f[4]), vf_set1(f[5])},
                               {vf_set1(f[6]), vf_set1(f[7]), vf_set1(f[8])}};
}

// Rows 0..14 of sixteen primitives in the frame of a macrotile; the caller fills row 15. If
// `present` < 16, the remaining lanes are untraced.
static inline void frame_rows(const float *projected, const uint32_t *ids, size_t present,
                              const macrotile_frame16 *frame, vf out[16])
{
    static const float untraced[16]
        __attribute__((aligned(64))) = {[SGSI_PROJECTED_LOG_OPACITY] = SGSI_UNTRACED};
    vf r[16];
    for (size_t k = 0; k < 16; ++k)
        r[k] = vf_load(k < present ? projected + (size_t)ids[k] * SGSI_PROJECTED_FLOATS : untraced);
    vf_transpose16(r);
    for (int k = 0; k < 3; ++k) {
        const vec3 row = {r[3 * k], r[3 * k + 1], r[3 * k + 2]};
        out[3 * k] = dot3(row, frame->d0);
        out[3 * k + 1] = dot3(row, frame->e1);
        out[3 * k + 2] = dot3(row, frame->e2);
    }
    for (int k = SGSI_PROJECTED_LOG_OPACITY; k < SGSI_PROJECTED_REACH; ++k)
        out[k] = r[k];
}

// q^2 for hits with E <= e.
static inline vf support_slope2(vf e, vf inv_kappa)
{
    const vf room = vf_fnma(e, inv_kappa, vf_set1(1.0f)); // 1 - E / kappa
    const vm outside = vf_gt(room, vf_set1(1e-3f));
    return vf_max(vf_select(outside, vf_div(e, room), vf_set1(1e18f)), vf_zero());
}

// Mask of the primitives that can hit a tile. *in_bound: those that can hit it in front of `far`.
static inline vm test_tile(const vf r[16], const sgsi_tile_rays *tile, vf reach2, vf stretch,
                           float far, vm *in_bound)
{
    const vf u = vf_set1(tile->center_u), v = vf_set1(tile->center_v);
    const vf half_u = vf_set1(tile->half_u), half_v = vf_set1(tile->half_v);
    const vf a = vf_fma(v, r[2], vf_fma(u, r[1], r[0]));
    const vf b = vf_fma(v, r[5], vf_fma(u, r[4], r[3]));
    const vf c = vf_fma(v, r[8], vf_fma(u, r[7], r[6]));
    const vf c_max = vf_fma(vf_abs(r[7]), half_u, vf_fma(vf_abs(r[8]), half_v, c));
    const vf n2 = vf_fma(a, a, vf_mul(b, b));
    const vf s = vf_fma(vf_abs(vf_fma(a, r[1], vf_mul(b, r[4]))), half_u,
                        vf_mul(vf_abs(vf_fma(a, r[2], vf_mul(b, r[5]))), half_v));
    const vf low = vf_max(vf_fnma(s, vf_set1(1.0001f), vf_mul(n2, vf_set1(0.9999f))), vf_zero());
    const vf reach = vf_mul(vf_mul(c_max, c_max), reach2);
    const vm overlaps = vm_and(vf_le(vf_mul(low, low), vf_mul(n2, vf_mul(reach, vf_set1(1.001f)))),
                               vf_gt(c_max, vf_zero()));
    // t >= |delta| / (Cmax (1 + q^2 / kappa)), without the division; in units of |d|.
    const vf t_max = vf_set1(far * SGSI_DEPTH_MARGIN / tile->min_length);
    *in_bound =
        vm_and(overlaps, vf_le(r[SGSI_PROJECTED_DISTANCE], vf_mul(t_max, vf_mul(c_max, stretch))));
    return overlaps;
}

static size_t macrotile_filter(sgsi_scratch *scratch, const float *projected, const uint32_t *ids,
                               size_t count, const sgsi_macrotile *macrotile)
{
    const macrotile_frame16 frame = broadcast_frame(macrotile->tiles[0]->frame);
    const vf one = vf_set1(1.0f), zero = vf_zero();
    float *restrict rows = scratch->macrotile_projected;
    size_t kept = 0;
    for (size_t i = 0; i < count; i += 16) {
        vf r[16];
        frame_rows(projected, ids + i, count - i, &frame, r);
        const vf e_max = vf_add(r[SGSI_PROJECTED_LOG_OPACITY], vf_set1(SGSI_LOG2_255));
        const vf q2 = support_slope2(e_max, r[SGSI_PROJECTED_INV_KAPPA]),
                 stretch = vf_fma(q2, r[SGSI_PROJECTED_INV_KAPPA], one);
        const vf reach2 = macrotile->compact_box < 1.0f
                              ? support_slope2(vf_mul(e_max, vf_set1(macrotile->compact_box)),
                                               r[SGSI_PROJECTED_INV_KAPPA])
                              : q2;
        r[SGSI_PROJECTED_REACH] = vf_sqrt(q2);
        const vm traced = vf_ge(e_max, zero);
        vm any = vm_none();
        vi tiles = vi_set1(0);
        for (int k = 0; k < macrotile->count; ++k) {
            vm in_bound;
            const vm overlaps = vm_and(
                test_tile(r, macrotile->tiles[k], reach2, stretch, macrotile->far[k], &in_bound),
                traced);
            any = vm_or(any, macrotile->complete ? overlaps : vm_and(in_bound, traced));
            tiles = vi_add(tiles, vf_as_vi(vf_keep(
                                      overlaps, vi_as_vf(vi_set1((int32_t)(SGSI_OVERLAPS << k))))));
            tiles = vi_add(tiles, vf_as_vi(vf_keep(
                                      in_bound, vi_as_vf(vi_set1((int32_t)(SGSI_IN_BOUND << k))))));
        }
        const unsigned bits = vm_bits(any);
        if (!bits)
            continue;
        vi_compress_store((int32_t *)scratch->macrotile_tiles + kept, any, tiles);
        vi_compress_store((int32_t *)scratch->macrotile_ids + kept, any,
                          vi_load_u((const int32_t *)ids + i));
        vi_compress_store((int32_t *)scratch->macrotile_distance + kept, any,
                          vf_as_vi(r[SGSI_PROJECTED_DISTANCE]));
        vf_transpose16(r);
        // Every row is written to the next free place, kept or not: the outcome is too hard to
        // predict for a branch.
#pragma GCC unroll 16
        for (unsigned k = 0; k < 16; ++k) {
            vf_store(rows + kept * 16, r[k]);
            kept += bits >> k & 1;
        }
    }
    return kept;
}

static size_t tile_take(sgsi_scratch *scratch, size_t count, unsigned tile)
{
    uint32_t *restrict index = scratch->entries; // free until list_blocks
    size_t taken = 0;
    for (size_t i = 0; i < count; ++i) {
        const uint32_t k = scratch->macrotile_order[i];
        index[taken] = k;
        taken += (scratch->macrotile_tiles[k] & tile) != 0;
    }
    for (size_t i = 0; i < taken; ++i) {
        vf_store(scratch->tile_projected + i * 16,
                 vf_load(scratch->macrotile_projected + (size_t)index[i] * 16));
        scratch->tile_ids[i] = scratch->macrotile_ids[index[i]];
    }
    return taken;
}
