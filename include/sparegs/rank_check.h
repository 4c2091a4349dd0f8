// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What ranks compare by sgs_ranks_compare before they divide work: parts of a text of lines "what:
// value" for the program, a camera and a photograph. Training compares its own
// (sgs_trainer_ranks_set).

#include <stdint.h>

#include "sparegs/ranks.h"
#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

// Lines for version, class of instruction sets and the values of the C library's functions: ranks
// with equal lines compute the same bits. Release with free(); NULL if out of memory.
SGS_API char *sgs_rank_program_text(void);

// Digests of the values, equal on all machines of one byte order. Cannot fail.
SGS_API uint64_t sgs_rank_camera_digest(const sgs_camera *camera, const sgs_pose *pose);
SGS_API uint64_t sgs_rank_photo_digest(const sgs_photo *photo);

// Digest of the bytes of a file; 0 if it cannot be read.
SGS_API uint64_t sgs_rank_file_digest(const char *path);

#ifdef __cplusplus
}
#endif
