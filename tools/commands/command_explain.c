// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs explain`: quota, slack and weight of SPARE-GS's regions, the quantities that they derive
// from, and how many primitives each region gained and lost.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "arguments/shared_options.h"
#include "cli/commands.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "options/options.h"
#include "run/region_file.h"
#include "run/region_json.h"

static const char description[] =
    "Reports the SPARE-GS quotas of the training run in the folder OUT. For the regions furthest "
    "from their quota at the last structural update, or for the region around a point, prints "
    "demand, quota, number of primitives, and how many were cloned, split and removed.";

typedef struct explain_values {
    const char *region;
    int top;
} explain_values;

static const option explain_options[] = {
    {.name = "top",
     .kind = OPTION_INTEGER,
     .offset = offsetof(explain_values, top),
     .low = 1,
     .high = 100000,
     .argument = "N",
     .initial = "20",
     .unit = "regions",
     .help = "number of regions to list, furthest from their quota first"},
    {.name = "region",
     .kind = OPTION_TEXT,
     .offset = offsetof(explain_values, region),
     .argument = "X,Y,Z",
     .shown = "none",
     .unit = "scene units",
     .help = "report the region that contains this point, at all updates"},
};

// Prints one region at one update.
static void print_region(const sgs_regions *update, const sgs_region *r, bool dated)
{
    double center[3];
    region_center(update, r->voxel, center);
    if (dated)
        printf("iteration %d: ", update->iteration);
    else
        printf("around (%.3g, %.3g, %.3g): ", center[0], center[1], center[2]);
    printf("%u primitives, quota %.1f (demand %.2f of 2, capacity %.2f): %s, slack %.2f, weight "
           "%.2f; ",
           r->count, (double)r->quota, (double)r->demand, (double)r->capacity,
           (double)r->count > (double)r->quota ? "over quota" : "under quota", (double)r->slack,
           (double)r->weight);
    printf("%u densified, %u pruned by the pipeline, %u pruned as redundant\n", r->densified,
           r->removed, r->redundant);
}

static double excess(const sgs_region *r)
{
    return fabs((double)r->count - (double)r->quota);
}

static int by_excess(const void *a, const void *b)
{
    const sgs_region *x = a, *y = b;
    return excess(x) > excess(y)   ? -1
           : excess(x) < excess(y) ? 1
                                   : (x->voxel > y->voxel) - (x->voxel < y->voxel);
}

static int explain_top(const region_history *history, int top, bool json)
{
    const sgs_regions *last = &history->updates[history->count - 1];
    sgs_region *sorted = malloc((last->count ? last->count : 1) * sizeof *sorted);
    if (!sorted)
        return fail_run("out of memory for %zu regions", last->count);
    memcpy(sorted, last->regions, last->count * sizeof *sorted);
    qsort(sorted, last->count, sizeof *sorted, by_excess);
    json_t *list = json_array();
    size_t over = 0, primitives = 0, held = 0;
    for (size_t i = 0; i < last->count; ++i) {
        const bool is_over = (double)sorted[i].count > (double)sorted[i].quota;
        over += is_over;
        primitives += sorted[i].count;
        held += is_over ? sorted[i].count : 0;
    }
    if (!json)
        printf("iteration %d: %zu primitives in %zu regions of a %d^3 grid; %zu regions with %.0f "
               "%% of the primitives are over quota\n",
               last->iteration, primitives, last->count, last->grid, over,
               primitives ? 100.0 * (double)held / (double)primitives : 0.0);
    for (size_t i = 0; i < last->count && i < (size_t)top; ++i) {
        if (json)
            json_array_append_new(list, region_json(last, &sorted[i]));
        else
            print_region(last, &sorted[i], false);
    }
    free(sorted);
    if (json)
        return print_json(json_pack("{s:i,s:o}", "iteration", last->iteration, "regions", list))
                   ? EXIT_DONE
                   : EXIT_FAILED;
    json_decref(list);
    return EXIT_DONE;
}

// The region that contains a point at an update, or NULL if it has no primitives.
static const sgs_region *region_at(const sgs_regions *update, const double point[3])
{
    bool inside;
    const uint32_t voxel = region_voxel(update, point, &inside);
    return inside ? region_find(update, voxel) : NULL;
}

static int explain_point(const region_history *history, const double point[3], bool json)
{
    json_t *list = json_array();
    size_t found = 0;
    for (size_t u = 0; u < history->count; ++u) {
        const sgs_region *region = region_at(&history->updates[u], point);
        found += region != NULL;
        if (json && region)
            json_array_append_new(list, region_json(&history->updates[u], region));
        else if (!json && region)
            print_region(&history->updates[u], region, true);
        else if (!json)
            printf("iteration %d: no primitives in this region\n", history->updates[u].iteration);
    }
    if (json)
        return print_json(json_pack("{s:o}", "updates", list)) ? EXIT_DONE : EXIT_FAILED;
    json_decref(list);
    return found
               ? EXIT_DONE
               : fail_run("the region of (%g, %g, %g) has no primitives in any structural update; "
                          "choose a point within the bounds that 'sparegs info' prints",
                          point[0], point[1], point[2]);
}

int command_explain(int argc, char **argv)
{
    command_call call;
    explain_values values = {0};
    const command_spec spec = {.name = "explain",
                               .synopsis = "OUT [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 1,
                               .title = "Explanation",
                               .options = explain_options,
                               .option_count = sizeof explain_options / sizeof *explain_options,
                               .values = &values};
    int status = command_begin(&spec, argc, argv, &call);
    double point[3];
    char rest;
    if (status < 0 && values.region &&
        (sscanf(values.region, "%lf,%lf,%lf%c", &point[0], &point[1], &point[2], &rest) != 3 ||
         !isfinite(point[0] + point[1] + point[2])))
        status = fail_usage("--region: '%s' is not a point X,Y,Z", values.region);
    if (status < 0 && values.region)
        status = refuse_idle(&call.line, "top", "with --region");
    if (status >= 0)
        return status;
    const char *folder = call.line.operands[0];
    char *config = format_text("%s/config.json", folder);
    const bool is_run = file_exists(config);
    free(config);
    if (!is_run)
        return fail_run("%s: not a run folder: config.json is missing", folder);
    region_history history;
    if (!region_history_read(folder, &history))
        return EXIT_FAILED;
    if (!history.count)
        status = fail_run(
            "%s: no structural update with SPARE-GS was recorded; train with --spare on", folder);
    else
        status = values.region ? explain_point(&history, point, call.common.json)
                               : explain_top(&history, values.top, call.common.json);
    region_history_free(&history);
    return status;
}
