// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options shared by several commands, and their effects: threads and instruction set; the data
// set and its split; how a stored model is rendered.

#include <jansson.h>

#include "arguments/recorded_options.h"
#include "options/options.h"
#include "sparegs/render.h"
#include "sparegs/scene.h"

typedef struct common_values {
    int threads, isa;
    uint64_t seed;
    bool quiet, json;
} common_values;

// The help has those of them that the command reads.
option_group common_group(common_values *values, const char *command);
// Sets threads, instruction set and verbosity. Warns about options that the command does not read.
// Returns -1 to continue, or an exit status.
int common_apply(const common_values *values, const command_line *line);

typedef struct scene_values {
    const char *images, *test_images, *masks, *colorspace;
    int downscale, test_every, alpha, space; // sgs_alpha, sgs_space
    double white_point;                      // 0 = measured
    uint64_t cache_bytes;                    // for decoded images; 0 = no limit
    uint64_t decode_bytes;                   // for images that are decoded at the same time
    bool eval, invert_masks;
    // From scene_resolve, borrowed from the config: the names that the run held out, or NULL. Used
    // unless the command line defines a split.
    const json_t *held_out;
    const json_t *kept;     // names of the views to load, borrowed; NULL = all
    bool use_dataset_split; // --eval, or no run and no option: the test views of the data set
    bool measure_white;     // also if scene_open does not load the images
    bool headers_only;      // scene_open without images does not look for truncated files
    // From scene_resolve, borrowed: the command, whose outputs must not replace files of the scene.
    const command_line *line;
} scene_values;

option_group scene_group(scene_values *values);
// Resolves --eval and rejects mutually exclusive options. With a run's config (or NULL), options
// not given on the command line take the recorded values. The strings stay owned by argv and
// config. Returns -1 to continue, or an exit status.
int scene_resolve(scene_values *values, const command_line *line, const json_t *config);
// The memory for images: that of --image-cache, or its default, and that for decoding. They are
// shares of the memory of the machine divided by its ranks, or of `limit` if that is less and not
// 0. scene_resolve calls it without a limit.
void scene_share_memory(scene_values *values, const command_line *line, uint64_t limit);
// The rows of --lpips and --lpips-input for a struct with the members `lpips` (const char *) and
// `lpips_input` (int, sgs_lpips_input).
#define LPIPS_INPUT_WORDS "unit|signed"
#define LPIPS_OPTIONS(values)                                                                      \
    {.name = "lpips",                                                                              \
     .kind = OPTION_TEXT,                                                                          \
     .path = PATH_INPUT,                                                                           \
     .offset = offsetof(values, lpips),                                                            \
     .argument = "FILE",                                                                           \
     .shown = "none",                                                                              \
     .help = "also compute LPIPS, with weights converted by tools/scripts/lpips_weights.py"},      \
    {                                                                                              \
        .name = "lpips-input", .kind = OPTION_CHOICE, .offset = offsetof(values, lpips_input),     \
        .argument = LPIPS_INPUT_WORDS, .initial = "unit", .needs = "lpips",                        \
        .help = "input range of the LPIPS network: [0, 1] as in 3DGS, or [-1, 1] as in its "       \
                "paper"                                                                            \
    }
// The row of --run for a struct with the member `run` (const char *), for model_locate_of_run.
#define RUN_OPTION(values)                                                                         \
    {                                                                                              \
        .name = "run", .kind = OPTION_FOLDER, .offset = offsetof(values, run), .argument = "OUT",  \
        .shown = "MODEL, if it is a run folder or one of its iterations",                          \
        .help =                                                                                    \
            "take image folder, size, split, filter and background from this run, for a model "    \
            "derived from it"                                                                      \
    }
// Loads the scene; NULL after printing the error, or when a signal ended the loading
// (interrupt_was_cancelled). An output of the command that would replace a file of the scene is an
// error.
sgs_scene *scene_open(const char *path, const scene_values *values, bool load_images);
// The same without images, and without an error if there are no photos. width, height: size of
// views for which neither camera file nor photo gives one, or 0.
sgs_scene *scene_open_cameras(const char *path, const scene_values *values, int width, int height);
// Warns about options that have no effect on a scene whose images are loaded.
void scene_warn_idle(const sgs_scene *scene, const scene_values *values, const command_line *line);
// False after printing the error if a view has a name that JSON cannot hold; `where`: what would
// have to contain it.
bool scene_names_are_text(const sgs_scene *scene, const char *where);
// Number of views in a split.
size_t scene_split_count(const sgs_scene *scene, sgs_split split);
bool view_in_split(const sgs_view *view, sgs_split split);

typedef struct drawing_values {
    int filter;           // sgs_filter
    bool filter_selected; // by the command line or a run's config
    double compact_box;
    float background[3];
    sgs_space space;      // of the model's colours
    double white_point;   // linear light that is 1 in them
    double near_distance; // world units
    bool near_selected;   // by the command line, a run's config or the scene
} drawing_values;

option_group drawing_group(drawing_values *values);
// Options not given on the command line come from the run's config, then from the scene. `data` is
// resolved before: the space of the colours is that of the data set. scene may be NULL.
void drawing_resolve(drawing_values *values, const command_line *line, const json_t *config,
                     const scene_values *data, const sgs_scene *scene);
// The render options that correspond to the values.
sgs_render_options drawing_render_options(const drawing_values *values);

// A command: its own options, the shared groups that it takes, and the common options.
typedef struct command_spec {
    const char *name, *synopsis, *description; // "eval", "MODEL SCENE [options]", paragraphs
    int operand_minimum, operand_maximum;
    const char *title; // of the command's options
    const option *options;
    size_t option_count;
    void *values;            // of the command's options
    scene_values *scene;     // NULL: no such options
    drawing_values *drawing; // likewise
} command_spec;

enum { COMMAND_GROUPS = 4 };

typedef struct command_call {
    common_values common;
    option_group groups[COMMAND_GROUPS];
    command_line line;
} command_call;

// Parses argv into the values of the groups. `call` must not move afterwards. Returns -1 to
// continue, or an exit status.
int command_parse(const command_spec *spec, int argc, char **argv, command_call *call);
// Parses as command_parse and applies the common options.
int command_begin(const command_spec *spec, int argc, char **argv, command_call *call);
