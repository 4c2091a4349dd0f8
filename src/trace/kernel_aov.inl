// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// AOVs besides colour: distances, number of hits, normal, position, dominant primitive. Computed in
// a second pass over the block hits after blending, which training omits.
//
// Every AOV is a sum or an extreme over the counted hits and needs no order. Only the median depth
// needs the transmittance T in front of a hit: T decreases along a ray, so the hit that takes T to
// 1/2 is the farthest one with T > 1/2 in front, if the ray ends with T <= 1/2. The mean of the hit
// points is the point at the mean distance, because they are collinear.

typedef struct block_sums {
    vf weight, depth, median, first, hits, largest, primitive;
    vf normal[3];
} block_sums;

// normals: [primitive][4] or NULL. Inlined for each combination.
static inline block_sums sum_block(const sgsi_scratch *s, const uint32_t *order, uint32_t count,
                                   const float *normals, bool identify)
{
    const hit_rows rows = open_rows(s);
    const vf one = vf_set1(1.0f), zero = vf_zero(), half = vf_set1(0.5f),
             infinity = vf_set1(INFINITY);
    block_sums sums = {.weight = zero,
                       .depth = zero,
                       .median = zero,
                       .first = infinity,
                       .hits = zero,
                       .largest = zero,
                       .primitive = vi_as_vf(vi_set1((int32_t)SGS_NO_PRIMITIVE)),
                       .normal = {zero, zero, zero}};
    for (uint32_t i = 0; i < count; ++i) {
        const vf front = vf_load(rows.transmittance + 16 * i), alpha = vf_load(rows.alpha + 16 * i);
        const vm counts = vf_ge(vf_mul(front, vf_sub(one, alpha)), vf_set1(TRANSMITTANCE_MIN));
        const vf w = vf_keep(counts, vf_mul(front, alpha));
        const vm counted = vf_gt(w, zero);
        const vf t = vf_keep(counted, vf_load(rows.t + 16 * i)); // NaN where there is no hit
        sums.weight = vf_add(sums.weight, w);
        sums.depth = vf_fma(w, t, sums.depth);
        sums.hits = vf_add_where(counted, sums.hits, one);
        sums.first = vf_min(vf_select(counted, t, infinity), sums.first);
        sums.median = vf_max(vf_keep(vf_gt(front, half), t), sums.median);
        if (normals) {
            const float *normal = normals + 4 * (size_t)s->tile_ids[order[i]];
            for (int c = 0; c < 3; ++c)
                sums.normal[c] = vf_fma(w, vf_set1(normal[c]), sums.normal[c]);
        }
        if (identify) {
            const vm larger = vf_gt(w, sums.largest);
            sums.largest = vf_max(w, sums.largest);
            sums.primitive = vf_select(larger, vi_as_vf(vi_set1((int32_t)s->tile_ids[order[i]])),
                                       sums.primitive);
        }
    }
    return sums;
}

// Directions of the block's rays in camera axes, on the macrotile's tangent plane.
static inline vec3 block_direction(const float frame[9], const block_rays *block)
{
    vf d[3];
    for (int k = 0; k < 3; ++k)
        d[k] = vf_fma(block->v, vf_set1(frame[6 + k]),
                      vf_fma(block->u, vf_set1(frame[3 + k]), vf_set1(frame[k])));
    return (vec3){d[0], d[1], d[2]};
}

static void store_normal(const sgsi_tile_target *target, int b, const block_sums *sums)
{
    const vec3 n = {sums->normal[0], sums->normal[1], sums->normal[2]};
    const vf length = vf_sqrt(dot3(n, n));
    const vm any = vf_gt(length, vf_set1(1e-12f));
    const vf scale = vf_keep(any, vf_div(vf_set1(1.0f), vf_select(any, length, vf_set1(1.0f))));
    for (int c = 0; c < 3; ++c)
        if (target->aov->normal[c])
            store_block(target->aov->normal[c], target, b, vf_mul(sums->normal[c], scale));
}

static void store_position(const sgsi_tile_target *target, int b, vec3 direction, vf mean, vm any)
{
    const vec3 x = rotate3_back(target->aov->rotation, scale3(direction, mean));
    const vf from_center[3] = {x.x, x.y, x.z};
    for (int c = 0; c < 3; ++c) {
        const vf point = vf_add(vf_add(from_center[c], vf_set1(target->aov->center_low[c])),
                                vf_set1(target->aov->center[c]));
        if (target->aov->position[c])
            store_block(target->aov->position[c], target, b, vf_keep(any, point));
    }
}

static void visit_block(const sgsi_scratch *s, const sgsi_tile_target *target, int b,
                        uint32_t count, vf unit)
{
    const hit_rows rows = open_rows(s);
    sgsi_block_hits hits = {.x = target->rays->x + 4 * (b % 4),
                            .y = target->rays->y + 4 * (b / 4),
                            .valid = target->rays->valid[b],
                            .count = count,
                            .alpha = rows.alpha,
                            .transmittance = rows.transmittance,
                            .t = rows.t,
                            .order = s->order + (size_t)b * s->capacity,
                            .projected = s->tile_projected,
                            .transmittance_min = TRANSMITTANCE_MIN,
                            .spare = s->sort_spare};
    vf_store_u(hits.unit, unit);
    target->aov->visit(target->aov->context, &hits);
}

// Writes the AOV planes of an evaluated block; `end`: its final transmittance.
static void write_aovs(const sgsi_scratch *s, const sgsi_tile_target *target, int b,
                       const block_rays *block, uint32_t count, vf end)
{
    const sgsi_aov *aov = target->aov;
    const float *normals = aov ? aov->normals : NULL;
    const bool identify = aov && aov->primitive;
    const uint32_t *order = s->order + (size_t)b * s->capacity;
    const block_sums sums = normals    ? sum_block(s, order, count, normals, true)
                            : identify ? sum_block(s, order, count, NULL, true)
                                       : sum_block(s, order, count, NULL, false);
    const vf zero = vf_zero(), one = vf_set1(1.0f);
    const vm any = vf_gt(sums.weight, zero);
    const vf mean = vf_keep(any, vf_div(sums.depth, vf_select(any, sums.weight, one)));
    const vec3 direction = block_direction(target->rays->frame, block);
    const vf unit = aov && aov->axis_depth ? direction.z : block->length;
    if (target->depth_mean)
        store_block(target->depth_mean, target, b, vf_mul(mean, unit));
    if (target->depth_median)
        store_block(target->depth_median, target, b,
                    vf_keep(vf_le(end, vf_set1(0.5f)), vf_mul(sums.median, unit)));
    if (target->depth_first)
        store_block(target->depth_first, target, b,
                    vf_keep(any, vf_mul(vf_select(any, sums.first, zero), unit)));
    if (target->hits)
        store_block(target->hits, target, b, sums.hits);
    if (normals)
        store_normal(target, b, &sums);
    if (aov && (aov->position[0] || aov->position[1] || aov->position[2]))
        store_position(target, b, direction, mean, any);
    if (identify)
        store_block(aov->primitive, target, b, sums.primitive);
    if (aov && aov->visit)
        visit_block(s, target, b, count, unit);
}
