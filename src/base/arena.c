// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Bump allocator in chunks of at least one MiB.

#include "base/arena.h"

#include "base/core.h"

enum { CHUNK_WORDS = 1 << 18 };

uint32_t *sgsi_arena_take(sgsi_arena *arena, size_t words)
{
    for (;; ++arena->current, arena->used = 0) {
        if (arena->current == arena->chunk_count) {
            if (arena->chunk_count == arena->chunk_capacity) {
                const size_t capacity = arena->chunk_capacity ? 2 * arena->chunk_capacity : 16;
                if (!sgsi_grow((void **)&arena->chunks, arena->chunk_count, capacity,
                               sizeof *arena->chunks))
                    return NULL;
                arena->chunk_capacity = capacity;
            }
            const size_t capacity = words > CHUNK_WORDS ? words : CHUNK_WORDS;
            uint32_t *block = sgsi_alloc(capacity, sizeof *block);
            if (!block)
                return NULL;
            arena->chunks[arena->chunk_count++] = (sgsi_arena_chunk){block, capacity};
        }
        sgsi_arena_chunk *chunk = &arena->chunks[arena->current];
        if (chunk->capacity - arena->used >= words) {
            uint32_t *taken = chunk->words + arena->used;
            arena->used += words;
            arena->total += words;
            return taken;
        }
    }
}

static void reset(sgsi_arena *arena)
{
    arena->current = 0;
    arena->used = 0;
    arena->total = 0;
}

size_t sgsi_arena_used(const sgsi_arena *arena)
{
    return arena->total;
}

bool sgsi_arena_reserve(sgsi_arena *arena, size_t words)
{
    reset(arena);
    if (!words || (arena->chunk_count && arena->chunks[0].capacity >= words))
        return true;
    sgsi_arena_free(arena);
    const bool reserved = sgsi_arena_take(arena, words) != NULL;
    reset(arena);
    return reserved;
}

void sgsi_arena_free(sgsi_arena *arena)
{
    for (size_t i = 0; i < arena->chunk_count; ++i)
        sgsi_free(arena->chunks[i].words);
    sgsi_free(arena->chunks);
    *arena = (sgsi_arena){0};
}
