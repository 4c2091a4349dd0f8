// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Instruction set, versions and memory readings.

#include "sparegs/runtime.h"
#include "sparegs/version.h"

#include <inttypes.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/sysinfo.h>
#include <unistd.h>

#include "base/cgroup_limits.h"
#include "base/core.h"

#ifdef SGSI_AVX_KERNELS
#include <cpuid.h>
#endif

static atomic_int chosen_isa = -1; // detected at the first call

#ifdef SGSI_AVX_KERNELS
// All extensions that the AVX2 kernels are compiled with. A virtual machine may hide some: lzcnt,
// for example, is then executed as bsr, with another result.
static bool has_avx2(void)
{
    unsigned a, b, c, d, c1 = 0;
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma") ||
        !__get_cpuid(1, &a, &b, &c1, &d) || !(c1 & bit_F16C) || !(c1 & bit_POPCNT) ||
        !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & bit_BMI) || !(b & bit_BMI2))
        return false;
    return __get_cpuid(0x80000001, &a, &b, &c, &d) && (c & bit_LZCNT);
}
#endif

bool sgs_isa_supported(sgs_isa isa)
{
    switch (isa) {
    case SGS_ISA_BASELINE:
        return true;
#ifdef SGSI_AVX_KERNELS
    case SGS_ISA_AVX2:
        return has_avx2();
    case SGS_ISA_AVX512:
        return has_avx2() && __builtin_cpu_supports("avx512f") &&
               __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
               __builtin_cpu_supports("avx512vl");
#endif
    default:
        return false;
    }
}

const char *sgs_isa_name(sgs_isa isa)
{
    static const char *const names[SGS_ISA_COUNT] = {"baseline", "avx2", "avx512"};
    return (unsigned)isa < SGS_ISA_COUNT ? names[isa] : NULL;
}

sgs_isa sgs_isa_get(void)
{
    int isa = atomic_load_explicit(&chosen_isa, memory_order_relaxed);
    if (isa < 0) {
        int best = SGS_ISA_COUNT - 1;
        while (!sgs_isa_supported((sgs_isa)best))
            --best;
        // On failure another thread has chosen; isa then holds its choice.
        if (atomic_compare_exchange_strong(&chosen_isa, &isa, best))
            isa = best;
    }
    return (sgs_isa)isa;
}

static sgs_status fail_isa(sgs_isa isa)
{
#ifdef SGSI_AVX_KERNELS
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "CPU or virtual machine lacks an extension that the %s kernels require: AVX2, "
                     "FMA, F16C, BMI1, BMI2, LZCNT, POPCNT%s",
                     sgs_isa_name(isa), isa == SGS_ISA_AVX512 ? ", AVX-512 F, BW, DQ, VL" : "");
#else
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "this build has no %s kernels: they require x86-64 and a build without "
                     "SPAREGS_PORTABLE",
                     sgs_isa_name(isa));
#endif
}

sgs_status sgs_isa_set(sgs_isa isa)
{
    if (!sgs_isa_name(isa))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "unknown instruction set %d", (int)isa);
    if (!sgs_isa_supported(isa))
        return fail_isa(isa);
    atomic_store(&chosen_isa, (int)isa);
    return SGS_STATUS_OK;
}

const char *sgs_version(void)
{
    return SGS_VERSION;
}

const char *sgs_version_commit(void)
{
    return SGSI_COMMIT;
}

static _Atomic uint64_t largest_rss; // that sgs_rss_current has returned

static uint64_t larger(uint64_t a, uint64_t b)
{
    return a > b ? a : b;
}

// VmHWM of /proc/self/status in bytes, or 0.
static uint64_t high_water_mark(void)
{
    char line[256];
    uint64_t kib = 0;
    FILE *stream = fopen("/proc/self/status", "r");
    while (stream && !kib && fgets(line, sizeof line, stream))
        if (sscanf(line, "VmHWM: %" SCNu64, &kib) != 1)
            kib = 0;
    if (stream)
        fclose(stream);
    return kib * 1024;
}

// Linux adds pages to its totals in batches; the three sources differ by what is not added yet.
uint64_t sgs_rss_peak(void)
{
    struct rusage usage;
    const uint64_t used = getrusage(RUSAGE_SELF, &usage) ? 0 : (uint64_t)usage.ru_maxrss * 1024;
    return larger(larger(used, high_water_mark()), atomic_load(&largest_rss));
}

uint64_t sgs_rss_current(void)
{
    uint64_t pages = 0;
    FILE *stream = fopen("/proc/self/statm", "r");
    if (!stream)
        return 0;
    if (fscanf(stream, "%*u %" SCNu64, &pages) != 1)
        pages = 0;
    fclose(stream);
    const uint64_t bytes = pages * (uint64_t)sysconf(_SC_PAGESIZE);
    uint64_t largest = atomic_load(&largest_rss);
    while (bytes > largest && !atomic_compare_exchange_weak(&largest_rss, &largest, bytes)) {
    }
    return bytes;
}

uint64_t sgs_machine_memory(void)
{
    struct sysinfo info;
    uint64_t bytes = UINT64_MAX;
    if (!sysinfo(&info))
        bytes = (uint64_t)info.mem_unit * (info.totalram + info.totalswap);
    const uint64_t allowed = sgsi_group_limits_own().memory;
    return allowed && allowed < bytes ? allowed : bytes;
}
