// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Scratch memory of a thread: one allocation, so that it can use large pages. Arrays, and the rows
// of block lists within them, start at different cache sets, because the kernels access many of
// them at the same index.
//
// A scratch has about 1 KB per candidate of a macrotile. All threads have one for the largest
// macrotile up to SGSI_OWN_ROWS candidates. Macrotiles with more are rare, such as those of a
// distant camera; their threads take a shared scratch for the time of the macrotile.

#include "base/core.h"
#include "trace/tracer_state.h"

enum { LINE = 64, STAGGER = 5 * LINE, STEP = 256, ODD = 80, TRIM_PASSES = 16 };

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

// The smallest shared scratch that holds `rows`, else the largest.
static sgsi_large_scratch *take_shared(sgsi_tracer *tracer, size_t rows)
{
    sgsi_large_scratch *best = NULL;
    pthread_mutex_lock(&tracer->shared_lock);
    for (int i = 0; i < sgsi_threads(); ++i) { // each thread holds at most one
        sgsi_large_scratch *shared = &tracer->threads[i]->shared;
        if (shared->taken)
            continue;
        const size_t capacity = shared->scratch.capacity, most = best ? best->scratch.capacity : 0;
        if (!best || (most < rows ? capacity > most : capacity >= rows && capacity < most))
            best = shared;
    }
    best->taken = true;
    pthread_mutex_unlock(&tracer->shared_lock);
    return best;
}

void sgsi_thread_release(sgsi_tracer *tracer, thread_state *state)
{
    if (!state->held)
        return;
    pthread_mutex_lock(&tracer->shared_lock);
    state->held->taken = false;
    pthread_mutex_unlock(&tracer->shared_lock);
    state->held = NULL;
    state->scratch = &state->own;
}

bool sgsi_thread_reserve(sgsi_tracer *tracer, thread_state *state, size_t rows)
{
    if (rows <= SGSI_OWN_ROWS)
        return sgsi_scratch_reserve(state->scratch, rows);
    if (!state->held || rows > state->scratch->capacity) {
        sgsi_thread_release(tracer, state);
        state->held = take_shared(tracer, rows);
        state->scratch = &state->held->scratch;
    }
    if (rows > state->held->used)
        state->held->used = rows;
    return sgsi_scratch_reserve(state->scratch, rows);
}

void sgsi_large_scratches_trim(sgsi_tracer *tracer)
{
    if (++tracer->passes % TRIM_PASSES)
        return;
    for (int i = 0; i < MAX_THREADS && tracer->threads[i]; ++i) {
        sgsi_large_scratch *shared = &tracer->threads[i]->shared;
        if (shared->used < shared->scratch.capacity / 2)
            sgsi_scratch_free(&shared->scratch);
        shared->used = 0;
    }
}
