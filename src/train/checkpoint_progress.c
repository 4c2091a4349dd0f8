// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// One row per member of sgsi_train_progress. A new counter that changes the training is essential;
// a new timer or statistic is optional, so that checkpoints remain readable both ways.

#include "train/checkpoint_progress.h"

// NOLINTBEGIN(bugprone-macro-parentheses): members, not expressions
#define ROW(label, member, kind, is_essential)                                                     \
    {                                                                                              \
        .name = label, .type = SGSI_FIELD_##kind, .offset = offsetof(sgsi_train_progress, member), \
        .essential = is_essential                                                                  \
    }
#define ESSENTIAL(member, kind) ROW(#member, member, kind, true)
#define OPTIONAL(member, kind) ROW(#member, member, kind, false)
// NOLINTEND(bugprone-macro-parentheses)

_Static_assert(sizeof(size_t) == sizeof(uint64_t) && sizeof(int) == sizeof(int32_t),
               "the fields of a checkpoint have fixed sizes");

static const sgsi_field fields[] = {
    ESSENTIAL(iteration, I32),
    ESSENTIAL(adam_step, I32),
    ESSENTIAL(last_reset, I32),
    ESSENTIAL(disturbed, I32),
    ESSENTIAL(order_position, U32),
    ESSENTIAL(order_epoch, U32),
    ESSENTIAL(stop, I32),
    ESSENTIAL(updates, I32),
    ESSENTIAL(rest_step, I32),
    ESSENTIAL(resolution, I32),
    ESSENTIAL(structure_iteration, I32),
    ESSENTIAL(pipeline.initial_count, I64),
    ESSENTIAL(pipeline.momentum, I64),
    OPTIONAL(pipeline.deleted, I64), // 0 in every file without it: mcmc is newer
    ROW("equilibrium.observed", equilibrium.observed[0], U64, true),
    ROW("equilibrium.observed_before", equilibrium.observed[1], U64, true),
    ESSENTIAL(equilibrium.previous_count, U64),
    ESSENTIAL(equilibrium.held, I32),
    OPTIONAL(equilibrium.last_loss_change, F64),
    OPTIONAL(equilibrium.last_loss_error, F64),
    OPTIONAL(equilibrium.last_count_change, F64),
    OPTIONAL(batch_views, I32), // 0 in every file without it: the option batch is newer
    OPTIONAL(loss_average, F64),
    OPTIONAL(loss_weight, F64),
    OPTIONAL(psnr_average, F64),
    OPTIONAL(psnr_weight, F64),
    OPTIONAL(near_limit, F64), // 0 in files without it
    OPTIONAL(start, I32),      // SGSI_START_UNKNOWN in files without it
    OPTIONAL(skipped.steps, U64),
    OPTIONAL(skipped.gradients, U64),
    OPTIONAL(skipped.reports, U64),
    OPTIONAL(seconds.gather, F64),
    OPTIONAL(seconds.forward, F64),
    OPTIONAL(seconds.loss, F64),
    OPTIONAL(seconds.backward, F64),
    OPTIONAL(seconds.optimizer, F64),
    OPTIONAL(seconds.bvh_refit, F64),
    OPTIONAL(seconds.bvh_build, F64),
    OPTIONAL(seconds.density, F64),
    OPTIONAL(seconds.spare, F64),
    OPTIONAL(seconds.image_io, F64),
    OPTIONAL(seconds.total, F64),
    OPTIONAL(seconds.serial, F64),
    OPTIONAL(seconds.waiting, F64),
    OPTIONAL(seconds.project, F64), // 0 in files without it
};
enum { FIELD_COUNT = sizeof fields / sizeof *fields };

void sgsi_train_progress_write(sgsi_field_list *list, const sgsi_train_progress *progress)
{
    sgsi_fields_write(list, fields, FIELD_COUNT, progress);
}

sgs_status sgsi_train_progress_read(const char *path, const uint8_t *bytes, size_t size,
                                    sgsi_train_progress *progress)
{
    *progress = (sgsi_train_progress){0};
    return sgsi_fields_read(path, "progress", bytes, size, fields, FIELD_COUNT, progress);
}
