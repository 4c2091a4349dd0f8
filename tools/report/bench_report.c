// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/bench_report.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_output.h"
#include "cli/reported_files.h"
#include "cli/value_order.h"
#include "report/rank_report.h"
#include "report/scaling_report.h"

typedef struct bench_phase {
    const char *name;
    size_t offset; // in bench_measure
} bench_phase;

#define AT(member) offsetof(bench_measure, sample.member)

static const bench_phase phases[] = {
    {"gather", AT(gather)},       {"forward", AT(forward)},
    {"backward", AT(backward)},   {"total", offsetof(bench_measure, total)},
    {"project", AT(project)},     {"reduce", AT(reduce)},
    {"loss", AT(loss)},           {"optimizer", AT(optimizer)},
    {"refit", AT(refit)},         {"build", AT(build)},
    {"iteration", AT(iteration)},
};
enum { PHASE_COUNT = sizeof phases / sizeof *phases, PHASE_TOTAL = 3, PHASE_PROJECT = 4 };

typedef struct spread {
    double median, low, high;
} spread;

// Seconds over the repetitions.
static spread phase_spread(const bench_result *result, const bench_phase *phase)
{
    double sorted[1024];
    const size_t n = result->repeat;
    for (size_t i = 0; i < n; ++i)
        memcpy(&sorted[i], (const char *)&result->measures[i] + phase->offset, sizeof sorted[i]);
    qsort(sorted, n, sizeof *sorted, compare_doubles);
    return (spread){n % 2 ? sorted[n / 2] : 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]), sorted[0],
                    sorted[n - 1]};
}

// Conversion factors from wall-clock seconds.
static double ns_per_hit(const bench_result *r)
{
    return r->counts.hits > 0 ? 1e9 * r->threads / r->counts.hits : 0;
}

static double cycles_per_hit(const bench_result *r)
{
    return ns_per_hit(r) * r->limits.tsc_ghz;
}

static double core_seconds_per_mp(const bench_result *r)
{
    return 1e6 * r->threads / r->counts.pixels;
}

static double hits_per_ray(const bench_result *r)
{
    return r->counts.hits / r->counts.pixels;
}

static double lane_use(const bench_result *r)
{
    return r->counts.evaluations > 0 ? r->counts.hits / (16 * r->counts.evaluations) : 0;
}

// Work of a phase per iteration: operations required by the formulas, and bytes moved. 0 if not
// counted.
static double pairs_phase(const bench_phase *phase, double forward, double backward)
{
    return phase->offset == AT(forward)    ? forward
           : phase->offset == AT(backward) ? backward
           : phase == &phases[PHASE_TOTAL] ? forward + backward
                                           : 0;
}

static double phase_flops(const sgs_bench_counts *c, const bench_phase *phase)
{
    return pairs_phase(phase, c->forward_flops, c->backward_flops);
}

static double phase_l2_bytes(const sgs_bench_counts *c, const bench_phase *phase)
{
    return pairs_phase(phase, c->forward_l2_bytes, c->backward_l2_bytes);
}

static double phase_bytes(const sgs_bench_counts *c, const bench_phase *phase)
{
    const sgs_train_bytes *b = &c->bytes;
    const struct {
        size_t offset;
        double bytes;
    } moved[] = {
        {AT(gather), b->gather},
        {AT(forward), b->project + b->forward},
        {AT(backward), b->backward},
        {offsetof(bench_measure, total), b->gather + b->project + b->forward + b->backward},
        {AT(project), b->project},
        {AT(loss), b->loss},
        {AT(optimizer), b->optimizer},
        {AT(refit), b->bvh},
        {AT(reduce), b->reduce},
        {AT(build), c->build_bytes},
        {AT(iteration), b->total}};
    for (size_t i = 0; i < sizeof moved / sizeof *moved; ++i)
        if (moved[i].offset == phase->offset)
            return moved[i].bytes;
    return 0;
}

// Shares of the machine's limits, from 0 to 1 (slightly more if data stays in caches). 0 if not
// counted.
static double share_of_fma(const bench_result *r, const bench_phase *phase)
{
    return phase_flops(&r->counts, phase) /
           (1e9 * r->limits.fma_gflops * r->threads * phase_spread(r, phase).median);
}

static double share_of_memory(const bench_result *r, const bench_phase *phase)
{
    return phase_bytes(&r->counts, phase) /
           (1e9 * r->limits.memory_gbs * phase_spread(r, phase).median);
}

static double share_of_l2(const bench_result *r, const bench_phase *phase)
{
    return phase_l2_bytes(&r->counts, phase) /
           (1e9 * r->limits.l2_gbs * r->threads * phase_spread(r, phase).median);
}

// Medians of serial time and of waiting time in parallel loops.
static sgs_scaling scaling_of(const bench_result *r)
{
    static const bench_phase serial = {"serial", AT(serial)}, waiting = {"waiting", AT(waiting)};
    return (sgs_scaling){.seconds = phase_spread(r, &phases[PHASE_COUNT - 1]).median,
                         .serial = phase_spread(r, &serial).median,
                         .waiting = phase_spread(r, &waiting).median,
                         .bytes = r->counts.bytes.total,
                         .threads = r->threads,
                         .cores = sgs_cores(),
                         .macrotile_seconds = phase_spread(r, &phases[0]).median +
                                              phase_spread(r, &phases[1]).median -
                                              phase_spread(r, &phases[PHASE_PROJECT]).median,
                         .macrotiles = r->counts.bytes.macrotiles};
}

// This machine, and one of 64 cores: its times are those of one core divided by the predicted
// speed-up.
static rank_machines machines_of(const bench_result *r)
{
    static const bench_phase refit = {"refit", AT(refit)}, build = {"rank build", AT(rank_build)};
    const sgs_scaling scaling = scaling_of(r);
    const rank_machine measured = {.iteration = scaling.seconds,
                                   .serial = scaling.serial,
                                   .refit = phase_spread(r, &refit).median,
                                   .build = phase_spread(r, &build).median,
                                   .primitives = r->counts.primitives};
    const scaling_target *target = &scaling_targets[SCALING_TARGETS - 1];
    const int width = scaling.cores && scaling.cores < r->threads ? scaling.cores : r->threads;
    const double work = (scaling.seconds - scaling.serial - scaling.waiting) * width;
    const double seconds =
        (scaling.serial + work) / sgs_scaling_predict(&scaling, target->cores, target->memory_gbs);
    const double faster = seconds / scaling.seconds;
    rank_machine large = measured;
    large.iteration = seconds;
    large.refit *= faster;
    large.build *= faster;
    return (rank_machines){measured, large, r->threads};
}

static void print_row(const bench_result *r, const bench_phase *phase)
{
    const spread s = phase_spread(r, phase);
    printf("  %-10s %9.4f s  [%.4f, %.4f] %8.3f core-s/MP %8.2f cycles %7.2f ns per hit",
           phase->name, s.median, s.low, s.high, s.median * core_seconds_per_mp(r),
           s.median * cycles_per_hit(r), s.median * ns_per_hit(r));
    if (phase_flops(&r->counts, phase) > 0)
        printf(", %.1f %% of FMA, %.1f %% of L2", 100 * share_of_fma(r, phase),
               100 * share_of_l2(r, phase));
    if (phase_bytes(&r->counts, phase) > 0)
        printf(", %.0f MB, %.1f %% of memory", 1e-6 * phase_bytes(&r->counts, phase),
               100 * share_of_memory(r, phase));
    putchar('\n');
}

static void print_scaling(const bench_result *r)
{
    const sgs_scaling scaling = scaling_of(r);
    printf("  serial %.2f %% and waiting %.2f %% of an iteration; predicted speed-up",
           100 * scaling.serial / scaling.seconds, 100 * scaling.waiting / scaling.seconds);
    for (int i = 0; i < SCALING_TARGETS; ++i) {
        const scaling_target *target = &scaling_targets[i];
        printf("%s %.1f on %d cores with %.0f GB/s", i ? "," : "",
               sgs_scaling_predict(&scaling, target->cores, target->memory_gbs), target->cores,
               target->memory_gbs);
    }
    putchar('\n');
}

void bench_print_table(const bench_report *report)
{
    for (size_t i = 0; i < report->count; ++i) {
        const bench_result *r = &report->results[i];
        const sgs_bench_counts *c = &r->counts;
        if (!i || r->threads != report->results[i - 1].threads)
            printf("limits, %d thread%s: %.1f GFLOP/s and %.1f GB/s from L2 (%zu KiB) per core; "
                   "memory %.1f GB/s reading, "
                   "%.1f GB/s updating; TSC %.3f GHz\n",
                   r->threads, r->threads == 1 ? "" : "s", r->limits.fma_gflops, r->limits.l2_gbs,
                   r->limits.l2_bytes >> 10, r->limits.memory_read_gbs, r->limits.memory_update_gbs,
                   r->limits.tsc_ghz);
        printf("%s, %s, %d thread%s: %.0f primitives, %.0f pixels\n", r->name, sgs_isa_name(r->isa),
               r->threads, r->threads == 1 ? "" : "s", c->primitives, c->pixels);
        printf("  %.1f hits per ray, %.0f candidates per tile in front of the depth bounds, %.1f "
               "evaluated and %.1f hit per "
               "block, %.1f %% of lanes "
               "used\n",
               hits_per_ray(r), c->candidates / c->tiles, c->evaluations / (16 * c->tiles),
               c->block_hits / (16 * c->tiles), 100 * lane_use(r));
        for (int k = 0; k < PHASE_COUNT; ++k)
            print_row(r, &phases[k]);
        print_scaling(r);
        const rank_machines machines = machines_of(r);
        rank_report_print(r->ranks, r->rank_count, &machines);
    }
}

// Prints a CSV field, quoted if necessary (RFC 4180).
static void put_field(const char *text)
{
    if (!strpbrk(text, ",\"\r\n")) {
        fputs(text, stdout);
        return;
    }
    putchar('"');
    for (; *text; ++text) {
        if (*text == '"')
            putchar('"');
        putchar(*text);
    }
    putchar('"');
}

void bench_print_csv(const bench_report *report)
{
    printf("name,isa,threads,primitives,pixels,hits_per_ray,candidates_per_tile,evaluations_per_"
           "block,block_hits_per_block,"
           "lane_use,tsc_ghz,fma_gflops,l2_gbs,memory_gbs,serial_share,waiting_share,bytes");
    for (int k = 0; k < PHASE_COUNT; ++k)
        printf(",%s_seconds,%s_min,%s_max,%s_core_seconds_per_mp,%s_cycles_per_hit,%s_ns_per_hit",
               phases[k].name, phases[k].name, phases[k].name, phases[k].name, phases[k].name,
               phases[k].name);
    putchar('\n');
    for (size_t i = 0; i < report->count; ++i) {
        const bench_result *r = &report->results[i];
        const sgs_bench_counts *c = &r->counts;
        const sgs_scaling scaling = scaling_of(r);
        put_field(r->name);
        printf(",%s,%d,%.0f,%.0f,%.3f,%.2f,%.3f,%.3f,%.4f,%.4f,%.1f,%.1f,%.1f,%.5f,%.5f,%.0f",
               sgs_isa_name(r->isa), r->threads, c->primitives, c->pixels, hits_per_ray(r),
               c->candidates / c->tiles, c->evaluations / (16 * c->tiles),
               c->block_hits / (16 * c->tiles), lane_use(r), r->limits.tsc_ghz,
               r->limits.fma_gflops, r->limits.l2_gbs, r->limits.memory_gbs,
               scaling.serial / scaling.seconds, scaling.waiting / scaling.seconds, scaling.bytes);
        for (int k = 0; k < PHASE_COUNT; ++k) {
            const spread s = phase_spread(r, &phases[k]);
            printf(",%.6f,%.6f,%.6f,%.4f,%.3f,%.3f", s.median, s.low, s.high,
                   s.median * core_seconds_per_mp(r), s.median * cycles_per_hit(r),
                   s.median * ns_per_hit(r));
        }
        putchar('\n');
    }
}

// The phase medians times a factor.
static json_t *phases_json(const bench_result *r, double factor)
{
    json_t *object = json_object();
    for (int k = 0; k < PHASE_COUNT; ++k)
        json_object_set_new(object, phases[k].name,
                            json_number(phase_spread(r, &phases[k]).median * factor));
    return object;
}

static json_t *spread_json(const bench_result *r)
{
    json_t *object = json_object();
    for (int k = 0; k < PHASE_COUNT; ++k) {
        const spread s = phase_spread(r, &phases[k]);
        json_t *pair = json_array();
        json_array_append_new(pair, json_number(s.low));
        json_array_append_new(pair, json_number(s.high));
        json_object_set_new(object, phases[k].name, pair);
    }
    return object;
}

static json_t *result_json(const bench_result *r)
{
    const sgs_bench_counts *c = &r->counts;
    json_t *object = json_object();
    json_object_set_new(object, "name", json_text(r->name));
    json_object_set_new(object, "isa", json_string(sgs_isa_name(r->isa)));
    json_object_set_new(object, "threads", json_integer(r->threads));
    json_object_set_new(object, "primitives", json_integer((json_int_t)c->primitives));
    json_object_set_new(object, "pixels", json_number(c->pixels));
    json_object_set_new(object, "repeat", json_integer((json_int_t)r->repeat));
    json_object_set_new(object, "hits_per_ray", json_number(hits_per_ray(r)));
    json_object_set_new(object, "candidates_per_tile", json_number(c->candidates / c->tiles));
    json_object_set_new(object, "evaluations_per_block",
                        json_number(c->evaluations / (16 * c->tiles)));
    json_object_set_new(object, "block_hits_per_block",
                        json_number(c->block_hits / (16 * c->tiles)));
    json_object_set_new(object, "lane_use", json_number(lane_use(r)));
    json_object_set_new(object, "fallback_gathers", json_number(c->fallback_gathers));
    json_object_set_new(object, "cycles_per_hit", phases_json(r, cycles_per_hit(r)));
    json_object_set_new(object, "ns_per_hit", phases_json(r, ns_per_hit(r)));
    json_object_set_new(object, "core_seconds_per_mp", phases_json(r, core_seconds_per_mp(r)));
    json_object_set_new(object, "seconds", phases_json(r, 1));
    json_object_set_new(object, "seconds_range", spread_json(r));
    json_t *bytes = json_object(), *fma = json_object(), *l2 = json_object(),
           *memory = json_object();
    for (int k = 0; k < PHASE_COUNT; ++k) {
        const bench_phase *phase = &phases[k];
        if (phase_flops(c, phase) > 0) {
            json_object_set_new(fma, phase->name, json_number(share_of_fma(r, phase)));
            json_object_set_new(l2, phase->name, json_number(share_of_l2(r, phase)));
        }
        if (phase_bytes(c, phase) <= 0)
            continue;
        json_object_set_new(bytes, phase->name, json_number(phase_bytes(c, phase)));
        json_object_set_new(memory, phase->name, json_number(share_of_memory(r, phase)));
    }
    json_object_set_new(object, "bytes", bytes);
    json_object_set_new(object, "share_of_fma", fma);
    json_object_set_new(object, "share_of_l2", l2);
    json_object_set_new(object, "share_of_memory", memory);
    const sgs_scaling scaling = scaling_of(r);
    json_object_set_new(object, "serial_share", json_number(scaling.serial / scaling.seconds));
    json_object_set_new(object, "waiting_share", json_number(scaling.waiting / scaling.seconds));
    json_object_set_new(object, "predicted_speedup", scaling_json(&scaling));
    const rank_machines machines = machines_of(r);
    if (r->ranks)
        json_object_set_new(object, "ranks", rank_report_json(r->ranks, r->rank_count, &machines));
    return object;
}

static json_t *limits_json(const bench_report *report)
{
    json_t *object = json_object(), *threads = json_array();
    const sgs_machine_limits *most = &report->results[0].limits;
    int most_threads = 0;
    for (size_t i = 0; i < report->count; ++i) {
        const bench_result *r = &report->results[i];
        if (r->threads > most_threads) {
            most_threads = r->threads;
            most = &r->limits;
        }
        size_t before = 0; // list each number of threads once
        while (report->results[before].threads != r->threads)
            ++before;
        if (before < i)
            continue;
        json_t *entry = json_object();
        json_object_set_new(entry, "threads", json_integer(r->threads));
        json_object_set_new(entry, "memory_read_gbs", json_number(r->limits.memory_read_gbs));
        json_object_set_new(entry, "memory_update_gbs", json_number(r->limits.memory_update_gbs));
        json_array_append_new(threads, entry);
    }
    json_object_set_new(object, "tsc_ghz", json_number(most->tsc_ghz));
    json_object_set_new(object, "fma_gflops", json_number(most->fma_gflops));
    json_object_set_new(object, "l2_gbs", json_number(most->l2_gbs));
    json_object_set_new(object, "memory_gbs", json_number(most->memory_gbs));
    json_object_set_new(object, "l2_bytes", json_integer((json_int_t)most->l2_bytes));
    json_object_set_new(object, "by_threads", threads);
    return object;
}

bool bench_print_json(const bench_report *report)
{
    json_t *root = json_object(), *benches = json_array();
    for (size_t i = 0; i < report->count; ++i)
        json_array_append_new(benches, result_json(&report->results[i]));
    json_object_set_new(root, "limits", limits_json(report));
    json_object_set_new(root, "benches", benches);
    return print_json(root);
}
