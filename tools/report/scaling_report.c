// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/scaling_report.h"

#include "cli/json_output.h"

const scaling_target scaling_targets[SCALING_TARGETS] = {{8, 40}, {32, 160}, {64, 320}};

json_t *scaling_json(const sgs_scaling *scaling)
{
    json_t *list = json_array();
    for (int i = 0; i < SCALING_TARGETS; ++i) {
        const scaling_target *target = &scaling_targets[i];
        json_t *entry = json_object();
        json_object_set_new(entry, "cores", json_integer(target->cores));
        json_object_set_new(entry, "memory_gbs", json_number(target->memory_gbs));
        json_object_set_new(
            entry, "speedup",
            json_number(sgs_scaling_predict(scaling, target->cores, target->memory_gbs)));
        json_array_append_new(list, entry);
    }
    return list;
}

void scaling_add_training(json_t *summary, const sgs_train_seconds *seconds,
                          const sgs_train_bytes *bytes)
{
    const double iterations = bytes->iterations > 0 ? bytes->iterations : 1;
    const struct {
        const char *name;
        double value;
    } phases[] = {{"project", bytes->project},    {"bvh", bytes->bvh},
                  {"gather", bytes->gather},      {"forward", bytes->forward},
                  {"loss", bytes->loss},          {"backward", bytes->backward},
                  {"optimizer", bytes->optimizer}};
    json_t *moved = json_object();
    for (size_t i = 0; i < sizeof phases / sizeof *phases; ++i)
        json_object_set_new(moved, phases[i].name, json_number(phases[i].value / iterations));
    const sgs_scaling scaling = {.seconds = seconds->total,
                                 .serial = seconds->serial,
                                 .waiting = seconds->waiting,
                                 .bytes = bytes->total,
                                 .threads = sgs_threads_get(),
                                 .cores = sgs_cores(),
                                 .macrotile_seconds =
                                     seconds->gather + seconds->forward - seconds->project,
                                 .macrotiles = bytes->macrotiles / iterations};
    json_object_set_new(summary, "serial_seconds", json_number(seconds->serial));
    json_object_set_new(summary, "waiting_seconds", json_number(seconds->waiting));
    json_object_set_new(summary, "bytes_per_iteration", json_number(bytes->total / iterations));
    json_object_set_new(summary, "bytes", moved);
    json_object_set_new(summary, "predicted_speedup", scaling_json(&scaling));
}
