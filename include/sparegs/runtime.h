// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Settings and facts of the process: threads, instruction set, versions, memory.
//
// Threads: sgs_threads_set and sgs_isa_set act on the whole process; call them while no other
// library call runs. The other functions may be called from any thread at any time and cannot fail.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_isa {
    SGS_ISA_BASELINE = 0,
    SGS_ISA_AVX2 = 1,
    SGS_ISA_AVX512 = 2,
    SGS_ISA_COUNT = 3
} sgs_isa;

// Number of threads of the following calls, including the calling one: 1 to 4096; 0 = sgs_cores
// (the default); larger numbers are reduced. Each application thread that calls the library has its
// own team of this size, which ends with that thread; its threads block all signals except
// synchronous faults; so do the decoding threads of an image cache. Embree uses the team and does
// not limit other users of TBB in the process, except during sgs_profile_view. Results do not
// depend on the number.
SGS_API void sgs_threads_set(int count);
SGS_API int sgs_threads_get(void);
// Number of cores in the affinity mask, or the CPU quota of the cgroup (container, batch
// job), rounded up, if that is smaller.
SGS_API int sgs_cores(void);

// Runs body(context, begin, end) on all threads for the ranges of `grain` indices, the last one
// shorter, that [0, count) consists of, in any order; returns when all are done. The ranges depend
// on count and grain (0 counts as 1) only, never on the number of threads. `body` runs in the
// library's floating-point mode: round to nearest, no traps, denormals are 0. A call within `body`
// runs on its thread alone.
typedef void (*sgs_range_fn)(void *context, size_t begin, size_t end);
SGS_API void sgs_parallel_ranges(size_t count, size_t grain, sgs_range_fn body, void *context);

// Instruction set of the kernels. Default: the best that the CPU supports. Fails with
// INVALID_ARGUMENT outside the enumeration, UNSUPPORTED if CPU or build lack it; the setting is
// then unchanged. AVX2 and AVX-512 give the same bits; those of the baseline differ on x86-64.
SGS_API sgs_status sgs_isa_set(sgs_isa isa);
SGS_API sgs_isa sgs_isa_get(void);
SGS_API bool sgs_isa_supported(sgs_isa isa);
// "baseline", "avx2", "avx512"; NULL outside the enum.
SGS_API const char *sgs_isa_name(sgs_isa isa);

// "0.1.0"; the commit of the build ("unknown" outside a checkout); one line with the versions of
// Embree, OpenImageIO and OpenEXR in use. Constant strings.
SGS_API const char *sgs_version(void);
SGS_API const char *sgs_version_commit(void);
SGS_API const char *sgs_version_libraries(void);

// Peak and current resident set size of this process in bytes; 0 if unknown. The peak is at least
// every earlier result of sgs_rss_current.
SGS_API uint64_t sgs_rss_peak(void);
SGS_API uint64_t sgs_rss_current(void);
// Memory available to this process in bytes: main memory and swap, or the limit of its control
// group if that is less; UINT64_MAX if unknown.
SGS_API uint64_t sgs_machine_memory(void);

#ifdef __cplusplus
}
#endif
