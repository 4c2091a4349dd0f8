// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The lists of a tile's blocks. Candidates of the tile are tested against a block sixteen at a
// time, with the bounds of kernel_tile.inl, and sorted by t on the block's centre ray. The order
// affects how many pairs a pixel finds swapped, but not the image, except at equal t. Fifteen bits
// of t therefore suffice; equal keys stay near to far by |delta|, then by id.

// Sort keys: five bits of the float's exponent, from 2^-12, and ten bits of its mantissa.
enum { KEY_DROPPED_BITS = 13, KEY_ORIGIN = (127 - 12) << (23 - KEY_DROPPED_BITS) };
#define KEY_MIN 0x1p-12f
#define KEY_MAX 0x1.fffp19f

// Lists up to this length are sorted by rank: each key is compared with all others, 32 at a time.
// Without branches this is faster than moving the keys.
enum { RANK_SORT_MAX = 512 };

// Sixteen candidates and the terms of their tests that are the same for all blocks of the tile. The
// half extents are those of the largest block, so the test is conservative for smaller ones.
typedef struct candidates16 {
    vf r[16];          // tile records, transposed
    vf half_u, half_v; // of a block
    vf c_half;         // bound on C minus its value at the block's centre
    vf reach;          // q
    vf stretch;        // 1 + q^2 / kappa
} candidates16;

static inline void load_candidates16(const float *projected, vf half_u, vf half_v, candidates16 *x)
{
    for (size_t k = 0; k < 16; ++k)
        x->r[k] = vf_load(projected + k * 16);
    vf_transpose16(x->r);
    // Margins for rounding: of |n|^2 - s, and of the comparison.
    x->half_u = vf_mul(half_u, vf_set1(1.0003f));
    x->half_v = vf_mul(half_v, vf_set1(1.0003f));
    x->c_half = vf_fma(vf_abs(x->r[7]), half_u, vf_mul(vf_abs(x->r[8]), half_v));
    x->reach = vf_mul(x->r[SGSI_PROJECTED_REACH], vf_set1(1.0007f));
    x->stretch = vf_fma(vf_mul(x->r[SGSI_PROJECTED_REACH], x->r[SGSI_PROJECTED_REACH]),
                        x->r[SGSI_PROJECTED_INV_KAPPA], vf_set1(1.0f));
}

// Mask of the candidates that can hit the block with centre (u, v), and their sort keys.
static inline vm test_block(const candidates16 *x, vf u, vf v, vi *key)
{
    const vf *r = x->r;
    const vf a = vf_fma(v, r[2], vf_fma(u, r[1], r[0]));
    const vf b = vf_fma(v, r[5], vf_fma(u, r[4], r[3]));
    const vf c = vf_fma(v, r[8], vf_fma(u, r[7], r[6]));
    const vf c_max = vf_add(c, x->c_half);
    const vf n2 = vf_fma(a, a, vf_mul(b, b));
    const vf s_u = vf_abs(vf_fma(a, r[1], vf_mul(b, r[4]))),
             s_v = vf_abs(vf_fma(a, r[2], vf_mul(b, r[5])));
    const vf low = vf_max(vf_fnma(s_v, x->half_v, vf_fnma(s_u, x->half_u, n2)), vf_zero());
    const vf reach = vf_mul(x->reach, c_max);
    const vm keep =
        vm_and(vf_le(vf_mul(low, low), vf_mul(n2, vf_mul(reach, reach))), vf_gt(c_max, vf_zero()));
    // t = |delta| C / G at the block's centre, or the lower bound of the block, |delta| / far, if
    // larger: one division for both.
    const vf g = vf_fma(r[SGSI_PROJECTED_INV_KAPPA], n2, vf_mul(c, c)),
             far = vf_mul(c_max, x->stretch);
    const vm centre = vf_ge(vf_mul(c, far), g);
    const vf t =
        vf_div(vf_select(centre, vf_mul(r[SGSI_PROJECTED_DISTANCE], c), r[SGSI_PROJECTED_DISTANCE]),
               vf_select(centre, g, far));
    const vf distance = vf_clamp(t, vf_set1(KEY_MIN), vf_set1(KEY_MAX));
    *key = vi_sub(vi_sra(vf_as_vi(distance), KEY_DROPPED_BITS), vi_set1(KEY_ORIGIN));
    return keep;
}

// Appends the tile's candidates to the lists of the blocks they can hit.
static void list_blocks(sgsi_scratch *scratch, const sgsi_tile_rays *rays, size_t count)
{
    static const int32_t lanes[16]
        __attribute__((aligned(64))) = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    const vf half_u = vf_set1(rays->max_half_u), half_v = vf_set1(rays->max_half_v);
    for (size_t i = 0; i < count; i += 16) {
        candidates16 x; // rows past the end are masked by `present`
        load_candidates16(scratch->tile_projected + i * 16, half_u, half_v, &x);
        const vm present = vm_from_bits(count - i < 16 ? (1u << (count - i)) - 1u : 0xFFFFu);
        const vi indices = vi_add(vi_load(lanes), vi_set1((int32_t)i));
        for (int b = 0; b < SGSI_BLOCKS; ++b) {
            vi key;
            const vm keep =
                vm_and(test_block(&x, vf_set1(rays->block_u[b]), vf_set1(rays->block_v[b]), &key),
                       present);
            if (!vm_any(keep) || !rays->valid[b])
                continue;
            const size_t at = (size_t)b * scratch->capacity + scratch->entry_count[b];
            vi_compress_store(scratch->entry_keys + at, keep, key);
            scratch->entry_count[b] +=
                vi_compress_store((int32_t *)scratch->entries + at, keep, indices);
        }
    }
}

static void rank_sort(const int32_t *keys, const uint32_t *values, uint32_t *out, uint32_t count)
{
    int16_t narrow[RANK_SORT_MAX + 32] __attribute__((aligned(64)));
    uint16_t ranks[RANK_SORT_MAX + 32] __attribute__((aligned(64)));
    int16_t min_keys[RANK_SORT_MAX / 32], max_keys[RANK_SORT_MAX / 32];
    for (uint32_t i = 0; i < count; i += 16)
        vi_store_i16(narrow + i, vi_load_u(keys + i));
    simd_extremes(narrow, count, min_keys, max_keys);
    simd_rank(narrow, ranks, count, min_keys, max_keys);
    for (uint32_t i = 0; i < count; ++i)
        out[ranks[i]] = values[i];
}

static void long_sort(const int32_t *keys, const uint32_t *values, uint32_t *out, uint64_t *spare,
                      uint32_t count)
{
    for (uint32_t i = 0; i < count; ++i)
        spare[i] = (uint64_t)(uint32_t)keys[i] << 32 | values[i];
    sgsi_radix_pass(spare, spare + count, count, 0, 32, 8);
    sgsi_radix_pass(spare + count, spare, count, 0, 40, 8);
    for (uint32_t i = 0; i < count; ++i)
        out[i] = (uint32_t)spare[i];
}

static void tile_sort(sgsi_scratch *scratch, const sgsi_tile_rays *rays, size_t count)
{
    memset(scratch->entry_count, 0, sizeof scratch->entry_count);
    list_blocks(scratch, rays, count);
    for (int b = 0; b < SGSI_BLOCKS; ++b) {
        const size_t at = (size_t)b * scratch->capacity;
        if (scratch->entry_count[b] <= RANK_SORT_MAX)
            rank_sort(scratch->entry_keys + at, scratch->entries + at, scratch->order + at,
                      scratch->entry_count[b]);
        else
            long_sort(scratch->entry_keys + at, scratch->entries + at, scratch->order + at,
                      scratch->sort_spare, scratch->entry_count[b]);
    }
}
