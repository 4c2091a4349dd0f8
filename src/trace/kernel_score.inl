// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Scores of primitives for density control over whole views, summed over counted hits: the weight
// of the pixel, the number of hits, the blending weight T alpha, the distance from the projected
// centre, and T. This is a separate pass over the lists of a forward pass, so training kernels
// are unaffected.

#include "model/score_slots.h"

// Offsets of a block's pixel centres from the corner of its upper left pixel.
static inline void block_offsets(float x[16], float y[16])
{
    for (int i = 0; i < 16; ++i) {
        x[i] = (float)(i % 4) + 0.5f;
        y[i] = (float)(i / 4) + 0.5f;
    }
}

static void score_block(sgsi_scratch *s, const sgsi_tile_list *list, const sgsi_tile_target *target,
                        const sgsi_score_planes *planes, int b, uint64_t *evaluations)
{
    const vf one = vf_set1(1.0f), zero = vf_zero();
    uint32_t *order = list->block_hits + list->block_begin[b];
    const uint32_t count = list->block_begin[b + 1] - list->block_begin[b];
    if (!count)
        return;
    const block_rays block = load_block(target->rays, b, target->near_distance);
    evaluate_block(s, target->rays, b, &block, order, count, false, false, evaluations);
    const hit_rows rows = open_rows(s);
    const vf weight = load_block_plane(planes->weight, target, b);
    float offset_x[16] __attribute__((aligned(64))), offset_y[16] __attribute__((aligned(64)));
    block_offsets(offset_x, offset_y);
    const vf x = vf_add(vf_load(offset_x), vf_set1((float)(target->rays->x + 4 * (b % 4))));
    const vf y = vf_add(vf_load(offset_y), vf_set1((float)(target->rays->y + 4 * (b / 4))));
    for (uint32_t i = 0; i < count; ++i) {
        const vf front = vf_load(rows.transmittance + 16 * i), alpha = vf_load(rows.alpha + 16 * i);
        const vf w = vf_keep(vf_ge(vf_mul(front, vf_sub(one, alpha)), vf_set1(TRANSMITTANCE_MIN)),
                             vf_mul(front, alpha));
        const vm counted = vf_gt(w, zero);
        vf distance = zero;
        if (planes->centers) {
            const float *center = planes->centers + 2 * (size_t)list->ids[order[i]];
            const vf dx = vf_sub(x, vf_set1(center[0])), dy = vf_sub(y, vf_set1(center[1]));
            distance = vf_keep(counted, vf_sqrt(vf_fma(dx, dx, vf_mul(dy, dy))));
        }
        vh sums[16] = {[SGSI_SCORE_WEIGHT] = vf_fold(vf_keep(counted, weight)),
                       [SGSI_SCORE_HITS] = vf_fold(vf_keep(counted, one)),
                       [SGSI_SCORE_BLEND] = vf_fold(w),
                       [SGSI_SCORE_DISTANCE] = vf_fold(distance),
                       [SGSI_SCORE_FRONT] = vf_fold(vf_keep(counted, front))};
        for (int k = SGSI_SCORE_COUNT; k < 16; ++k)
            sums[k] = vh_zero();
        vh_add_sums(s->sums + 16 * (size_t)order[i], sums);
    }
}

static void tile_score(sgsi_scratch *s, const sgsi_tile_list *list, sgsi_tile_target *target,
                       const sgsi_score_planes *planes)
{
    load_tile_projected(s, list, target);
    memset(s->sums, 0, list->count * SGSI_PROJECTED_FLOATS * sizeof *s->sums);
    for (int b = 0; b < SGSI_BLOCKS; ++b)
        score_block(s, list, target, planes, b, &target->evaluations);
}
