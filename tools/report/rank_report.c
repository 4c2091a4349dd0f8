// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/rank_report.h"

#include <stdio.h>

// Achieved latencies of a message and bandwidths in each direction of common networks.
typedef struct network {
    const char *name;
    double latency, bandwidth; // seconds, bytes per second
} network;

static const network networks[] = {{"10GbE", 30e-6, 1.0e9},
                                   {"25GbE", 30e-6, 2.4e9},
                                   {"100GbE", 4e-6, 9e9},
                                   {"HDR InfiniBand", 2.5e-6, 18e9}};
enum { NETWORKS = sizeof networks / sizeof *networks };

// The calls of an iteration, in their order.
static const sgs_ranks_purpose calls[] = {SGS_RANKS_RECORDS, SGS_RANKS_IMAGE, SGS_RANKS_SUMS,
                                          SGS_RANKS_GRADIENTS, SGS_RANKS_STATUS};
enum { CALLS = sizeof calls / sizeof *calls };

// An iteration on several such machines: each traces its cells with a BVH over its records, which
// it builds instead of refitting one. The serial part remains, and communication does not overlap
// with computation.
static double speedup(const sgs_rank_prediction *p, const rank_machine *machine,
                      const network *link)
{
    const double shared = machine->iteration - machine->serial - machine->refit;
    const double build = machine->build * p->primitives / machine->primitives;
    return machine->iteration / (machine->serial + shared / (p->ranks * p->balance) + build +
                                 sgs_rank_seconds(p, link->latency, link->bandwidth));
}

void rank_report_print(const sgs_rank_prediction *predictions, size_t count,
                       const rank_machines *machines)
{
    for (size_t i = 0; i < count; ++i) {
        const sgs_rank_prediction *p = &predictions[i];
        const double all = machines->measured.primitives / 100;
        printf(
            "  %d ranks: balance %.3f; a rank has up to %.1f %% of the primitives, %.1f %% are in "
            "view, %.1f %% are hit\n",
            p->ranks, p->balance, p->primitives / all, p->traced / all, p->hit / all);
        printf("    sent by all:");
        for (int k = 0; k < CALLS; ++k) {
            const sgs_rank_call *call = &p->calls[calls[k]];
            printf("%s %s %.3f MB in %.0f messages", k ? "," : "", sgs_ranks_purpose_name(calls[k]),
                   1e-6 * call->bytes, call->messages);
        }
        putchar('\n');
        for (int n = 0; n < NETWORKS; ++n)
            printf("    %-14s %8.2f ms; predicted speed-up over one machine: %.2f with %d "
                   "thread%s, %.2f with 64 cores\n",
                   networks[n].name,
                   1e3 * sgs_rank_seconds(p, networks[n].latency, networks[n].bandwidth),
                   speedup(p, &machines->measured, &networks[n]), machines->threads,
                   machines->threads == 1 ? "" : "s", speedup(p, &machines->large, &networks[n]));
    }
}

static json_t *calls_json(const sgs_rank_prediction *p)
{
    json_t *object = json_object();
    for (int k = 0; k < CALLS; ++k) {
        const sgs_rank_call *call = &p->calls[calls[k]];
        json_object_set_new(object, sgs_ranks_purpose_name(calls[k]),
                            json_pack("{s:f,s:f,s:f,s:f,s:f}", "calls", call->calls, "messages",
                                      call->messages, "bytes", call->bytes, "most_messages",
                                      call->max_messages, "most_bytes", call->max_bytes));
    }
    return object;
}

json_t *rank_report_json(const sgs_rank_prediction *predictions, size_t count,
                         const rank_machines *machines)
{
    json_t *array = json_array();
    for (size_t i = 0; i < count; ++i) {
        const sgs_rank_prediction *p = &predictions[i];
        json_t *object = json_pack("{s:i,s:f,s:f,s:f,s:f,s:f}", "ranks", p->ranks, "balance",
                                   p->balance, "primitives", p->primitives, "traced", p->traced,
                                   "hit", p->hit, "build_seconds", machines->measured.build);
        json_object_set_new(object, "calls", calls_json(p));
        json_t *links = json_array();
        for (int n = 0; n < NETWORKS; ++n)
            json_array_append_new(
                links, json_pack("{s:s,s:f,s:f,s:f,s:f,s:f}", "name", networks[n].name, "latency",
                                 networks[n].latency, "bandwidth", networks[n].bandwidth, "seconds",
                                 sgs_rank_seconds(p, networks[n].latency, networks[n].bandwidth),
                                 "speedup", speedup(p, &machines->measured, &networks[n]),
                                 "speedup_64_cores", speedup(p, &machines->large, &networks[n])));
        json_object_set_new(object, "networks", links);
        json_array_append_new(array, object);
    }
    return array;
}
