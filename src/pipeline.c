// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of base pipelines, and the selections that they share.

#include "pipeline.h"

#include <string.h>

#include "core.h"

const sgsi_pipeline *sgsi_pipeline_get(sgs_pipeline pipeline)
{
    static const sgsi_pipeline *const pipelines[] = {[SGS_PIPELINE_3DGS] = &sgsi_pipeline_3dgs};
    return pipelines[pipeline];
}

typedef struct ranked_row {
    double score;
    uint32_t row;
} ranked_row;

static bool ranks_before(ranked_row a, ranked_row b)
{
    return a.score > b.score || (a.score == b.score && a.row < b.row);
}

static void sift_down(ranked_row *heap, size_t count, size_t at)
{
    for (;;) {
        size_t worst = at;
        for (size_t child = 2 * at + 1; child <= 2 * at + 2; ++child)
            if (child < count && ranks_before(heap[worst], heap[child]))
                worst = child;
        if (worst == at)
            return;
        const ranked_row kept = heap[at];
        heap[at] = heap[worst];
        heap[worst] = kept;
        at = worst;
    }
}

// A heap of the best so far, its root the worst of them.
sgs_status sgsi_select_best(const double *score, const uint8_t *eligible, size_t count, size_t wanted, uint8_t *chosen)
{
    memset(chosen, 0, count);
    if (!wanted)
        return SGS_STATUS_OK;
    wanted = wanted < count ? wanted : count;
    ranked_row *heap = sgsi_alloc(wanted ? wanted : 1, sizeof *heap);
    if (!heap)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory to rank %zu primitives", count);
    size_t held = 0;
    for (size_t i = 0; i < count; ++i) {
        if (eligible && !eligible[i])
            continue;
        const ranked_row row = {score[i], (uint32_t)i};
        if (held < wanted) {
            heap[held++] = row;
            for (size_t k = held / 2; held == wanted && k-- > 0;)
                sift_down(heap, held, k);
        } else if (ranks_before(row, heap[0])) {
            heap[0] = row;
            sift_down(heap, held, 0);
        }
    }
    for (size_t k = 0; k < held; ++k)
        chosen[heap[k].row] = 1;
    sgsi_free(heap);
    return SGS_STATUS_OK;
}
