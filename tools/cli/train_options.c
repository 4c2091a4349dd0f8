// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The options of `sparegs train`. config.json is written from the struct that configures the
// trainer, so a run can be repeated from it. Every key under "options" is a long option with '_' in
// place of '-'.

#include "cli/train_options.h"

#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "sparegs/runtime.h"

#define PIPELINES "3dgs|mip|taming|dash|fastgs"
#define TAMING_OPACITIES "trained|frozen|linear"
#define FILTERS "3dgs|none|mip"
#define PHIS "coupled|constant|product|plain"
#define TARGETS "default|gradient|importance|both"
enum { FILTER_OF_PIPELINE = -1 };
#define AT(member) offsetof(train_values, member)

static const option output_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_TEXT,
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
     .help = "iterations between checkpoints of the full state; the last two are kept"},
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
    {.name = "resume",
     .kind = OPTION_FLAG,
     .offset = AT(resume),
     .help = "continue the run in OUT from its latest checkpoint with the same options; only "
             "--max-gaussians, --spare-eps-loss, --spare-eps-count, --spare-patience and, with "
             "--schedule paper, --iterations may change"},
    {.name = "trace",
     .kind = OPTION_TEXT,
     .offset = AT(trace),
     .argument = "FILE",
     .shown = "none",
     .help = "write the phases of each iteration as a Chrome/Perfetto trace (about 1 KB per "
             "iteration)"},
};

static const option training_options[] = {
    {.name = "iterations",
     .kind = OPTION_INTEGER,
     .offset = AT(iterations),
     .low = 1,
     .high = 1e7,
     .argument = "N",
     .initial = "30000",
     .help = "number of iterations"},
    {.name = "schedule",
     .kind = OPTION_CHOICE,
     .offset = AT(schedule),
     .argument = "scaled|paper",
     .initial = "scaled",
     .help = "scaled: the 30000-iteration schedule scaled to N iterations; paper: the unscaled "
             "schedule, stopped at N"},
    {.name = "pipeline",
     .kind = OPTION_CHOICE,
     .offset = AT(pipeline),
     .argument = PIPELINES,
     .initial = "3dgs",
     .help = "base pipeline: 3DGS, Mip-Splatting, Taming 3DGS, DashGaussian, FastGS"},
    {.name = "filter",
     .kind = OPTION_CHOICE,
     .offset = AT(filter),
     .argument = FILTERS,
     .shown = "the pipeline's filter",
     .help = "pixel filter: 0.3 px^2 dilation (3DGS), none, or Mip-Splatting's filters"},
    {.name = "optimizer",
     .kind = OPTION_CHOICE,
     .offset = AT(optimizer),
     .argument = "sparse|dense",
     .initial = "sparse",
     .help = "Adam over the primitives visible in the iteration, or over all primitives"},
    {.name = "sh-degree",
     .kind = OPTION_INTEGER,
     .offset = AT(sh_degree),
     .low = 0,
     .high = 3,
     .argument = "D",
     .initial = "3",
     .help = "maximum degree of the spherical harmonics"},
    {.name = "compact-box",
     .kind = OPTION_REAL,
     .offset = AT(compact_box),
     .low = 1e-3,
     .high = 1,
     .argument = "X",
     .initial = "1",
     .help = "fraction of a primitive's support used to assign it to tiles; 1 is exact, FastGS "
             "uses 0.5"},
    {.name = "background",
     .kind = OPTION_COLOR,
     .offset = AT(background),
     .argument = "R,G,B|random",
     .initial = "0,0,0",
     .shown = "0,0,0, or 1,1,1 for NeRF synthetic scenes with --alpha over",
     .help = "background colour, display values from 0 to 1, or a random colour in each iteration"},
    {.name = "max-gaussians",
     .kind = OPTION_COUNT,
     .offset = AT(max_gaussians),
     .low = 0,
     .high = 2147483647,
     .argument = "N",
     .initial = "0",
     .shown = "0 = none",
     .help = "maximum number of primitives, also of the initial cloud"},
    {.name = "init",
     .kind = OPTION_TEXT,
     .offset = AT(init),
     .argument = "MODEL",
     .shown = "none",
     .help =
         "initialise from this 3DGS model (a PLY file or run folder) instead of the point cloud"},
    {.name = "alpha-loss",
     .kind = OPTION_REAL,
     .offset = AT(alpha_loss),
     .low = 0,
     .high = 1000,
     .argument = "W",
     .initial = "0",
     .shown = "0 = none",
     .help =
         "weight of the mean absolute difference between rendered opacity and the images' alpha"},
    {.name = "exposure",
     .kind = OPTION_FLAG,
     .offset = AT(exposure),
     .help = "compensate exposure and white balance: optimise a 3 x 4 colour transform per image, "
             "saved in exposure.json"},
    {.name = "random-points",
     .kind = OPTION_COUNT,
     .offset = AT(random_points),
     .low = 1,
     .high = 100000000,
     .argument = "N",
     .initial = "100000",
     .help = "size of the random initial cloud for a scene without points"},
};

static const option pipeline_options[] = {
    {.name = "taming-multiplier",
     .kind = OPTION_REAL,
     .offset = AT(taming_multiplier),
     .low = 1e-3,
     .high = 1e6,
     .argument = "X",
     .initial = "20",
     .help = "Taming: final number of primitives, as a multiple of the initial number"},
    {.name = "taming-count",
     .kind = OPTION_COUNT,
     .offset = AT(taming_count),
     .low = 0,
     .high = 2147483647,
     .argument = "N",
     .initial = "0",
     .shown = "0 = from --taming-multiplier",
     .help = "Taming: final number of primitives"},
    {.name = "taming-opacity",
     .kind = OPTION_CHOICE,
     .offset = AT(taming_opacity),
     .argument = TAMING_OPACITIES,
     .initial = "frozen",
     .help = "Taming: opacities after densification: trained, frozen as in the released code, or "
             "linear as in the paper, where they may exceed 1 (not with --filter mip; saved "
             "opacities are limited to 0.999999)"},
    {.name = "dash-count",
     .kind = OPTION_COUNT,
     .offset = AT(dash_count),
     .low = 0,
     .high = 2147483647,
     .argument = "N",
     .initial = "0",
     .shown = "0 = momentum-based",
     .help = "Dash: final number of primitives"},
    {.name = "fastgs-loss",
     .kind = OPTION_REAL,
     .offset = AT(fastgs_loss),
     .low = 0,
     .high = 1,
     .argument = "X",
     .initial = "0.1",
     .help = "FastGS: normalised per-view error above which a pixel counts as high-error"},
    {.name = "fastgs-gradient",
     .kind = OPTION_REAL,
     .offset = AT(fastgs_gradient),
     .low = 1e-9,
     .high = 1,
     .argument = "X",
     .initial = "0.0012",
     .help = "FastGS: absolute-gradient threshold for splitting"},
    {.name = "fastgs-dense",
     .kind = OPTION_REAL,
     .offset = AT(fastgs_dense),
     .low = 1e-9,
     .high = 1,
     .argument = "X",
     .initial = "0.001",
     .unit = "x scene extent",
     .help = "FastGS: size above which a primitive is split, not cloned"},
};

static const option spare_options[] = {
    {.name = "spare",
     .kind = OPTION_SET,
     .offset = AT(spare),
     .argument = "on|off|bmd,rap,edt",
     .initial = "on",
     .help = "SPARE-GS, or some of its parts: budget-modulated densification (bmd), "
             "redundancy-aware pruning (rap), equilibrium-driven termination (edt)"},
    {.name = "spare-grid",
     .kind = OPTION_INTEGER,
     .offset = AT(spare_grid),
     .low = 2,
     .high = 256,
     .argument = "N",
     .initial = "32",
     .unit = "voxels per axis",
     .help = "resolution of the region grid"},
    {.name = "spare-tau-alpha",
     .kind = OPTION_REAL,
     .offset = AT(spare_tau_alpha),
     .low = 0,
     .high = 1,
     .argument = "X",
     .initial = "0.05",
     .help = "opacity threshold for redundant primitives"},
    {.name = "spare-eps-loss",
     .kind = OPTION_REAL,
     .offset = AT(spare_eps_loss),
     .low = 0,
     .high = 1,
     .argument = "X",
     .initial = "0.008",
     .help = "equilibrium threshold for the relative change of the loss"},
    {.name = "spare-eps-count",
     .kind = OPTION_REAL,
     .offset = AT(spare_eps_count),
     .low = 0,
     .high = 1,
     .argument = "X",
     .initial = "0.01",
     .help = "equilibrium threshold for the relative change x number of primitives"},
    {.name = "spare-patience",
     .kind = OPTION_INTEGER,
     .offset = AT(spare_patience),
     .low = 1,
     .high = 1000,
     .argument = "N",
     .initial = "2",
     .unit = "checks",
     .help = "consecutive checks in equilibrium before training stops"},
    {.name = "spare-interval",
     .kind = OPTION_INTEGER,
     .offset = AT(spare_interval),
     .low = 1,
     .high = 1e9,
     .argument = "N",
     .initial = "1000",
     .unit = "iterations",
     .help = "iterations between equilibrium checks, in the 30000-iteration schedule"},
    {.name = "spare-demand",
     .kind = OPTION_SET,
     .offset = AT(spare_demand),
     .argument = "h,v,c",
     .initial = "h,v,c",
     .help = "terms of the regional demand: gradient (h), visibility (v), capacity (c)"},
    {.name = "spare-phi",
     .kind = OPTION_CHOICE,
     .offset = AT(spare_phi),
     .argument = PHIS,
     .initial = "coupled",
     .help = "how slack and demand form the densification weight: coupled, constant range, "
             "product, or slack only"},
    {.name = "spare-budget",
     .kind = OPTION_REAL,
     .offset = AT(spare_budget),
     .low = 0.01,
     .high = 100,
     .argument = "X",
     .initial = "1",
     .unit = "x number of primitives",
     .help = "total budget of the regions"},
    {.name = "spare-target",
     .kind = OPTION_CHOICE,
     .offset = AT(spare_target),
     .argument = TARGETS,
     .initial = "default",
     .shown = "default (both for taming, gradient for fastgs)",
     .help = "score modulated by the weight, for pipelines with two scores"},
};

void train_groups(train_values *values, option_group groups[TRAIN_GROUP_COUNT])
{
    *values = (train_values){.filter = FILTER_OF_PIPELINE};
    groups[0] = (option_group){.title = "Output",
                               .options = output_options,
                               .count = sizeof output_options / sizeof *output_options,
                               .values = values};
    groups[1] = (option_group){.title = "Training",
                               .options = training_options,
                               .count = sizeof training_options / sizeof *training_options,
                               .values = values};
    groups[2] = (option_group){.title = "Base pipelines",
                               .options = pipeline_options,
                               .count = sizeof pipeline_options / sizeof *pipeline_options,
                               .values = values};
    groups[3] = (option_group){.title = "SPARE-GS",
                               .options = spare_options,
                               .count = sizeof spare_options / sizeof *spare_options,
                               .values = values};
}

void train_resolve(train_values *values)
{
    if (values->filter == FILTER_OF_PIPELINE)
        values->filter = values->pipeline == SGS_PIPELINE_MIP ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
}

sgs_train_options train_library_options(const train_values *values, uint64_t seed)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = values->iterations;
    options.schedule = (sgs_schedule)values->schedule;
    options.pipeline = (sgs_pipeline)values->pipeline;
    options.filter = (sgs_filter)values->filter;
    options.optimizer = (sgs_optimizer)values->optimizer;
    options.sh_degree = values->sh_degree;
    options.compact_box = values->compact_box;
    memcpy(options.background, values->background.rgb, sizeof options.background);
    options.background_random = values->background.random;
    options.max_gaussians = (size_t)values->max_gaussians;
    options.seed = seed;
    options.spare = values->spare;
    options.spare_grid = values->spare_grid;
    options.spare_tau_alpha = values->spare_tau_alpha;
    options.spare_eps_loss = values->spare_eps_loss;
    options.spare_eps_count = values->spare_eps_count;
    options.spare_patience = values->spare_patience;
    options.spare_interval = values->spare_interval;
    options.spare_demand = values->spare_demand;
    options.alpha_loss = values->alpha_loss;
    options.exposure = values->exposure;
    options.spare_phi = (sgs_phi)values->spare_phi;
    options.spare_budget = values->spare_budget;
    options.spare_target = (sgs_spare_target)values->spare_target;
    options.pipeline_options =
        (sgs_pipeline_options){.taming_multiplier = values->taming_multiplier,
                               .taming_count = (size_t)values->taming_count,
                               .taming_opacity = (sgs_taming_opacity)values->taming_opacity,
                               .dash_count = (size_t)values->dash_count,
                               .fastgs_loss = values->fastgs_loss,
                               .fastgs_gradient = values->fastgs_gradient,
                               .fastgs_dense = values->fastgs_dense};
    options.random_points = (size_t)values->random_points;
    return options;
}

static void set_word(json_t *object, const char *key, const char *words, int index)
{
    const char *at = words;
    for (const char *bar; index > 0 && (bar = strchr(at, '|')); --index)
        at = bar + 1;
    json_object_set_new(object, key, json_stringn(at, strcspn(at, "|")));
}

static void set_text(json_t *object, const char *key, const char *text)
{
    json_object_set_new(object, key, text ? json_string(text) : json_null());
}

static void set_bits(json_t *object, const char *key, unsigned bits, const char *const names[3])
{
    json_t *list = json_array();
    for (int k = 0; k < 3; ++k)
        if (bits >> k & 1)
            json_array_append_new(list, json_string(names[k]));
    json_object_set_new(object, key, list);
}

static void set_integer(json_t *object, const char *key, uint64_t value)
{
    json_object_set_new(object, key, json_integer((json_int_t)value));
}

// 0 means that the option was not given.
static void set_given(json_t *object, const char *key, int value)
{
    json_object_set_new(object, key, value ? json_integer(value) : json_null());
}

// The options that affect the result; a resumed run must use the same.
static json_t *shaping_options(const train_values *values, const scene_values *scene, uint64_t seed)
{
    static const char *const spare_names[3] = {"bmd", "rap", "edt"}, *const demand_names[3] = {
                                                                         "h", "v", "c"};
    json_t *options = json_object();
    set_text(options, "images", scene->images ? scene->images : "images");
    set_given(options, "downscale", scene->downscale);
    set_given(options, "test_every", scene->test_every);
    set_text(options, "test_images", scene->test_images);
    set_text(options, "masks", scene->masks);
    json_object_set_new(options, "invert_masks", json_boolean(scene->invert_masks));
    set_word(options, "alpha", ALPHA_WORDS, scene->alpha);
    set_text(options, "input_colorspace", scene->colorspace);
    set_word(options, "train_space", SPACE_WORDS, scene->space);
    json_object_set_new(options, "white", json_real(scene->white_point));
    set_integer(options, "iterations", (uint64_t)values->iterations);
    set_word(options, "schedule", "scaled|paper", values->schedule);
    set_word(options, "pipeline", PIPELINES, values->pipeline);
    set_word(options, "filter", FILTERS, values->filter);
    json_object_set_new(options, "compact_box", json_real(values->compact_box));
    set_word(options, "optimizer", "sparse|dense", values->optimizer);
    set_integer(options, "sh_degree", (uint64_t)values->sh_degree);
    if (values->background.random) {
        set_text(options, "background", "random");
    } else {
        json_t *list = json_array();
        for (int c = 0; c < 3; ++c)
            json_array_append_new(list, json_real((double)values->background.rgb[c]));
        json_object_set_new(options, "background", list);
    }
    set_integer(options, "max_gaussians", values->max_gaussians);
    set_text(options, "init", values->init);
    set_integer(options, "random_points", values->random_points);
    json_object_set_new(options, "alpha_loss", json_real(values->alpha_loss));
    json_object_set_new(options, "exposure", json_boolean(values->exposure));
    set_bits(options, "spare", values->spare, spare_names);
    set_integer(options, "spare_grid", (uint64_t)values->spare_grid);
    json_object_set_new(options, "spare_tau_alpha", json_real(values->spare_tau_alpha));
    json_object_set_new(options, "spare_eps_loss", json_real(values->spare_eps_loss));
    json_object_set_new(options, "spare_eps_count", json_real(values->spare_eps_count));
    set_integer(options, "spare_patience", (uint64_t)values->spare_patience);
    set_integer(options, "spare_interval", (uint64_t)values->spare_interval);
    set_bits(options, "spare_demand", values->spare_demand, demand_names);
    set_word(options, "spare_phi", PHIS, values->spare_phi);
    json_object_set_new(options, "spare_budget", json_real(values->spare_budget));
    set_word(options, "spare_target", TARGETS, values->spare_target);
    json_object_set_new(options, "taming_multiplier", json_real(values->taming_multiplier));
    set_integer(options, "taming_count", values->taming_count);
    set_word(options, "taming_opacity", TAMING_OPACITIES, values->taming_opacity);
    set_integer(options, "dash_count", values->dash_count);
    json_object_set_new(options, "fastgs_loss", json_real(values->fastgs_loss));
    json_object_set_new(options, "fastgs_gradient", json_real(values->fastgs_gradient));
    json_object_set_new(options, "fastgs_dense", json_real(values->fastgs_dense));
    set_integer(options, "seed", seed);
    return options;
}

json_t *train_config(const char *scene_path, const train_values *values, const scene_values *scene,
                     const common_values *common)
{
    json_t *config = json_object(), *save_at = json_array();
    for (int i = 0; i < values->save_at.count; ++i)
        json_array_append_new(save_at, json_integer(values->save_at.values[i]));
    set_text(config, "version", sgs_version());
    set_text(config, "commit", sgs_version_commit());
    set_text(config, "libraries", sgs_version_libraries());
    set_text(config, "isa", sgs_isa_name(sgs_isa_get()));
    set_integer(config, "threads", (uint64_t)sgs_threads_get());
    set_text(config, "scene", scene_path);
    set_integer(config, "seed", common->seed);
    json_object_set_new(config, "options", shaping_options(values, scene, common->seed));
    json_object_set_new(config, "save_at", save_at);
    set_integer(config, "checkpoint_every", (uint64_t)values->checkpoint_every);
    return config;
}

// True if equal at the precision of the file.
static bool same_value(const json_t *a, const json_t *b)
{
    if (json_is_array(a) && json_is_array(b) && json_array_size(a) == json_array_size(b)) {
        for (size_t i = 0; i < json_array_size(a); ++i)
            if (!same_value(json_array_get(a, i), json_array_get(b, i)))
                return false;
        return true;
    }
    if (json_is_real(a) && json_is_number(b)) {
        char x[32], y[32];
        snprintf(x, sizeof x, "%.9g", json_number_value(a));
        snprintf(y, sizeof y, "%.9g", json_number_value(b));
        return !strcmp(x, y);
    }
    return json_equal(a, b);
}

// Options that may change when a run is resumed (the library warns about the change).
static bool may_change(const char *key, const json_t *now)
{
    static const char *const keys[] = {"max_gaussians", "spare_eps_loss", "spare_eps_count",
                                       "spare_patience"};
    for (size_t i = 0; i < sizeof keys / sizeof *keys; ++i)
        if (!strcmp(keys[i], key))
            return true;
    const char *schedule = json_string_value(config_option(now, "schedule"));
    return !strcmp(key, "iterations") && schedule && !strcmp(schedule, "paper");
}

// A value as written on the command line.
static char *option_text(const json_t *value)
{
    if (json_is_null(value))
        return format_text("not given");
    if (json_is_string(value))
        return format_text("%s", json_string_value(value));
    if (!json_is_array(value)) {
        char *text = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(9));
        return text ? text : format_text("?");
    }
    char *list = format_text("%s", json_array_size(value) ? "" : "off");
    for (size_t i = 0; i < json_array_size(value); ++i) {
        char *word = option_text(json_array_get(value, i));
        char *longer = format_text("%s%s%s", list, i ? "," : "", word);
        free(word);
        free(list);
        list = longer;
    }
    return list;
}

bool train_config_agrees(const char *config_path, const json_t *stored, const json_t *now)
{
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(now, "options"), key, value)
    {
        const json_t *old = config_option(stored, key);
        if (same_value(value, old) || (old && may_change(key, now)))
            continue;
        char name[64];
        snprintf(name, sizeof name, "%s", key);
        for (char *dash = name; (dash = strchr(dash, '_'));)
            *dash = '-';
        char *was = old ? option_text(old) : format_text("not recorded");
        char *is = option_text(value);
        fail_run("%s: --%s was %s when the run started and is %s now; resume with the same "
                 "options, or train into another folder",
                 config_path, name, was, is);
        free(was);
        free(is);
        return false;
    }
    return true;
}

void train_config_record(const json_t *stored, json_t *now, int iteration)
{
    json_t *list = json_deep_copy(json_object_get(stored, "resumed")), *entry = json_object(),
           *changed = json_object();
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(now, "options"), key, value)
    {
        json_t *old = config_option(stored, key);
        if (!same_value(value, old))
            json_object_set(changed, key, old);
    }
    json_object_set_new(entry, "iteration", json_integer(iteration));
    json_object_set_new(entry, "changed_from", changed);
    if (!json_is_array(list)) {
        json_decref(list);
        list = json_array();
    }
    json_array_append_new(list, entry);
    json_object_set_new(now, "resumed", list);
}
