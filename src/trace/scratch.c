// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Scratch memory of a thread: one allocation, so that it can use large pages. Arrays, and the rows
// of block lists within them, start at different cache sets, because the kernels access many of
// them at the same index.

#include "base/core.h"
#include "trace/tracer.h"

enum { LINE = 64, STAGGER = 5 * LINE, STEP = 256, ODD = 80 };

void sgsi_scratch_free(sgsi_scratch *s)
{
    sgsi_free(s->memory);
    *s = (sgsi_scratch){0};
}

bool sgsi_scratch_grow(sgsi_scratch *s, size_t capacity)
{
    if (capacity <= s->capacity)
        return true;
    const struct {
        void **array;
        size_t bytes; // per primitive
    } arrays[] = {{(void **)&s->macrotile_projected, 64},
                  {(void **)&s->macrotile_ids, 4},
                  {(void **)&s->macrotile_tiles, 4},
                  {(void **)&s->macrotile_distance, 4},
                  {(void **)&s->macrotile_order, 4},
                  {(void **)&s->tile_projected, 64},
                  {(void **)&s->tile_ids, 4},
                  {(void **)&s->entry_keys, 4 * SGSI_BLOCKS},
                  {(void **)&s->entries, 4 * SGSI_BLOCKS},
                  {(void **)&s->sort_spare, 16},
                  {(void **)&s->order, 4 * SGSI_BLOCKS},
                  {(void **)&s->alpha, 64},
                  {(void **)&s->behind, 64},
                  {(void **)&s->t, 64},
                  {(void **)&s->transmittance, 64},
                  {(void **)&s->prefix, 64},
                  {(void **)&s->t_before, 64},
                  {(void **)&s->a, 64},
                  {(void **)&s->b, 64},
                  {(void **)&s->e, 64},
                  {(void **)&s->q, 64},
                  {(void **)&s->swapped, 8}};
    enum { COUNT = sizeof arrays / sizeof *arrays };
    size_t at[COUNT], bytes = 0;
    for (size_t i = 0; i < COUNT; ++i) {
        at[i] = bytes;
        bytes += ((capacity + SGSI_SENTINELS) * arrays[i].bytes + LINE - 1) / LINE * LINE + STAGGER;
    }
    sgsi_free(s->memory);
    s->capacity = 0;
    s->memory = sgsi_alloc(bytes, 1);
    if (!s->memory)
        return false;
    for (size_t i = 0; i < COUNT; ++i)
        *arrays[i].array = (char *)s->memory + at[i];
    s->capacity = capacity;
    return true;
}

bool sgsi_scratch_reserve(sgsi_scratch *s, size_t capacity)
{
    return capacity <= s->capacity ||
           sgsi_scratch_grow(s, (capacity + capacity / 4 + STEP - 1) / STEP * STEP + ODD);
}
