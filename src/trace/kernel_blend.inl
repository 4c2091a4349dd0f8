// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Blending and its gradient, sixteen pixels (a 4x4 block) at a time.
//
// Exact order without sorting lanes. The entries of a block are sorted along its centre ray; in
// another lane, two of them may be swapped. Blending needs the order only for the transmittance in
// front of each hit, T_i = product of (1 - alpha_j) over the hits with t_j < t_i (ties: the order
// of the list, see in_front). Nothing is moved. The running product gives T_i where the orders
// agree. Where an entry lies in front of earlier ones in some lane (its t is below the running
// maximum), each such pair is corrected: the factor moves from the T of one to the T of the other.
// This is done for four entries against four at a time, so that sixteen pairs share their loads and
// stores. The few groups with an entry in front of an earlier group are corrected after all groups
// are evaluated. Entries keep their places, so colours and gradient sums stay uniform over the
// lanes.
//
// Termination without order. A hit counts iff T_i (1 - alpha_i) >= 1e-4. Along a ray this product
// decreases, so the rule is "stop before the first hit that would take T below 1e-4".
//
// Backward, v = alpha dL/dalpha. Let w = T alpha, q_i = w_i (c_i . dC), and behind_i = the sum of q
// over the hits behind i plus T_end (background terms). Then dL/dalpha_i = q_i / alpha_i - behind_i
// / (1 - alpha_i), so
//     v_i = q_i - behind_i alpha_i / (1 - alpha_i).
// alpha = 2^(lo - E) gives dL/dlo ~ v and dL/d(rho^2) = -v / 2. The gradient ignores the clamp at
// 0.99, as in 3DGS; for opacities above 1 it is scaled by the share of alpha that the clamp leaves.
// Let m be the vector from the mean to the ray's point of largest response, in the primitive's
// metric. Then rho^2 = |m|^2 and, because t maximises the response, d(rho^2)/dM = 2 m m^T M^-T and
// d(rho^2)/dmean = -2 M^T m with t held fixed. In the frame of trace.h m = (a, b, -E / (P sqrt(h)))
// / sqrt(h), a = A C / G, b = B C / G, h = log2(e) / 2. The sums of v, v m and v m m^T therefore
// determine the gradients of mean, scales, rotation and opacity, and none of their terms cancel.

#define ALPHA_MAX 0.99f
#define TRANSMITTANCE_MIN 1e-4f
#define NO_HIT (-127.0f)

typedef struct block_rays {
    // near: hits with smaller t are ignored, in units of |d|; INFINITY for lanes without a ray.
    vf u, v, near;
    vf length; // |d|
    vm valid;
} block_rays;

static inline block_rays load_block(const sgsi_tile_rays *rays, int b, float near_distance)
{
    block_rays block;
    block.u = vf_load(rays->u[b]);
    block.v = vf_load(rays->v[b]);
    block.length = vf_sqrt(vf_fma(block.u, block.u, vf_fma(block.v, block.v, vf_set1(1.0f))));
    block.valid = vm_from_bits(rays->valid[b]);
    block.near =
        vf_select(block.valid, vf_div(vf_set1(near_distance), block.length), vf_set1(INFINITY));
    return block;
}

typedef struct response {
    vf exponent; // log2 of alpha before the clamp; NO_HIT, whose power is 0, without a hit
    vf t;        // NaN without a hit: neither in front of nor behind any other
    vf a, b, e;
    vm hit;
} response;

// The terms of a response: A, B, C, A^2 + B^2 and 1 / G.
typedef struct slopes {
    vf a, b, c, n2, inv_g;
} slopes;

static inline slopes eval_slopes(const float *r, const block_rays *block)
{
    slopes x;
    x.a = vf_fma(block->v, vf_set1(r[2]), vf_fma(block->u, vf_set1(r[1]), vf_set1(r[0])));
    x.b = vf_fma(block->v, vf_set1(r[5]), vf_fma(block->u, vf_set1(r[4]), vf_set1(r[3])));
    x.c = vf_fma(block->v, vf_set1(r[8]), vf_fma(block->u, vf_set1(r[7]), vf_set1(r[6])));
    x.n2 = vf_fma(x.a, x.a, vf_mul(x.b, x.b));
    x.inv_g =
        vf_div(vf_set1(1.0f), vf_fma(vf_set1(r[SGSI_PROJECTED_INV_KAPPA]), x.n2, vf_mul(x.c, x.c)));
    return x;
}

// far: hits with larger t are ignored (units of |d|).
static inline response respond(const float *r, const slopes *s, const block_rays *block, vf far)
{
    const vf c_g = vf_mul(s->c, s->inv_g);
    response x;
    x.e = vf_mul(s->n2, s->inv_g);
    x.a = vf_mul(s->a, c_g);
    x.b = vf_mul(s->b, c_g);
    const vf exponent = vf_sub(vf_set1(r[SGSI_PROJECTED_LOG_OPACITY]), x.e),
             t = vf_mul(vf_set1(r[SGSI_PROJECTED_DISTANCE]), c_g);
    x.hit = vm_and(vf_ge(exponent, vf_set1(-SGSI_LOG2_255)), vf_between(t, block->near, far));
    x.exponent = vf_select(x.hit, exponent, vf_set1(NO_HIT));
    x.t = vf_select(x.hit, t, vf_set1(NAN));
    return x;
}

// Rows of evaluated entries, in groups of four. A group of sentinels precedes the first one:
// transparent and in front of everything. The last group is padded with rows without a hit.
enum { GROUP = 4, CHUNK = 32 }; // CHUNK: entries evaluated before their groups are ordered

typedef struct hit_rows {
    float *restrict alpha, *restrict t;
    float *restrict transmittance; // T in front of the entry
    // [group]: product of 1 - alpha and largest t of all groups before it.
    float *restrict prefix, *restrict t_before;
    float *restrict a, *restrict b, *restrict e; // responses, backward only
} hit_rows;

static inline hit_rows open_rows(const sgsi_scratch *s)
{
    const size_t lanes = 16 * GROUP;
    return (hit_rows){s->alpha + lanes,
                      s->t + lanes,
                      s->transmittance + lanes,
                      s->prefix + 16,
                      s->t_before + 16,
                      s->a,
                      s->b,
                      s->e};
}

// 1 - alpha, recomputed: a subtraction is cheaper than another stored row.
static inline vf load_through(const hit_rows *rows, ptrdiff_t i, int part)
{
    return vf_sub(vf_set1(1.0f), vf_load_part(rows->alpha + 16 * i, part));
}

// `alpha` holds its logarithm until order_group.
static inline void put_row(const hit_rows *rows, ptrdiff_t i, vf alpha, vf t)
{
    vf_store(rows->alpha + 16 * i, alpha);
    vf_store(rows->t + 16 * i, t);
}

static inline void put_sentinels(const hit_rows *rows)
{
    for (int k = -GROUP; k < 0; ++k) {
        put_row(rows, k, vf_zero(), vf_set1(-INFINITY));
        vf_store(rows->transmittance + 16 * k, vf_set1(1.0f));
    }
    vf_store(rows->prefix - 16, vf_set1(1.0f));
    vf_store(rows->t_before - 16, vf_set1(-INFINITY));
}

// Mask of the lanes in which an entry at distance t_j lies in front of row i, which comes later in
// the list. Equal distances keep the order of the list: by the 15-bit key of t on the block's
// centre ray (kernel_sort.inl), then by |delta|, then by id. False for rows without a hit (NaN),
// which hide nothing.
static inline vm in_front(const hit_rows *rows, vf t_j, ptrdiff_t i, int part)
{
    return vf_le(t_j, vf_load_part(rows->t + 16 * i, part));
}

// T of the four entries of a group with respect to each other.
static inline void order_within(const hit_rows *rows, ptrdiff_t first, int part,
                                const vf through[GROUP], vf front[GROUP])
{
    for (int j = 0; j < GROUP; ++j) {
        const vf t_j = vf_load_part(rows->t + 16 * (first + j), part);
        for (int i = j + 1; i < GROUP; ++i) {
            const vm before = in_front(rows, t_j, first + i, part);
            front[i] = vf_mul_where(before, front[i], through[j]);
            front[j] = vf_mul_where(vm_not(before), front[j], through[i]);
        }
    }
    for (int i = 0; i < GROUP; ++i)
        vf_store_part(rows->transmittance + 16 * (first + i), part, front[i]);
}

// Computes alpha of the four entries of group g, and their T as if all earlier groups were in
// front. prefix and t_last describe all earlier groups and are advanced past this one. Returns
// whether an entry lies in front of an earlier group. The factors of T are multiplied in list
// order, (((prefix f_j) f_j+1) ...), over the entries in front only. An entry that hides nothing
// therefore does not change a single bit wherever it is in the list, and depth bounds may omit it.
static inline bool order_group(const hit_rows *rows, uint32_t g, int part, vf *prefix, vf *t_last)
{
    const ptrdiff_t first = (ptrdiff_t)g * GROUP;
    vf through[GROUP], front[GROUP];
    vf nearest = vf_set1(INFINITY), farthest = *t_last, all = *prefix;
    for (int i = 0; i < GROUP; ++i) {
        // The exponential is computed here for four entries, not in respond(): the dependency chain
        // from record to alpha would be too long for out-of-order execution.
        float *const row = rows->alpha + 16 * (first + i);
        const vf t = vf_load_part(rows->t + 16 * (first + i), part);
        const vf alpha = vf_min(vf_exp2(vf_load_part(row, part)), vf_set1(ALPHA_MAX));
        vf_store_part(row, part, alpha);
        through[i] = vf_sub(vf_set1(1.0f), alpha);
        nearest = vf_min(t, nearest); // if either is NaN, the second operand
        farthest = vf_max(t, farthest);
        all = vf_mul(all, through[i]);
        front[i] = *prefix;
    }
    vf_store_part(rows->prefix + 16 * g, part, *prefix);
    vf_store_part(rows->t_before + 16 * g, part, *t_last);
    order_within(rows, first, part, through, front);
    const bool swapped = vm_any(vf_lt(nearest, *t_last)) != 0;
    *prefix = all;
    *t_last = farthest;
    return swapped;
}

// Orders the groups from begin to end and records those that order_back must correct. Branch-free,
// see evaluate_block.
static inline void order_groups(sgsi_scratch *s, const hit_rows *rows, uint32_t begin, uint32_t end,
                                vf *prefix, vf *t_last)
{
    bool swapped[CHUNK / GROUP] = {false};
    vf prefixes[SIMD_PARTS], lasts[SIMD_PARTS];
    for (int part = 0; part < SIMD_PARTS; ++part) {
        vf before = vf_part(*prefix, part), last = vf_part(*t_last, part); // in registers
        for (uint32_t g = begin; g < end; ++g)
            swapped[g - begin] |= order_group(rows, g, part, &before, &last);
        prefixes[part] = before;
        lasts[part] = last;
    }
    for (uint32_t g = begin; g < end; ++g) {
        s->swapped[s->swapped_count].group = g;
        s->swapped_count += swapped[g - begin];
    }
    *prefix = vf_join_parts(prefixes);
    *t_last = vf_join_parts(lasts);
}

// order_back in a part of the lanes.
static inline uint32_t order_back_part(const hit_rows *rows, uint32_t g, int part)
{
    const ptrdiff_t first = (ptrdiff_t)g * GROUP;
    vf through[GROUP], front[GROUP], nearest = vf_set1(INFINITY);
    for (int i = 0; i < GROUP; ++i) {
        through[i] = load_through(rows, first + i, part);
        nearest = vf_min(vf_load_part(rows->t + 16 * (first + i), part), nearest);
    }
    ptrdiff_t back = g;
    while (back >= 0 && vm_any(vf_lt(nearest, vf_load_part(rows->t_before + 16 * back, part))))
        --back;
    if (back == g)
        return 0;
    for (int i = 0; i < GROUP; ++i)
        front[i] = vf_load_part(rows->prefix + 16 * back, part);
    for (ptrdiff_t at = back * GROUP; at < first; ++at) {
        const vf t_j = vf_load_part(rows->t + 16 * at, part),
                 through_j = load_through(rows, at, part);
        vf front_j = vf_load_part(rows->transmittance + 16 * at, part);
        for (int i = 0; i < GROUP; ++i) {
            const vm before = in_front(rows, t_j, first + i, part);
            front[i] = vf_mul_where(before, front[i], through_j);
            front_j = vf_mul_where(vm_not(before), front_j, through[i]);
        }
        vf_store_part(rows->transmittance + 16 * at, part, front_j);
    }
    order_within(rows, first, part, through, front);
    return (uint32_t)(g - back);
}

// Corrects T of group g and of the earlier groups that are not entirely in front of it. Returns the
// number of these.
static inline uint32_t order_back(const hit_rows *rows, uint32_t g)
{
    uint32_t back = 0;
    for (int part = 0; part < SIMD_PARTS; ++part) {
        const uint32_t own = order_back_part(rows, g, part);
        back = own > back ? own : back;
    }
    return back;
}

// Removes from order[begin..count) the entries that cannot hit this block in front of distance
// `stop` (units of |d|). Returns the new count. Not inline, to leave the caller its registers.
static __attribute__((noinline)) uint32_t drop_hidden(const float *projected,
                                                      const sgsi_tile_rays *rays, int b, float stop,
                                                      uint32_t *order, uint32_t begin,
                                                      uint32_t count)
{
    const float u = rays->block_u[b], v = rays->block_v[b], half_u = rays->block_half_u[b],
                half_v = rays->block_half_v[b];
    uint32_t kept = begin;
    for (uint32_t i = begin; i < count; ++i) {
        const uint32_t index = order[i];
        const float *r = projected + 16 * (size_t)index;
        const float c_max =
            r[6] + r[7] * u + r[8] * v + fabsf(r[7]) * half_u + fabsf(r[8]) * half_v;
        order[kept] = index;
        kept += !(r[SGSI_PROJECTED_DISTANCE] >
                  stop * SGSI_DEPTH_MARGIN * c_max *
                      (1.0f + r[SGSI_PROJECTED_REACH] * r[SGSI_PROJECTED_REACH] *
                                  r[SGSI_PROJECTED_INV_KAPPA]));
    }
    return kept;
}

static inline float largest_lane(vf x)
{
    float lanes[16] __attribute__((aligned(64)));
    vf_store(lanes, x);
    for (int stride = 8; stride; stride /= 2)
        for (int i = 0; i < stride; ++i)
            lanes[i] = lanes[i + stride] > lanes[i] ? lanes[i + stride] : lanes[i];
    return lanes[0];
}

// Evaluates the entries of a block in order: alpha, t and T of each, and the groups that are out of
// order. Removes entries that hit no pixel and returns the number kept. Once the product of a lane
// falls below the minimum T, the entries so far have made it opaque at the largest of their
// distances. Hits beyond it neither count nor hide a counted hit, so they are ignored. Once all
// lanes are opaque, entries behind the last of these distances are not evaluated. The lists of the
// backward pass are final (`may_drop` is false).
//
// Branches do not depend on hits or on swaps, except at the end of a chunk: mispredictions would
// discard the work already started on later entries.
static inline uint32_t evaluate_block(sgsi_scratch *s, const sgsi_tile_rays *rays, int b,
                                      const block_rays *block, uint32_t *restrict order,
                                      uint32_t count, bool may_drop, bool keep_responses,
                                      uint64_t *evaluations)
{
    const hit_rows rows = open_rows(s);
    const float *restrict projected = s->tile_projected;
    const block_rays lanes = *block; // stays in registers: no store can alias it
    const vf open = vf_set1(INFINITY);
    vf prefix = vf_set1(1.0f), t_last = vf_set1(-INFINITY), far = open;
    uint32_t kept = 0, ordered = 0, i = 0;
    s->swapped_count = 0;
    put_sentinels(&rows);
    while (i < count) {
        const uint32_t end = count - i < CHUNK ? count : i + CHUNK;
        // The slopes of the next entry are computed while this one's response completes: the chain
        // from record to response is too long for out-of-order execution to overlap them.
        const float *r = projected + 16 * (size_t)order[i];
        slopes current = eval_slopes(r, &lanes);
        for (; i < end; ++i) {
            const uint32_t index = order[i];
            const float *next = projected + 16 * (size_t)order[i + 1 < end ? i + 1 : i];
            const slopes next_slopes = eval_slopes(next, &lanes);
            const response x = respond(r, &current, &lanes, far);
            put_row(&rows, kept, x.exponent, x.t);
            if (keep_responses) {
                vf_store(rows.a + 16 * kept, x.a);
                vf_store(rows.b + 16 * kept, x.b);
                vf_store(rows.e + 16 * kept, x.e);
            }
            order[kept] = index;
            kept += !may_drop || vm_any(x.hit); // backward lists contain hits only
            r = next;
            current = next_slopes;
        }
        order_groups(s, &rows, ordered / GROUP, kept / GROUP, &prefix, &t_last);
        ordered = kept / GROUP * GROUP;
        const vm saturated = vm_and(vf_lt(prefix, vf_set1(TRANSMITTANCE_MIN)), vf_ge(far, open));
        if (vm_any(saturated)) {
            far = vf_select(saturated, t_last, far);
            if (may_drop && !vm_any(vm_and(block->valid, vf_ge(far, open))))
                count = drop_hidden(projected, rays, b, largest_lane(vf_keep(block->valid, far)),
                                    order, i, count);
        }
    }
    if (ordered < kept) {
        for (uint32_t k = kept; k < ordered + GROUP; ++k)
            put_row(&rows, k, vf_set1(NO_HIT), vf_set1(NAN));
        order_groups(s, &rows, ordered / GROUP, ordered / GROUP + 1, &prefix, &t_last);
    }
    for (uint32_t k = 0; k < s->swapped_count; ++k)
        s->swapped[k].back = order_back(&rows, s->swapped[k].group);
    *evaluations += count;
    return kept;
}

// plane: of floats or of 32-bit integers, whose bits are those of the lanes.
static inline void store_block(void *plane, const sgsi_tile_target *target, int b, vf value)
{
    float lanes[16] __attribute__((aligned(64)));
    vf_store(lanes, value);
    const int x = target->rays->x + 4 * (b % 4), y = target->rays->y + 4 * (b / 4);
    const int columns = target->width - x < 4 ? target->width - x : 4;
    char *const first = (char *)plane + ((size_t)y * target->stride + (size_t)x) * sizeof *lanes;
    const size_t pitch = target->stride * sizeof *lanes;
    if (columns == 4 && target->height - y >= 4) {
        for (size_t row = 0; row < 4; ++row)
            memcpy(first + row * pitch, lanes + 4 * row, 4 * sizeof *lanes);
        return;
    }
    for (size_t row = 0; row < 4 && y + (int)row < target->height; ++row)
        memcpy(first + row * pitch, lanes + 4 * row, (size_t)columns * sizeof *lanes);
}

static inline vf load_block_plane(const float *plane, const sgsi_tile_target *target, int b)
{
    float lanes[16] __attribute__((aligned(64))) = {0};
    const int x = target->rays->x + 4 * (b % 4), y = target->rays->y + 4 * (b / 4);
    const int columns = target->width - x < 4 ? target->width - x : 4;
    if (columns == 4 && target->height - y >= 4) {
        for (int row = 0; row < 4; ++row)
            memcpy(lanes + 4 * row, plane + (size_t)(y + row) * target->stride + x,
                   4 * sizeof *lanes);
        return vf_load(lanes);
    }
    for (int row = 0; row < 4 && y + row < target->height; ++row)
        for (int column = 0; column < columns; ++column)
            lanes[4 * row + column] =
                plane[(size_t)(y + row) * target->stride + (size_t)(x + column)];
    return vf_load(lanes);
}

typedef struct blended {
    // stop: distance of the hit that ended the ray, in units of |d|.
    vf color[3], transmittance, stop;
} blended;

// If not NULL, `counted` receives the number of entries with a hit that counts or ends a ray, and
// `order` is compacted to them. Without the hits that end rays, the backward pass would count hits
// behind them. Not inline, to keep the sums in registers.
static __attribute__((noinline)) blended
blend_block(const sgsi_scratch *s, uint32_t *restrict order, uint32_t count, uint32_t *counted)
{
    const hit_rows rows = open_rows(s);
    const vf one = vf_set1(1.0f), zero = vf_zero();
    blended out = {.color = {zero, zero, zero}, .transmittance = one, .stop = vf_set1(INFINITY)};
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; ++i) {
        const uint32_t index = order[i];
        const float *r = s->tile_projected + 16 * (size_t)index + SGSI_PROJECTED_COLOR;
        const vf alpha = vf_load(rows.alpha + 16 * i), t = vf_load(rows.t + 16 * i);
        const vf front = vf_load(rows.transmittance + 16 * i), through = vf_sub(one, alpha);
        const vf back = vf_mul(front, through);
        const vm counts = vf_ge(back, vf_set1(TRANSMITTANCE_MIN));
        const vf w = vf_keep(counts, vf_mul(front, alpha));
        out.color[0] = vf_fma(w, vf_set1(r[0]), out.color[0]);
        out.color[1] = vf_fma(w, vf_set1(r[1]), out.color[1]);
        out.color[2] = vf_fma(w, vf_set1(r[2]), out.color[2]);
        out.transmittance = vf_mul_where(counts, out.transmittance, through);
        const vm hit = vf_gt(alpha, zero);
        out.stop = vf_min_where(vm_andnot(hit, counts), out.stop, t);
        if (counted) {
            order[kept] = index;
            kept += vm_any(vm_and(hit, vf_ge(front, vf_set1(TRANSMITTANCE_MIN))));
        }
    }
    if (counted)
        *counted = kept;
    return out;
}

#include "trace/kernel_aov.inl"

static void tile_forward(sgsi_scratch *s, sgsi_tile_target *target)
{
    const sgsi_tile_rays *rays = target->rays;
    const bool has_aovs = target->depth_mean || target->depth_median || target->depth_first ||
                          target->hits || target->aov;
    float stop = 0.0f;
    for (int b = 0; b < SGSI_BLOCKS; ++b) {
        const block_rays block = load_block(rays, b, target->near_distance);
        uint32_t *order = s->order + (size_t)b * s->capacity;
        const uint32_t kept = evaluate_block(s, rays, b, &block, order, s->entry_count[b], true,
                                             false, &target->evaluations);
        s->entry_count[b] = kept;
        if (rays->x + 4 * (b % 4) >= target->width || rays->y + 4 * (b / 4) >= target->height)
            continue;
        const blended out = blend_block(s, order, kept, has_aovs ? NULL : &s->entry_count[b]);
        for (int c = 0; c < 3; ++c)
            store_block(target->color[c], target, b, out.color[c]);
        store_block(target->transmittance, target, b, out.transmittance);
        if (has_aovs)
            write_aovs(s, target, b, &block, kept, out.transmittance);
        const float block_stop =
            largest_lane(vf_select(block.valid, vf_mul(out.stop, block.length), vf_zero()));
        stop = block_stop > stop ? block_stop : stop;
    }
    target->stop_distance = stop;
}

// Corrects `behind` for swapped pairs within a group.
static inline void order_behind_within(const hit_rows *rows, ptrdiff_t first, int part,
                                       const float *restrict q, float *restrict behind)
{
    const vf zero = vf_zero();
    vf gained[GROUP] = {zero, zero, zero, zero}, q_i[GROUP];
    for (int i = 0; i < GROUP; ++i)
        q_i[i] = vf_load_part(q + 16 * (first + i), part);
    for (int j = 0; j < GROUP; ++j) {
        const vf t_j = vf_load_part(rows->t + 16 * (first + j), part);
        for (int i = j + 1; i < GROUP; ++i) {
            const vm swapped = vm_not(in_front(rows, t_j, first + i, part));
            gained[i] = vf_add_where(swapped, gained[i], q_i[j]);
            gained[j] = vf_sub_where(swapped, gained[j], q_i[i]);
        }
    }
    for (int i = 0; i < GROUP; ++i)
        vf_store_part(behind + 16 * (first + i), part, gained[i]);
}

// Corrects `behind` for swapped pairs of a group and the `back` groups before it.
static inline void order_behind_back(const hit_rows *rows, const float *restrict q,
                                     float *restrict behind, ptrdiff_t g, ptrdiff_t back, int part)
{
    const ptrdiff_t first = g * GROUP;
    vf q_i[GROUP], gained[GROUP];
    for (int i = 0; i < GROUP; ++i) {
        q_i[i] = vf_load_part(q + 16 * (first + i), part);
        gained[i] = vf_load_part(behind + 16 * (first + i), part);
    }
    for (ptrdiff_t at = first - back * GROUP; at < first; ++at) {
        const vf t_j = vf_load_part(rows->t + 16 * at, part), q_j = vf_load_part(q + 16 * at, part);
        vf lost = vf_load_part(behind + 16 * at, part);
        for (int i = 0; i < GROUP; ++i) {
            const vm swapped = vm_not(in_front(rows, t_j, first + i, part));
            gained[i] = vf_add_where(swapped, gained[i], q_j);
            lost = vf_sub_where(swapped, lost, q_i[i]);
        }
        vf_store_part(behind + 16 * at, part, lost);
    }
    for (int i = 0; i < GROUP; ++i)
        vf_store_part(behind + 16 * (first + i), part, gained[i]);
}

typedef struct block_gradient {
    vf color[3], transmittance; // dL/dC, dL/dT of the block's pixels
} block_gradient;

// Replaces `transmittance` by the weights and `alpha` by alpha / (1 - alpha) of counted hits, and
// computes q and the corrections of `behind`. Returns the final transmittance.
static inline vf weigh_block(const sgsi_scratch *s, const hit_rows *rows, const uint32_t *order,
                             uint32_t count, const block_gradient *d)
{
    float *restrict q = s->q + 16 * GROUP, *restrict behind = s->behind + 16 * GROUP;
    const float *restrict projected = s->tile_projected;
    vf end = vf_set1(1.0f);
    for (uint32_t first = 0; first < count; first += GROUP) {
        for (uint32_t k = 0; k < GROUP; ++k) {
            const uint32_t i = first + k; // the last group is padded with rows without a hit
            const float *r = projected + 16 * (size_t)order[i < count ? i : first];
            const vf front = vf_load(rows->transmittance + 16 * i);
            const vf alpha = vf_load(rows->alpha + 16 * i), through = vf_sub(vf_set1(1.0f), alpha);
            const vm counts = vf_ge(vf_mul(front, through), vf_set1(TRANSMITTANCE_MIN));
            const vf w = vf_keep(counts, vf_mul(front, alpha));
            const float *color = r + SGSI_PROJECTED_COLOR;
            end = vf_mul_where(counts, end, through);
            const vf q_i = vf_mul(w, vf_fma(vf_set1(color[0]), d->color[0],
                                            vf_fma(vf_set1(color[1]), d->color[1],
                                                   vf_mul(vf_set1(color[2]), d->color[2]))));
            vf_store(rows->transmittance + 16 * i, w);
            vf_store(rows->alpha + 16 * i, vf_keep(counts, vf_div(alpha, through)));
            vf_store(q + 16 * i, q_i);
        }
        for (int part = 0; part < SIMD_PARTS; ++part)
            order_behind_within(rows, first, part, q, behind);
    }
    for (int k = -GROUP; k < 0; ++k) {
        vf_store(q + 16 * k, vf_zero());
        vf_store(behind + 16 * k, vf_zero());
    }
    for (uint32_t k = 0; k < s->swapped_count; ++k)
        for (int part = 0; part < SIMD_PARTS; ++part)
            order_behind_back(rows, q, behind, s->swapped[k].group, s->swapped[k].back, part);
    return end;
}

// The gradient with respect to the projected centre is proportional to v (a A + b B - E C)
// (kernel_optimize.inl: transverse). record: of the projected model, in camera axes.
static inline void abs_grad_sums(const float *record, vf v, vf a, vf b, vf e, vh sums[16])
{
    const vf va = vf_mul(v, a), vb = vf_mul(v, b), ve = vf_mul(v, e); // v first: 0 if it is 0
    for (int axis = 0; axis < 2; ++axis)
        sums[SGSI_GRAD_SUM_ABS + axis] =
            vf_fold(vf_abs(vf_fma(va, vf_set1(record[SGSI_PROJECTED_A + axis]),
                                  vf_fms(vb, vf_set1(record[SGSI_PROJECTED_B + axis]),
                                         vf_mul(ve, vf_set1(record[SGSI_PROJECTED_C + axis]))))));
}

// The sums of a block hit except the absolute ones, folded from 16 to 8 lanes. `at`: first lane of
// its row; v: lower and upper half.
static inline void hit_sums(const hit_rows *rows, size_t at, const vh v[2], const vh d_color[3][2],
                            vh sums[16])
{
    const vh w0 = vh_load(rows->transmittance + at), w1 = vh_load(rows->transmittance + at + 8);
    const vh a0 = vh_load(rows->a + at), a1 = vh_load(rows->a + at + 8);
    const vh b0 = vh_load(rows->b + at), b1 = vh_load(rows->b + at + 8);
    const vh e0 = vh_load(rows->e + at), e1 = vh_load(rows->e + at + 8);
    const vh va0 = vh_mul(v[0], a0), va1 = vh_mul(v[1], a1);
    const vh vb0 = vh_mul(v[0], b0), vb1 = vh_mul(v[1], b1);
    const vh ve0 = vh_mul(v[0], e0), ve1 = vh_mul(v[1], e1);
    for (int c = 0; c < 3; ++c)
        sums[SGSI_GRAD_SUM_COLOR + c] = vh_fma(w1, d_color[c][1], vh_mul(w0, d_color[c][0]));
    sums[SGSI_GRAD_SUM_V] = vh_add(v[0], v[1]);
    sums[SGSI_GRAD_SUM_VA] = vh_add(va0, va1);
    sums[SGSI_GRAD_SUM_VB] = vh_add(vb0, vb1);
    sums[SGSI_GRAD_SUM_VE] = vh_add(ve0, ve1);
    sums[SGSI_GRAD_SUM_VAA] = vh_fma(va1, a1, vh_mul(va0, a0));
    sums[SGSI_GRAD_SUM_VAB] = vh_fma(va1, b1, vh_mul(va0, b0));
    sums[SGSI_GRAD_SUM_VBB] = vh_fma(vb1, b1, vh_mul(vb0, b0));
    sums[SGSI_GRAD_SUM_VAE] = vh_fma(va1, e1, vh_mul(va0, e0));
    sums[SGSI_GRAD_SUM_VBE] = vh_fma(vb1, e1, vh_mul(vb0, e0));
    sums[SGSI_GRAD_SUM_VEE] = vh_fma(ve1, e1, vh_mul(ve0, e0));
    sums[SGSI_GRAD_SUM_WEIGHT] = vh_add(w0, w1);
}

static inline __attribute__((always_inline)) void backward_block(sgsi_scratch *s,
                                                                 const sgsi_tile_list *list,
                                                                 sgsi_tile_target *target, int b,
                                                                 bool abs_grad)
{
    uint32_t *order = list->block_hits + list->block_begin[b];
    const uint32_t count = list->block_begin[b + 1] - list->block_begin[b];
    if (!count)
        return;
    const block_rays block = load_block(target->rays, b, target->near_distance);
    evaluate_block(s, target->rays, b, &block, order, count, false, true, &target->evaluations);
    const hit_rows rows = open_rows(s);
    block_gradient d;
    for (int c = 0; c < 3; ++c)
        d.color[c] = load_block_plane(target->d_color[c], target, b);
    d.transmittance = load_block_plane(target->d_transmittance, target, b);
    const vf end = vf_mul(weigh_block(s, &rows, order, count, &d), d.transmittance);
    vh d_color[3][2], run[2]; // run: sum of what lies behind, per half
    for (int c = 0; c < 3; ++c)
        vf_halves(d.color[c], d_color[c]);
    vf_halves(end, run);
    float *restrict q = s->q + 16 * GROUP;
    const float *restrict behind = s->behind + 16 * GROUP;
    for (uint32_t i = count; i-- > 0;) {
        const size_t at = 16 * (size_t)i, row = 16 * (size_t)order[i];
        vh sums[16] = {[SGSI_GRAD_SUM_ABS] = vh_zero(), [SGSI_GRAD_SUM_ABS + 1] = vh_zero()}, v[2];
        for (size_t half = 0; half < 2; ++half) {
            const vh q_i = vh_load(q + at + 8 * half);
            const vh hidden = vh_add(run[half], vh_load(behind + at + 8 * half));
            v[half] = vh_fnma(hidden, vh_load(rows.alpha + at + 8 * half), q_i);
            run[half] = vh_add(run[half], q_i);
        }
        hit_sums(&rows, at, v, d_color, sums);
        if (abs_grad)
            abs_grad_sums(target->projected + (size_t)list->ids[order[i]] * SGSI_PROJECTED_FLOATS,
                          vf_join(v), vf_load(rows.a + at), vf_load(rows.b + at),
                          vf_load(rows.e + at), sums);
        vh_add_sums(s->sums + row, sums);
    }
}

static void load_tile_projected(sgsi_scratch *s, const sgsi_tile_list *list,
                                const sgsi_tile_target *target)
{
    const macrotile_frame16 frame = broadcast_frame(target->rays->frame);
    for (size_t i = 0; i < list->count; i += 16) {
        vf r[16];
        for (size_t k = i + 16; k < i + 32 && k < list->count; ++k)
            __builtin_prefetch(target->projected + (size_t)list->ids[k] * SGSI_PROJECTED_FLOATS);
        frame_rows(target->projected, list->ids + i, list->count - i, &frame, r);
        r[SGSI_PROJECTED_REACH] = vf_zero();
        vf_transpose16(r);
        for (size_t k = 0; k < 16; ++k)
            vf_store(s->tile_projected + 16 * (i + k), r[k]);
    }
}

static void tile_backward(sgsi_scratch *s, const sgsi_tile_list *list, sgsi_tile_target *target)
{
    load_tile_projected(s, list, target);
    memset(s->sums, 0, list->count * SGSI_PROJECTED_FLOATS * sizeof *s->sums);
    for (int b = 0; b < SGSI_BLOCKS; ++b)
        backward_block(s, list, target, b, false);
}

static void tile_backward_abs_grad(sgsi_scratch *s, const sgsi_tile_list *list,
                                   sgsi_tile_target *target)
{
    load_tile_projected(s, list, target);
    memset(s->sums, 0, list->count * SGSI_PROJECTED_FLOATS * sizeof *s->sums);
    for (int b = 0; b < SGSI_BLOCKS; ++b)
        backward_block(s, list, target, b, true);
}
