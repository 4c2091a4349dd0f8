// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Level by level, neighbouring nodes whose codes agree without the lowest bit are merged. The left
// slot keeps the low-pass value with the sum of both weights; the right one keeps the high-pass
// value and leaves the list.

#include "compress/raht.h"

#include <math.h>
#include <string.h>

#include "base/core.h"

typedef struct raht_node {
    uint64_t code;
    double weight;
    uint32_t slot;
} raht_node;

sgs_status sgsi_raht_create(const uint64_t *cells, size_t count, int bits, sgsi_raht *raht)
{
    *raht = (sgsi_raht){.count = count, .merges = sgsi_alloc(count, sizeof *raht->merges)};
    raht_node *nodes = sgsi_alloc(count, sizeof *nodes);
    if (!raht->merges || !nodes) {
        sgsi_free(nodes);
        sgsi_raht_free(raht);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu cells", count);
    }
    for (size_t i = 0; i < count; ++i)
        nodes[i] = (raht_node){cells[i], 1, (uint32_t)i};
    size_t left = count, merged = 0;
    for (int level = 0; level < bits && left > 1; ++level) {
        size_t kept = 0;
        for (size_t i = 0; i < left; ++kept) {
            raht_node node = nodes[i++];
            if (i < left && node.code >> 1 == nodes[i].code >> 1) {
                const double w1 = node.weight, w2 = nodes[i].weight, length = sqrt(w1 + w2);
                raht->merges[merged++] = (sgsi_raht_merge){node.slot, nodes[i].slot,
                                                           sqrt(w1) / length, sqrt(w2) / length};
                node.weight = w1 + w2;
                ++i;
            }
            node.code >>= 1;
            nodes[kept] = node;
        }
        left = kept;
    }
    sgsi_free(nodes);
    return SGS_STATUS_OK;
}

void sgsi_raht_free(sgsi_raht *raht)
{
    sgsi_free(raht->merges);
    *raht = (sgsi_raht){0};
}

void sgsi_raht_forward(const sgsi_raht *raht, double *channel)
{
    for (size_t k = 0; k + 1 < raht->count; ++k) {
        const sgsi_raht_merge *m = &raht->merges[k];
        const double l = channel[m->left], r = channel[m->right];
        channel[m->left] = m->a * l + m->b * r;
        channel[m->right] = m->a * r - m->b * l;
    }
}

void sgsi_raht_inverse(const sgsi_raht *raht, double *channel)
{
    for (size_t k = raht->count - 1; k-- > 0;) {
        const sgsi_raht_merge *m = &raht->merges[k];
        const double low = channel[m->left], high = channel[m->right];
        channel[m->left] = m->a * low - m->b * high;
        channel[m->right] = m->b * low + m->a * high;
    }
}
