// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The random subset of the cameras in REFINE's released code, which is drawn by Python: Mersenne
// Twister MT19937 (Matsumoto and Nishimura 1998), seeded with the key {42} by init_by_array, and
// random.sample without replacement.

#include <math.h>

#include "base/core.h"
#include "prune/scores.h"

enum { STATE = 624, SHIFT = 397, SEED = 42 };

typedef struct twister {
    uint32_t state[STATE];
    int next;
} twister;

static void seed_by_number(twister *t, uint32_t seed)
{
    t->state[0] = seed;
    for (uint32_t k = 1; k < STATE; ++k)
        t->state[k] = 1812433253u * (t->state[k - 1] ^ t->state[k - 1] >> 30) + k;
    t->next = STATE;
}

// init_by_array for a key of one word.
static void seed_by_key(twister *t, uint32_t key)
{
    seed_by_number(t, 19650218u);
    uint32_t *s = t->state;
    int i = 1;
    for (int k = 0; k < STATE; ++k) {
        s[i] = (s[i] ^ (s[i - 1] ^ s[i - 1] >> 30) * 1664525u) + key;
        if (++i == STATE) {
            s[0] = s[STATE - 1];
            i = 1;
        }
    }
    for (int k = 0; k < STATE - 1; ++k) {
        s[i] = (s[i] ^ (s[i - 1] ^ s[i - 1] >> 30) * 1566083941u) - (uint32_t)i;
        if (++i == STATE) {
            s[0] = s[STATE - 1];
            i = 1;
        }
    }
    s[0] = 0x80000000u;
}

static void refill(twister *t)
{
    uint32_t *s = t->state;
    for (int k = 0; k < STATE; ++k) {
        const uint32_t y = (s[k] & 0x80000000u) | (s[(k + 1) % STATE] & 0x7FFFFFFFu);
        s[k] = s[(k + SHIFT) % STATE] ^ y >> 1 ^ (y & 1 ? 0x9908B0DFu : 0);
    }
    t->next = 0;
}

static uint32_t draw(twister *t)
{
    if (t->next == STATE)
        refill(t);
    uint32_t y = t->state[t->next++];
    y ^= y >> 11;
    y ^= y << 7 & 0x9D2C5680u;
    y ^= y << 15 & 0xEFC60000u;
    return y ^ y >> 18;
}

// Uniform in [0, limit), limit in [1, 2^31): rejects draws of as many bits as limit has.
static size_t draw_below(twister *t, size_t limit)
{
    int bits = 0;
    while (limit >> bits)
        ++bits;
    size_t value;
    do
        value = draw(t) >> (32 - bits);
    while (value >= limit);
    return value;
}

static bool is_drawn(const size_t *chosen, size_t count, size_t value)
{
    for (size_t k = 0; k < count; ++k)
        if (chosen[k] == value)
            return true;
    return false;
}

sgs_status sgsi_refine_sample(size_t count, size_t wanted, size_t *chosen)
{
    twister t;
    seed_by_key(&t, SEED);
    // Python keeps a pool up to this size and a set of drawn indices above it.
    size_t largest_pool = 21;
    if (wanted > 5)
        largest_pool += (size_t)pow(4, ceil(log((double)(3 * wanted)) / log(4)));
    if (count > largest_pool) {
        for (size_t k = 0; k < wanted; ++k) {
            do
                chosen[k] = draw_below(&t, count);
            while (is_drawn(chosen, k, chosen[k]));
        }
        return SGS_STATUS_OK;
    }
    size_t *pool = sgsi_alloc(count, sizeof *pool);
    if (!pool)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to choose from %zu cameras",
                         count);
    for (size_t k = 0; k < count; ++k)
        pool[k] = k;
    for (size_t k = 0; k < wanted; ++k) {
        const size_t at = draw_below(&t, count - k);
        chosen[k] = pool[at];
        pool[at] = pool[count - k - 1];
    }
    sgsi_free(pool);
    return SGS_STATUS_OK;
}
