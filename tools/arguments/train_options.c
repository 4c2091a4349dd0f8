// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The options of `sparegs train`.

#include "arguments/train_options.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "sparegs/option_descriptors.h"
#include "sparegs/runtime.h"

enum { MAX_ROWS = 64, MAX_TEXT = 160 };

// Help of --resume: the options of the library that may change.
static char resume_help[640];

#define AT(member) offsetof(train_values, member)

static const option output_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_FOLDER,
     .offset = AT(output),
     .argument = "OUT",
     .help = "output folder for the model, logs and checkpoints (required)"},
    {.name = "save-at",
     .kind = OPTION_INTEGERS,
     .offset = AT(save_at),
     .low = 1,
     .high = 1e9,
     .argument = "A,B,...",
     .initial = "7000",
     .shown = "7000",
     .unit = "iterations",
     .help = "iterations at which to save the model; the last one is always saved"},
    {.name = "checkpoint-every",
     .kind = OPTION_INTEGER,
     .offset = AT(checkpoint_every),
     .low = 0,
     .high = 1e9,
     .argument = "N",
     .initial = "1000",
     .shown = "1000, 0 = never",
     .unit = "iterations",
     .help =
         "iterations between checkpoints of the full state; the last two are kept. Without this "
         "option, some are skipped if they take more than 5 % of the time"},
    {.name = "time-limit",
     .kind = OPTION_DURATION,
     .offset = AT(time_limit),
     .low = 0,
     .high = 1e9,
     .argument = "TIME",
     .shown = "none",
     .help = "wall-clock limit since the start, for example 90s, 45m, 3h55m, 2d12h; the state is "
             "saved for --resume before the limit"},
    {.name = "max-memory",
     .kind = OPTION_BYTES,
     .offset = AT(max_memory),
     .low = 1e6,
     .high = 1e15,
     .argument = "SIZE",
     .shown = "none",
     .help = "memory limit, for example 500M or 8GiB (K, M, G are powers of 1024): refuse to start "
             "if the estimate exceeds it; save and stop before exceeding it"},
    {.name = "resume", .kind = OPTION_FLAG, .offset = AT(resume), .help = resume_help},
    {.name = "overwrite",
     .kind = OPTION_FLAG,
     .offset = AT(overwrite),
     .help =
         "replace the run in OUT, which moves to OUT/previous; an earlier run there is deleted"},
    {.name = "trace",
     .kind = OPTION_TEXT,
     .path = PATH_OUTPUT,
     .offset = AT(trace),
     .argument = "FILE",
     .shown = "none",
     .help = "write the phases of each iteration as a Chrome/Perfetto trace (about 1.5 KB per "
             "iteration)"},
    LPIPS_OPTIONS(train_values),
    {.name = "eval-train",
     .kind = OPTION_INTEGER,
     .offset = AT(eval_train),
     .low = 0,
     .high = 1e9,
     .word = "all",
     .of_word = EVALUATE_ALL,
     .argument = "N|all",
     .initial = "64",
     .shown = "64, 0 = none",
     .unit = "images",
     .help = "training images, evenly spaced, that are evaluated after the training; the held-out "
             "images are always evaluated"},
    {.name = "view",
     .kind = OPTION_TEXT,
     .offset = AT(view),
     .argument = "[A:]PORT",
     .shown = "none",
     .help = "show the run in the browser at this port of 127.0.0.1 or of IPv4 address A; 0 "
             "chooses a free port; see 'sparegs help view'. A run that is paused in the browser "
             "resumes when no page has been open for 60 s"},
    {.name = "view-share",
     .kind = OPTION_REAL,
     .offset = AT(view_share),
     .low = 1,
     .high = 100,
     .argument = "P",
     .initial = "10",
     .unit = "percent",
     .needs = "view",
     .help = "target for the viewer's share of wall time: rendering and photo decoding"},
    {.name = "view-token",
     .kind = OPTION_TEXT,
     .offset = AT(view_token),
     .argument = "T",
     .shown = "SPAREGS_TOKEN, else none for 127.0.0.0/8 and random for others",
     .needs = "view",
     .help = "token that the viewer requires: random, or 8 to 128 letters, digits, '-' or '_'; see "
             "'sparegs help view'"},
};

// Defaults that the program resolves itself, in words.
static const struct {
    const char *name, *shown;
} resolved_defaults[] = {
    {"filter", "the pipeline's filter"},
    {"background",
     "0,0,0, or 1,1,1 for NeRF synthetic scenes with --alpha over, or random with --opaque"},
    {"alpha_loss", "0 = none, or 0.1 with --opaque"},
};

// The rows of the library's options, made once, and what their texts point to.
static struct {
    option rows[MAX_ROWS];
    char names[MAX_ROWS][32], words[MAX_ROWS][MAX_TEXT], defaults[MAX_ROWS][MAX_TEXT];
    char conditions[MAX_ROWS][MAX_TEXT];
    size_t count;
} table;

static void flag_name(const char *name, char flag[32])
{
    snprintf(flag, 32, "%s", name);
    key_to_name(flag);
}

static option_kind kind_of(sgs_option_type type)
{
    static const option_kind kinds[] = {
        [SGS_OPTION_BOOL] = OPTION_FLAG,   [SGS_OPTION_INT] = OPTION_INTEGER,
        [SGS_OPTION_SIZE] = OPTION_SIZE,   [SGS_OPTION_UINT64] = OPTION_COUNT,
        [SGS_OPTION_DOUBLE] = OPTION_REAL, [SGS_OPTION_CHOICE] = OPTION_CHOICE,
        [SGS_OPTION_SET] = OPTION_SET,     [SGS_OPTION_COLOR] = OPTION_COLOR,
        [SGS_OPTION_MODEL] = OPTION_TEXT,  [SGS_OPTION_BOX] = OPTION_TEXT};
    return kinds[type];
}

// Appends "name=word|name=word" for the words of `bits`, after '&' if there is text before.
static void add_condition(char text[MAX_TEXT], const char *name, unsigned bits)
{
    const char *words = sgs_train_option_find(name)->values, *joint = *text ? "&" : "";
    for (const char *at = words; *at; ++at) {
        const size_t length = strcspn(at, "|,"), used = strlen(text);
        if (bits & 1) {
            snprintf(text + used, MAX_TEXT - used, "%s%s=%.*s", joint, name, (int)length, at);
            joint = "|";
        }
        bits >>= 1;
        at += length;
        if (!*at)
            break;
    }
}

// True for options of the structural updates, which the schedule finetune does not make. It still
// tests for equilibrium.
static bool is_of_updates(const sgs_train_option *from)
{
    static const char *const names[] = {"taming_multiplier", "taming_count",    "dash_count",
                                        "fastgs_loss",       "fastgs_gradient", "fastgs_dense",
                                        "mcmc_growth",       "taming_opacity"};
    bool is = from->spare && !(from->spare & SGS_SPARE_EDT);
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k)
        is = is || !strcmp(from->name, names[k]);
    return is;
}

// option.needs of a row: the pipelines, parts of SPARE-GS and schedules that read it.
static const char *conditions_of(const sgs_train_option *from, char text[MAX_TEXT])
{
    const unsigned all = (1U << SGS_PIPELINE_COUNT) - 1;
    *text = 0;
    if ((from->pipelines & all) != all)
        add_condition(text, "pipeline", from->pipelines);
    if (from->spare)
        add_condition(text, "spare", from->spare);
    if (is_of_updates(from))
        add_condition(text, "schedule", 1U << SGS_SCHEDULE_SCALED | 1U << SGS_SCHEDULE_PAPER);
    if (!strcmp(from->name, "alpha_loss"))
        snprintf(text, MAX_TEXT, "alpha=over|opaque");
    if (from->type == SGS_OPTION_BOX)
        snprintf(text, MAX_TEXT, "init");
    return *text ? text : NULL;
}

// The library's text "-1 = automatic: 0.2, ..." of a default: the option has the word auto.
static void set_automatic(const sgs_train_option *from, option *row, char text[MAX_TEXT])
{
    static const char mark[] = " = automatic: ";
    const char *at = from->initial_text ? strstr(from->initial_text, mark) : NULL;
    if (!at)
        return;
    row->word = "auto";
    row->of_word = from->initial;
    row->low = row->low < 0 ? 0 : row->low;
    snprintf(text, MAX_TEXT, "auto: %s", at + sizeof mark - 1);
    row->shown = text;
}

static void add_row(const sgs_train_option *from, const sgs_train_options *initial)
{
    const size_t k = table.count++;
    option *row = &table.rows[k];
    const size_t base = offsetof(train_values, options);
    flag_name(from->name, table.names[k]);
    *row = (option){.name = table.names[k],
                    .kind = kind_of(from->type),
                    .offset = base + from->offset,
                    .random_offset = from->random_offset ? base + from->random_offset : 0,
                    .low = from->low,
                    .high = from->high,
                    .argument = from->values,
                    .shown = from->initial_text,
                    .unit = from->unit,
                    .needs = conditions_of(from, table.conditions[k]),
                    .help = from->help};
    if (from->type == SGS_OPTION_MODEL) {
        row->offset = offsetof(train_values, init);
        row->path = PATH_INPUT;
    }
    if (from->type == SGS_OPTION_BOX) {
        row->offset = offsetof(train_values, region);
        row->path = PATH_BLOCK;
    }
    if (from->type == SGS_OPTION_SET && !(from->low > 0)) {
        snprintf(table.words[k], MAX_TEXT, "on|off|%s", from->values);
        row->argument = table.words[k];
    }
    if (!row->shown && from->type != SGS_OPTION_BOOL) {
        sgs_train_option_text(from, initial, table.defaults[k], MAX_TEXT);
        row->shown = table.defaults[k];
    }
    set_automatic(from, row, table.defaults[k]);
    for (size_t i = 0; i < sizeof resolved_defaults / sizeof *resolved_defaults; ++i)
        if (!strcmp(resolved_defaults[i].name, from->name))
            row->shown = resolved_defaults[i].shown;
}

static void describe_resume(const sgs_train_option *rows, size_t count)
{
    char name[32];
    size_t used =
        (size_t)snprintf(resume_help, sizeof resume_help,
                         "continue the run in OUT from its latest checkpoint. An option that "
                         "affects the model and is not given has the value that config.json "
                         "records; of these, only the following may change:");
    const char *comma = "";
    for (size_t i = 0; i < count && used < sizeof resume_help; ++i) {
        static const char *const conditions[] = {
            [SGS_RESUME_FREE] = "",
            [SGS_RESUME_FREE_PAPER] = " (with --schedule paper)",
            [SGS_RESUME_START] = NULL,
            [SGS_RESUME_FREE_WHOLE] = " (not with --region)",
        };
        if (!conditions[rows[i].resume])
            continue;
        flag_name(rows[i].name, name);
        used += (size_t)snprintf(resume_help + used, sizeof resume_help - used, "%s --%s%s", comma,
                                 name, conditions[rows[i].resume]);
        comma = ",";
    }
}

void train_groups(train_values *values, option_group groups[TRAIN_GROUP_COUNT])
{
    *values = (train_values){.options = sgs_train_options_default(), .time_limit = -1};
    table.count = 0;
    size_t count, g = 0;
    const sgs_train_option *rows = sgs_train_option_descriptors(&count);
    describe_resume(rows, count);
    groups[g++] = (option_group){.title = "Output",
                                 .options = output_options,
                                 .count = sizeof output_options / sizeof *output_options,
                                 .values = values};
    for (size_t i = 0; i < count && table.count < MAX_ROWS; ++i) {
        if (!strcmp(rows[i].group, "Common")) // see common_group
            continue;
        if (strcmp(groups[g - 1].title, rows[i].group) && g < TRAIN_GROUP_COUNT)
            groups[g++] = (option_group){
                .title = rows[i].group, .options = table.rows + table.count, .values = values};
        add_row(&rows[i], &values->options);
        ++groups[g - 1].count;
    }
    while (g < TRAIN_GROUP_COUNT)
        groups[g++] = (option_group){.title = "", .values = values};
}

void train_resolve(train_values *values, const command_line *line, uint64_t seed)
{
    values->options.seed = seed;
    if (!option_set(line, "filter"))
        values->options.filter =
            values->options.pipeline == SGS_PIPELINE_MIP ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
    if (values->options.opaque && !option_set(line, "background"))
        values->options.background_random = true;
    if (values->options.opaque && !option_set(line, "alpha-loss"))
        values->options.alpha_loss = SGS_TRAIN_OPAQUE_WEIGHT;
}

// Six numbers, separated by commas.
static bool parse_box(const char *text, sgs_box *box)
{
    for (int k = 0; k < 6; ++k) {
        char *end;
        float *const bound = k < 3 ? &box->low[k] : &box->high[k - 3];
        *bound = strtof(text, &end);
        if (end == text || isnan(*bound) || *end != (k < 5 ? ',' : '\0'))
            return false;
        text = end + 1;
    }
    return true;
}

int train_region_resolve(train_values *values)
{
    const char *text = values->region, *colon = text ? strrchr(text, ':') : NULL;
    if (!text)
        return -1;
    if (!colon) {
        if (!parse_box(text, &values->options.region))
            return fail_usage(
                "--region: '%s' is neither a box X0,Y0,Z0,X1,Y1,Z1 nor PLAN:K, a file "
                "of 'sparegs split' and a block of it",
                text);
        sgs_train_options alone = sgs_train_options_default();
        alone.region = values->options.region;
        return sgs_train_options_check(&alone) ? fail_usage("--region: %s", sgs_last_error()) : -1;
    }
    char *end;
    const unsigned long block = strtoul(colon + 1, &end, 10);
    if (colon == text || end == colon + 1 || *end || colon[1] == '-' || colon[1] == '+' ||
        block > INT_MAX)
        return fail_usage(
            "--region: '%s' is not PLAN:K, a file of 'sparegs split' and the number of "
            "a block, from 0",
            text);
    values->region_plan = format_text("%.*s", (int)(colon - text), text);
    values->region_block = (int)block;
    return -1;
}

// True if --save-at has an iteration that the run does not reach.
static bool is_late(const train_values *values)
{
    for (int i = 0; i < values->save_at.count; ++i)
        if (values->save_at.values[i] > values->options.iterations)
            return true;
    return false;
}

int train_scene_check(const scene_values *scene)
{
    const struct {
        const char *name, *text;
    } options[] = {
        {"images", scene->images}, {"masks", scene->masks}, {"test-images", scene->test_images}};
    for (size_t k = 0; k < sizeof options / sizeof *options; ++k) {
        json_t *text = options[k].text ? json_string(options[k].text) : json_null();
        json_decref(text);
        if (!text)
            return fail_usage("--%s: '%s' is not UTF-8, and config.json cannot record it; rename "
                              "the file or folder",
                              options[k].name, options[k].text);
    }
    return -1;
}

int train_output_check(const train_values *values, const command_line *line)
{
    if (values->resume && values->overwrite)
        return fail_usage("--resume and --overwrite are mutually exclusive; --resume continues the "
                          "run in OUT, --overwrite replaces it");
    if (!values->output)
        return fail_usage("train requires an output folder, -o OUT; usage: sparegs train %s",
                          line->synopsis);
    return values->trace ? refuse_file_of_run("trace", values->trace, values->output) : -1;
}

int train_values_check(const train_values *values, const command_line *line)
{
    const sgs_train_options *o = &values->options;
    if (o->pipeline == SGS_PIPELINE_TAMING &&
        o->pipeline_options.taming_opacity == SGS_TAMING_LINEAR && o->filter == SGS_FILTER_MIP)
        return fail_usage("--taming-opacity linear and --filter mip are mutually exclusive");
    if (o->pipeline == SGS_PIPELINE_TAMING && values->region &&
        o->pipeline_options.taming_opacity == SGS_TAMING_LINEAR)
        return fail_usage("--taming-opacity linear and --region are mutually exclusive");
    if (o->opaque && !(o->alpha_loss > 0))
        return fail_usage("--opaque requires --alpha-loss above 0");
    if (option_given(line, "save-at") && is_late(values))
        return fail_usage("--save-at: the run ends at iteration %d; choose earlier iterations, or "
                          "raise --iterations",
                          o->iterations);
    if (o->ssim_weight == 0.0 && refuse_idle(line, "ssim-sigma", "with --ssim-weight 0") >= 0)
        return EXIT_USAGE;
    if (values->init &&
        refuse_idle(line, "random-points|mcmc-start-opacity|mcmc-start-scale", "with --init") >= 0)
        return EXIT_USAGE;
    if (o->pipeline_options.taming_count)
        return refuse_idle(line, "taming-multiplier", "with --taming-count");
    return -1;
}

void train_warn_idle(const train_values *values, const command_line *line)
{
    const sgs_train_options *o = &values->options;
    if (o->spare_phi == SGS_PHI_PRODUCT || o->spare_phi == SGS_PHI_PLAIN)
        warn_idle(line, "spare-range", "with --spare-phi product or plain");
    if (!(o->spare_demand & SGS_DEMAND_C))
        warn_idle(line, "spare-capacity-min|spare-capacity-max", "on a --spare-demand without c");
    if (o->schedule == SGS_SCHEDULE_FINETUNE && o->spare && !(o->spare & SGS_SPARE_EDT))
        warn_idle(line, "spare", "with --schedule finetune unless it contains edt");
    if (o->schedule == SGS_SCHEDULE_FINETUNE && !values->init)
        print_warning("--schedule finetune is for a trained model: without --init, no primitives "
                      "are added to the point cloud, and its points barely move");
}
