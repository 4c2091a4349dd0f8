// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// One atomic word holds the state of a team: the number of the loop, whether it is open, and the
// number of members inside. A member enters an open loop by a compare-and-swap that adds itself.
// The caller closes the loop when no item is left, and is done when the last member has left. The
// loop description is written before the loop opens and changes only after that.

#include "base/thread_team.h"

#include <dlfcn.h>
#include <pthread.h>
#include <stdalign.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "base/float_mode.h"
#include "base/library_thread.h"
#ifdef __x86_64__
#include <immintrin.h>
#endif

enum {
    CACHE_LINE = 64,
    // Polls before sleeping: 50 to 100 microseconds, more than the gap between most loops of an
    // iteration.
    AWAKE = 2000,
};

// Fields of the word: members from MEMBER on, OPEN, the number of the loop from LOOP on.
#define MEMBER UINT64_C(1)
#define MEMBERS UINT64_C(0xFFFF)
#define OPEN UINT64_C(0x10000)
#define LOOP UINT64_C(0x20000)
_Static_assert(SGSI_THREADS_MAX <= 0xFFFF, "the word counts the members in 16 bits");

typedef struct team team;

typedef struct member {
    alignas(CACHE_LINE) team *team;
    pthread_t thread;
    int number;      // 1 ..
    uint64_t loop;   // last loop it took part in
    double finished; // time at which it finished there
} member;

struct team {
    alignas(CACHE_LINE) atomic_uint_fast64_t word;
    alignas(CACHE_LINE) atomic_size_t next; // next item
    alignas(CACHE_LINE) sgsi_item_fn body;
    void *context;
    size_t count, chunk;
    double start;
    alignas(CACHE_LINE) atomic_bool ending;
    atomic_int sleepers; // members asleep
    atomic_bool caller_sleeps;
    pthread_mutex_t lock;         // for sleeping and waking only
    pthread_cond_t opened, empty; // a loop opened; the last member left a closed one
    int threads;                  // as requested, including the caller
    int size;                     // number of members
    member members[];             // [size]
};

static _Thread_local team *own;
static _Thread_local bool inside;
static pthread_key_t own_key; // ends the team with its thread
static pthread_once_t own_key_once = PTHREAD_ONCE_INIT;
static bool own_key_made;

static inline void breathe(void)
{
#ifdef __x86_64__
    _mm_pause();
#elif defined(__aarch64__)
    __asm__ volatile("isb");
#endif
}

static uint64_t loop_of(uint64_t word)
{
    return word / LOOP;
}

static void take_items(team *t, int thread)
{
    const size_t count = t->count, chunk = t->chunk;
    inside = true;
    for (;;) {
        const size_t begin = atomic_fetch_add_explicit(&t->next, chunk, memory_order_relaxed);
        if (begin >= count)
            break;
        const size_t end = count - begin < chunk ? count : begin + chunk;
        for (size_t item = begin; item < end; ++item)
            t->body(t->context, item, thread);
    }
    inside = false;
}

// Waits for another loop than `seen`; returns the word.
static uint64_t await_loop(team *t, uint64_t seen)
{
    for (int look = 0; look < AWAKE; ++look) {
        const uint64_t word = atomic_load(&t->word);
        if (loop_of(word) != seen)
            return word;
        breathe();
    }
    // The caller changes the word and then checks for sleepers; a member counts itself as a sleeper
    // and then checks the word. One of the two notices the other.
    pthread_mutex_lock(&t->lock);
    atomic_fetch_add(&t->sleepers, 1);
    uint64_t word;
    while (loop_of(word = atomic_load(&t->word)) == seen)
        pthread_cond_wait(&t->opened, &t->lock);
    atomic_fetch_sub(&t->sleepers, 1);
    pthread_mutex_unlock(&t->lock);
    return word;
}

static void leave(team *t)
{
    const uint64_t before = atomic_fetch_sub(&t->word, MEMBER);
    if ((before & MEMBERS) == 1 && !(before & OPEN) && atomic_load(&t->caller_sleeps)) {
        pthread_mutex_lock(&t->lock);
        pthread_cond_signal(&t->empty);
        pthread_mutex_unlock(&t->lock);
    }
}

static void *serve(void *argument)
{
    member *m = argument;
    team *t = m->team;
    sgsi_float_mode_enter();
    uint64_t seen = 0;
    while (!atomic_load(&t->ending)) {
        uint64_t word = await_loop(t, seen);
        seen = loop_of(word);
        while (word & OPEN && loop_of(word) == seen)
            if (atomic_compare_exchange_weak(&t->word, &word, word + MEMBER)) {
                take_items(t, m->number);
                m->loop = seen;
                m->finished = sgsi_seconds() - t->start;
                leave(t);
                break;
            }
    }
    return NULL;
}

// Announces a new loop. With `open` 0 there is none, but every member wakes up.
static void announce(team *t, uint64_t open)
{
    const uint64_t word = atomic_load(&t->word); // closed and empty
    atomic_store(&t->word, (loop_of(word) + 1) * LOOP + open);
    if (atomic_load(&t->sleepers)) {
        pthread_mutex_lock(&t->lock);
        pthread_cond_broadcast(&t->opened);
        pthread_mutex_unlock(&t->lock);
    }
}

static void end_team(void *argument)
{
    team *t = argument;
    if (!t)
        return;
    atomic_store(&t->ending, true);
    announce(t, 0);
    for (int i = 0; i < t->size; ++i)
        pthread_join(t->members[i].thread, NULL);
    pthread_cond_destroy(&t->opened);
    pthread_cond_destroy(&t->empty);
    pthread_mutex_destroy(&t->lock);
    free(t);
}

// Called when a thread ends. If a later destructor runs a loop, it creates a new team, which ends
// here as well.
static void end_own_team(void *argument)
{
    own = NULL;
    end_team(argument);
}

// Runs in the new process, which has none of the members: the key's destructor must not join them.
static void forget_team(void)
{
    pthread_setspecific(own_key, NULL);
    if (!inside) // else the loop that forked still uses it
        free(own);
    own = NULL;
    inside = false;
}

// Members and the destructor of the key run this code until their threads end. A program may unload
// the plug-in or the library that contains it before that; this keeps it in memory.
static void keep_loaded(void)
{
    Dl_info self;
    if (dladdr(&own_key, &self) && self.dli_fname)
        dlopen(self.dli_fname, RTLD_LAZY | RTLD_NOLOAD | RTLD_NODELETE);
}

static void make_own_key(void)
{
    keep_loaded();
    own_key_made =
        !pthread_key_create(&own_key, end_own_team) && !pthread_atfork(NULL, NULL, forget_team);
}

static void start_members(team *t)
{
    for (int i = 0; i + 1 < t->threads; ++i) {
        t->members[i] = (member){.team = t, .number = i + 1};
        if (!sgsi_thread_create(&t->members[i].thread, serve, &t->members[i]))
            break;
        t->size = i + 1;
    }
}

// The team of the calling thread with `threads` threads; NULL when out of memory.
static team *own_team(int threads)
{
    if (own && own->threads == threads)
        return own;
    pthread_once(&own_key_once, make_own_key);
    if (own) {
        pthread_setspecific(own_key, NULL);
        end_own_team(own);
    }
    // Not sgsi_alloc: a loop runs without a team when memory is short, and a team lives as long as
    // its thread.
    const size_t size = sizeof(team) + (size_t)threads * sizeof(member);
    team *t = own_key_made ? aligned_alloc(CACHE_LINE, size) : NULL;
    if (!t)
        return NULL;
    memset(t, 0, size);
    t->threads = threads;
    pthread_mutex_init(&t->lock, NULL);
    pthread_cond_init(&t->opened, NULL);
    pthread_cond_init(&t->empty, NULL);
    if (pthread_setspecific(own_key, t)) { // the team would never end
        end_team(t);
        return NULL;
    }
    start_members(t);
    own = t;
    return t;
}

static void close_loop(team *t)
{
    uint64_t word = atomic_fetch_and(&t->word, ~OPEN) & ~OPEN;
    for (int look = 0; look < AWAKE && word & MEMBERS; ++look) {
        breathe();
        word = atomic_load(&t->word);
    }
    if (!(word & MEMBERS))
        return;
    pthread_mutex_lock(&t->lock);
    atomic_store(&t->caller_sleeps, true);
    while (atomic_load(&t->word) & MEMBERS)
        pthread_cond_wait(&t->empty, &t->lock);
    atomic_store(&t->caller_sleeps, false);
    pthread_mutex_unlock(&t->lock);
}

double sgsi_team_run(int threads, size_t count, size_t chunk, sgsi_item_fn body, void *context,
                     double start)
{
    team *t = own_team(threads);
    if (!t) { // run all items here
        team alone = {.body = body, .context = context, .count = count, .chunk = chunk};
        take_items(&alone, 0);
        return sgsi_seconds() - start;
    }
    t->body = body;
    t->context = context;
    t->count = count;
    t->chunk = chunk;
    t->start = start;
    atomic_store(&t->next, 0);
    announce(t, OPEN);
    take_items(t, 0);
    double finished = sgsi_seconds() - start;
    close_loop(t);
    const uint64_t loop = loop_of(atomic_load(&t->word));
    for (int i = 0; i < t->size; ++i)
        if (t->members[i].loop == loop)
            finished += t->members[i].finished;
    return finished;
}

bool sgsi_team_is_inside(void)
{
    return inside;
}
