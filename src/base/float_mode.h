// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The floating-point mode of the library: round to nearest, no traps, denormals flushed to zero.
// Embree requires the last, and denormal arithmetic takes hundreds of cycles per operation. The
// whole control word is set, so that results do not depend on the caller's fesetround(), and its
// feenableexcept() does not end the program in a kernel.

#ifdef __x86_64__
#include <xmmintrin.h>

typedef unsigned sgsi_float_mode;

// All six exceptions masked, nearest, flush to zero, denormals are zero.
#define SGSI_FLOAT_MODE 0x9fc0u

static inline sgsi_float_mode sgsi_float_mode_get(void)
{
    return _mm_getcsr();
}

static inline void sgsi_float_mode_set(sgsi_float_mode mode)
{
    _mm_setcsr(mode);
}
#elif defined(__aarch64__)
#include <stdint.h>

typedef uint64_t sgsi_float_mode;

// FZ; traps disabled, nearest.
#define SGSI_FLOAT_MODE (UINT64_C(1) << 24)

static inline sgsi_float_mode sgsi_float_mode_get(void)
{
    sgsi_float_mode mode;
    __asm__ __volatile__("mrs %0, fpcr" : "=r"(mode));
    return mode;
}

static inline void sgsi_float_mode_set(sgsi_float_mode mode)
{
    __asm__ __volatile__("msr fpcr, %0" : : "r"(mode));
}
#else
typedef int sgsi_float_mode;

#define SGSI_FLOAT_MODE 0

static inline sgsi_float_mode sgsi_float_mode_get(void)
{
    return 0;
}

static inline void sgsi_float_mode_set(sgsi_float_mode mode)
{
    (void)mode;
}
#endif

// Returns the previous mode, which the caller sets again afterwards.
static inline sgsi_float_mode sgsi_float_mode_enter(void)
{
    const sgsi_float_mode mode = sgsi_float_mode_get();
    sgsi_float_mode_set(SGSI_FLOAT_MODE);
    return mode;
}
