// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Flushes denormals to zero inside parallel loops: Embree requires it, and denormal arithmetic
// takes hundreds of cycles per operation.

#ifdef __x86_64__
#include <xmmintrin.h>

typedef unsigned sgsi_float_mode;

// Returns the previous mode.
static inline sgsi_float_mode sgsi_enter_float_mode(void)
{
    const unsigned mode = _mm_getcsr();
    _mm_setcsr(mode | 0x8040u); // flush to zero, denormals are zero
    return mode;
}

static inline void sgsi_leave_float_mode(sgsi_float_mode mode)
{
    _mm_setcsr(mode);
}
#elif defined(__aarch64__)
#include <stdint.h>

typedef uint64_t sgsi_float_mode;

static inline sgsi_float_mode sgsi_enter_float_mode(void)
{
    sgsi_float_mode mode;
    __asm__ __volatile__("mrs %0, fpcr" : "=r"(mode));
    __asm__ __volatile__("msr fpcr, %0" : : "r"(mode | UINT64_C(1) << 24)); // FZ
    return mode;
}

static inline void sgsi_leave_float_mode(sgsi_float_mode mode)
{
    __asm__ __volatile__("msr fpcr, %0" : : "r"(mode));
}
#else
typedef int sgsi_float_mode;

static inline sgsi_float_mode sgsi_enter_float_mode(void)
{
    return 0;
}

static inline void sgsi_leave_float_mode(sgsi_float_mode mode)
{
    (void)mode;
}
#endif
