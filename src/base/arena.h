// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Bump allocator that keeps its memory across resets: after the first steps a training step
// allocates nothing.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct sgsi_arena_chunk {
    uint32_t *words;
    size_t capacity;
} sgsi_arena_chunk;

typedef struct sgsi_arena {
    sgsi_arena_chunk *chunks;
    size_t chunk_count, chunk_capacity;
    size_t current, used; // chunk in use and words used in it
    size_t total;         // words handed out since the last reset
} sgsi_arena;

// `words` 32-bit words, uninitialised, valid until the next reset; NULL when out of memory.
uint32_t *sgsi_arena_take(sgsi_arena *arena, size_t words);
// Words handed out since the last reset.
size_t sgsi_arena_used(const sgsi_arena *arena);
// Resets and reserves `words` in one chunk: sgsi_arena_take then hands out as many without
// allocating. (Untouched pages take no memory.) False when out of memory: the arena is then empty
// and grows on demand.
bool sgsi_arena_reserve(sgsi_arena *arena, size_t words);
void sgsi_arena_free(sgsi_arena *arena);
