// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Process-wide settings: threads, instruction set, versions. Set them before other calls; none of
// these functions is meant to run beside a working library call.

#include <stdbool.h>
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

// Threads used by the coming calls; 0 = as many as sgs_cores (the default). Not while another
// thread is inside of a call.
SGS_API void sgs_threads_set(int count);
SGS_API int sgs_threads_get(void);
// Cores of the affinity mask, or, rounded up, the processor time that a control group (a container,
// a batch job) allows, where that is less.
SGS_API int sgs_cores(void);

// Instruction set of the kernels. Default: the best the machine has. Fails with UNSUPPORTED when
// the machine (or the build) lacks it; the setting is then unchanged.
SGS_API sgs_status sgs_isa_set(sgs_isa isa);
SGS_API sgs_isa sgs_isa_get(void);
SGS_API bool sgs_isa_supported(sgs_isa isa);
// "baseline", "avx2", "avx512"; NULL outside the enum.
SGS_API const char *sgs_isa_name(sgs_isa isa);

// "1.0.0", the commit it was built from ("unknown" outside a checkout), and one line naming the
// versions of Embree, OpenImageIO and OpenEXR in use. Constant strings.
SGS_API const char *sgs_version(void);
SGS_API const char *sgs_version_commit(void);
SGS_API const char *sgs_version_libraries(void);

// Highest resident set size of this process so far, in bytes (0 when the system does not tell).
SGS_API uint64_t sgs_rss_peak(void);
// Resident set size now, in bytes.
SGS_API uint64_t sgs_rss_current(void);
// Memory that there is for this process, in bytes: main memory and swap, or what its control group
// allows where that is less; UINT64_MAX when the system does not tell.
SGS_API uint64_t sgs_machine_memory(void);

#ifdef __cplusplus
}
#endif
