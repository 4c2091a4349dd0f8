// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Lines "what: value" and digests that a program passes to sgs_ranks_compare before its ranks
// divide work: of the program itself, a camera, a photo and a file. Training makes its own
// comparison (sgs_trainer_ranks_set).
//
// Threads: all functions may be called from any thread at any time.

#include <stdint.h>

#include "sparegs/ranks.h"
#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

// Lines for the version, the class of instruction sets, and a digest of values of the C library's
// exp, log and pow: ranks with equal lines compute the same bits. Release with free(); NULL if out
// of memory.
SGS_API char *sgs_rank_program_text(void);

// Digests of the values; equal on all machines with the same byte order. Cannot fail.
SGS_API uint64_t sgs_rank_camera_digest(const sgs_camera *camera, const sgs_pose *pose);
SGS_API uint64_t sgs_rank_photo_digest(const sgs_photo *photo);

// Digest of the bytes of a file; 0 if it cannot be read.
SGS_API uint64_t sgs_rank_file_digest(const char *path);

#ifdef __cplusplus
}
#endif
