// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// From the bin's candidates to the lists of a tile's blocks: sixteen candidates per step are tested against
// the tile, then each survivor against the sixteen blocks at once.
//
// Both tests bound the response over a rectangle |u - uc| <= hu, |v - vc| <= hv. With n = (A, B) at the centre,
// sqrt(A^2 + B^2) over the rectangle is at least n.(A, B) / |n| >= |n| - s / |n|,
// s = |n.(A1, B1)| hu + |n.(A2, B2)| hv. A hit needs E <= Emax = log2(255 o), that is
// A^2 + B^2 <= q^2 C^2 with q^2 = Emax / (1 - Emax / kappa); inside the support (Emax >= kappa) anything goes.
// C is at most Cmax, and t > 0 needs C > 0. So a hit is impossible unless |n|^2 - s <= |n| q Cmax.
// The same bounds give a hit's distance: t >= |delta| / (Cmax (1 + q^2 / kappa)).

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
        const vec3 row = {vf_load(soa + 16 * (3 * k)), vf_load(soa + 16 * (3 * k + 1)), vf_load(soa + 16 * (3 * k + 2))};
        rows[3 * k] = dot3(row, frame->d0);
        rows[3 * k + 1] = dot3(row, frame->e1);
        rows[3 * k + 2] = dot3(row, frame->e2);
    }
    for (int k = SGSI_RECORD_LOG_OPACITY; k < SGSI_RECORD_REACH; ++k)
        rows[k] = vf_load(soa + 16 * k);
}

static size_t tile_filter(sgsi_scratch *scratch, const sgsi_tile_rays *rays, size_t candidate_count, float far)
{
    const tile_frame16 frame = broadcast_frame(rays->frame);
    const vf hu = vf_set1(rays->half_u), hv = vf_set1(rays->half_v), far16 = vf_set1(far);
    const vf one = vf_set1(1.0f), zero = vf_zero();
    size_t count = 0;
    for (size_t i = 0; i < candidate_count; i += 16) {
        vf r[16];
        tile_coefficients(scratch->soa + i * 16, &frame, r);
        const vf e_max = vf_add(r[9], vf_set1(SGSI_LOG2_255));
        const vf room = vf_fnma(e_max, r[10], one); // 1 - Emax / kappa
        const vm outside = vf_gt(room, vf_set1(1e-3f));
        const vf q2 = vf_select(outside, vf_div(e_max, room), vf_set1(1e18f));
        r[15] = vf_sqrt(vf_max(q2, zero));
        const vf c_max = vf_fma(vf_abs(r[7]), hu, vf_fma(vf_abs(r[8]), hv, r[6]));
        const vf n2 = vf_fma(r[0], r[0], vf_mul(r[3], r[3]));
        const vf s = vf_fma(vf_abs(vf_fma(r[0], r[1], vf_mul(r[3], r[4]))), hu,
                            vf_mul(vf_abs(vf_fma(r[0], r[2], vf_mul(r[3], r[5]))), hv));
        const vf low = vf_max(vf_fnma(s, vf_set1(1.0001f), vf_mul(n2, vf_set1(0.9999f))), zero);
        const vf reach = vf_mul(r[15], c_max);
        vm keep = vf_le(vf_mul(low, low), vf_mul(n2, vf_mul(vf_mul(reach, reach), vf_set1(1.001f))));
        keep = vm_and(keep, vm_and(vf_ge(e_max, zero), vf_gt(c_max, zero)));
        // t >= |delta| / (Cmax (1 + q^2 / kappa)), written without the division.
        keep = vm_and(keep, vf_le(r[11], vf_mul(far16, vf_mul(c_max, vf_fma(q2, r[10], one)))));
        unsigned bits = vm_bits(keep);
        if (!bits)
            continue;
        vf_transpose16(r);
        for (unsigned k = 0; bits; ++k, bits >>= 1) {
            if (!(bits & 1))
                continue;
            vf_store(scratch->tile_records + count * 16, r[k]);
            scratch->tile_ids[count++] = scratch->candidates[i + k];
        }
    }
    return count;
}

// Order by (key, position) without branches: an element's place is the number of elements in front of it. Compares
// everything with everything, sixteen at a time, which for lists of this length beats any sort that moves.
enum { RANK_SORT_MAX = 320 };

static inline void rank_sort(const float *keys, const uint32_t *values, uint32_t *out, uint32_t count)
{
    const vf one = vf_set1(1.0f);
    for (uint32_t begin = 0; begin < count; begin += 16) {
        const uint32_t end = begin + 16 < count ? begin + 16 : count;
        const vf key = vf_load(keys + begin);
        vf rank = vf_zero();
        for (uint32_t j = 0; j < begin; ++j)
            rank = vf_add(rank, vf_keep(vf_le(vf_set1(keys[j]), key), one));
        for (uint32_t j = begin; j < end; ++j) { // lanes behind j lose ties, the others win them
            const vm behind = vm_from_bits(0xFFFFu << (j - begin) & 0xFFFFu);
            const vf other = vf_set1(keys[j]);
            const vm before = vm_or(vf_lt(other, key), vm_and(vf_le(other, key), behind));
            rank = vf_add(rank, vf_keep(before, one));
        }
        for (uint32_t j = end; j < count; ++j)
            rank = vf_add(rank, vf_keep(vf_lt(vf_set1(keys[j]), key), one));
        int32_t place[16] __attribute__((aligned(64)));
        vi_store(place, vf_to_vi(rank));
        for (uint32_t i = begin; i < end; ++i)
            out[place[i - begin] - 1] = values[i]; // an element counted itself, too
    }
}

// Long lists: least significant digit first; positive floats order like their bits.
static void radix_sort(const float *keys, const uint32_t *values, uint32_t *out, uint64_t *spare, uint32_t count)
{
    for (uint32_t i = 0; i < count; ++i) {
        uint32_t bits;
        memcpy(&bits, &keys[i], sizeof bits);
        spare[i] = (uint64_t)bits << 32 | values[i];
    }
    const uint64_t *sorted = sgsi_radix_sort(spare, spare + count, count);
    for (uint32_t i = 0; i < count; ++i)
        out[i] = (uint32_t)sorted[i];
}

static void tile_sort(sgsi_scratch *scratch, const sgsi_tile_rays *rays, size_t count)
{
    const vf bu = vf_load(rays->block_u), bv = vf_load(rays->block_v);
    const vf hu = vf_load(rays->block_half_u), hv = vf_load(rays->block_half_v);
    const vf zero = vf_zero(), one = vf_set1(1.0f);
    unsigned present = 0;
    for (int b = 0; b < SGSI_BLOCKS; ++b) {
        present |= (unsigned)(rays->valid[b] != 0) << b;
        scratch->entry_count[b] = 0;
    }
    for (size_t i = 0; i < count; ++i) {
        const float *r = scratch->tile_records + i * 16;
        const vf a1 = vf_set1(r[1]), a2 = vf_set1(r[2]), b1 = vf_set1(r[4]), b2 = vf_set1(r[5]);
        const vf c1 = vf_set1(r[7]), c2 = vf_set1(r[8]), inv_kappa = vf_set1(r[10]);
        const vf a = vf_fma(bv, a2, vf_fma(bu, a1, vf_set1(r[0])));
        const vf b = vf_fma(bv, b2, vf_fma(bu, b1, vf_set1(r[3])));
        const vf c = vf_fma(bv, c2, vf_fma(bu, c1, vf_set1(r[6])));
        const vf c_max = vf_fma(vf_abs(c1), hu, vf_fma(vf_abs(c2), hv, c));
        const vf n2 = vf_fma(a, a, vf_mul(b, b));
        const vf s = vf_fma(vf_abs(vf_fma(a, a1, vf_mul(b, b1))), hu, vf_mul(vf_abs(vf_fma(a, a2, vf_mul(b, b2))), hv));
        const vf low = vf_max(vf_fnma(s, vf_set1(1.0001f), vf_mul(n2, vf_set1(0.9999f))), zero);
        const vf reach = vf_mul(vf_set1(r[15]), c_max);
        const vm keep = vm_and(vf_le(vf_mul(low, low), vf_mul(n2, vf_mul(vf_mul(reach, reach), vf_set1(1.001f)))), vf_gt(c_max, zero));
        unsigned bits = vm_bits(keep) & present;
        if (!bits)
            continue;
        // t at the block's centre, not below the bound of the block. (Clamped below 1e30: keys stay positive finite.)
        const vf distance = vf_set1(r[11]);
        const vf t = vf_div(vf_mul(distance, c), vf_fma(inv_kappa, n2, vf_mul(c, c)));
        const vf nearest = vf_div(distance, vf_mul(c_max, vf_fma(vf_mul(vf_set1(r[15]), vf_set1(r[15])), inv_kappa, one)));
        float key[16] __attribute__((aligned(64)));
        vf_store(key, vf_min(vf_max(vf_max(t, nearest), zero), vf_set1(1e30f)));
        for (; bits; bits &= bits - 1) {
            const unsigned block = (unsigned)__builtin_ctz(bits);
            const size_t at = block * scratch->capacity + scratch->entry_count[block]++;
            scratch->entry_keys[at] = key[block];
            scratch->entries[at] = (uint32_t)i;
        }
    }
    for (int b = 0; b < SGSI_BLOCKS; ++b) {
        const float *keys = scratch->entry_keys + (size_t)b * scratch->capacity;
        const uint32_t *entries = scratch->entries + (size_t)b * scratch->capacity;
        uint32_t *order = scratch->order + (size_t)b * scratch->capacity;
        if (scratch->entry_count[b] <= RANK_SORT_MAX)
            rank_sort(keys, entries, order, scratch->entry_count[b]);
        else
            radix_sort(keys, entries, order, scratch->sort_spare, scratch->entry_count[b]);
    }
}
