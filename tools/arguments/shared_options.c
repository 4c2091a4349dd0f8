// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Option tables shared by the commands. A value comes from the command line, else from the
// config.json of the run that trained the model, else from the convention of the data set.

#include "arguments/shared_options.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "arguments/model_path.h"
#include "arguments/scene_files.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"
#include "sparegs/runtime.h"

static const option common_options[] = {
    {.name = "threads",
     .kind = OPTION_INTEGER,
     .offset = offsetof(common_values, threads),
     .low = 0,
     .high = 4096,
     .argument = "N",
     .initial = "0",
     .shown = "0 = all cores available to the process",
     .help = "number of threads; results do not depend on it"},
    {.name = "isa",
     .kind = OPTION_CHOICE,
     .offset = offsetof(common_values, isa),
     .argument = "baseline|avx2|avx512",
     .shown = "the best that the CPU supports",
     .help = "instruction set of the kernels"},
    {.name = "seed",
     .kind = OPTION_COUNT,
     .offset = offsetof(common_values, seed),
     .low = 0,
     .high = 9007199254740991.0,
     .argument = "N",
     .initial = "0",
     .help = "random seed"},
    {.name = "json",
     .kind = OPTION_FLAG,
     .offset = offsetof(common_values, json),
     .help = "print the result as one JSON object on stdout"},
    {.name = "quiet",
     .kind = OPTION_FLAG,
     .offset = offsetof(common_values, quiet),
     .help = "suppress progress and notes"},
};

// The common options that a command does not read: "a|b|c", or NULL.
static const char *unread_options(const char *command)
{
    static const struct {
        const char *command, *unread;
    } rows[] = {{"train", NULL}, {"compress", NULL},         {"profile", NULL},
                {"prune", NULL}, {"bd", "seed|threads|isa"}, {"explain", "seed|threads|isa"}};
    for (size_t k = 0; k < sizeof rows / sizeof *rows; ++k)
        if (!strcmp(rows[k].command, command))
            return rows[k].unread;
    return "seed";
}

option_group common_group(common_values *values, const char *command)
{
    *values = (common_values){.isa = -1};
    return (option_group){.title = "Common options",
                          .options = common_options,
                          .count = sizeof common_options / sizeof *common_options,
                          .values = values,
                          .unread = unread_options(command)};
}

int common_apply(const common_values *values, const command_line *line)
{
    const char *unread = unread_options(line->command);
    char *why = format_text("on %s", line->command);
    if (unread)
        warn_idle(line, unread, why);
    free(why);
    if (!strcmp(line->command, "prune") && !option_given(line, "finetune"))
        warn_idle(line, "seed", "without --finetune");
    messages_set_quiet(values->quiet);
    sgs_threads_set(values->threads);
    group_check_binding();
    if (option_given(line, "isa") && sgs_isa_set((sgs_isa)values->isa))
        return fail_run("%s; omit --isa", sgs_last_error());
    return -1;
}

static const option scene_options[] = {
    {.name = "images",
     .kind = OPTION_FOLDER,
     .offset = offsetof(scene_values, images),
     .argument = "DIR",
     .shown = "images",
     .help = "image folder, next to the sparse model; for transforms.json, it replaces the "
             "first component of the image paths"},
    {.name = "downscale",
     .kind = OPTION_INTEGER,
     .offset = offsetof(scene_values, downscale),
     .low = 1,
     .high = 64,
     .argument = "K",
     .shown = "1; images wider than 1600 px are reduced to 1600 px",
     .help = "divide width and height by K (area average)"},
    {.name = "eval",
     .kind = OPTION_FLAG,
     .offset = offsetof(scene_values, eval),
     .help = "hold out the data set's own test split, or every 8th image if it has none (same as "
             "--test-every 8)"},
    {.name = "test-every",
     .kind = OPTION_INTEGER,
     .offset = offsetof(scene_values, test_every),
     .low = 2,
     .high = 1000000,
     .argument = "N",
     .shown = "none",
     .unit = "images",
     .help = "hold out every Nth image, sorted by name, starting with the first; without effect "
             "on a data set with its own test split"},
    {.name = "test-images",
     .kind = OPTION_TEXT,
     .offset = offsetof(scene_values, test_images),
     .argument = "A,B,...",
     .shown = "none",
     .help = "hold out the images with these names"},
    {.name = "masks",
     .kind = OPTION_FOLDER,
     .offset = offsetof(scene_values, masks),
     .argument = "DIR|none",
     .shown = "masks or mask, if it exists",
     .help = "folder with masks, next to the image folder: STEM.png, NAME.png or STEM_mask.png; "
             "white pixels are used, black pixels are ignored"},
    {.name = "invert-masks",
     .kind = OPTION_FLAG,
     .offset = offsetof(scene_values, invert_masks),
     .help = "black pixels are used, white pixels are ignored"},
    {.name = "alpha",
     .kind = OPTION_CHOICE,
     .offset = offsetof(scene_values, alpha),
     .argument = ALPHA_WORDS,
     .initial = "over",
     .help = "alpha channel: composite the image over the background, use alpha as a mask, or "
             "ignore it"},
    {.name = "image-cache",
     .kind = OPTION_BYTES,
     .offset = offsetof(scene_values, cache_bytes),
     .low = 0,
     .high = 1e18,
     .argument = "SIZE",
     .shown = "a quarter of the memory, at least 4 GiB, at most half of it; 0 = no limit",
     .unit = "bytes, KiB, MiB, GiB",
     .help =
         "memory for decoded images; beyond it, images are evicted and decoded again on demand"},
    {.name = "input-colorspace",
     .kind = OPTION_TEXT,
     .offset = offsetof(scene_values, colorspace),
     .argument = "NAME",
     .shown = "from the files' metadata",
     .help = "colour space of the images: linear, sRGB, an ID such as lin_ap1_scene, "
             "or a name known to OpenImageIO or $OCIO"},
    {.name = "train-space",
     .kind = OPTION_CHOICE,
     .offset = offsetof(scene_values, space),
     .argument = SPACE_WORDS,
     .initial = "srgb",
     .help = "colour space of the model and the loss: display-encoded (sRGB) or scene-linear; for "
             "a stored model, the recorded one by default"},
    {.name = "white",
     .kind = OPTION_REAL,
     .offset = offsetof(scene_values, white_point),
     .low = 0,
     .high = 1e30,
     .argument = "X",
     .initial = "0",
     .shown = "the 99th percentile of scene-linear images",
     .help = "white level: the scene-linear value that maps to 1 in the model"},
};

option_group scene_group(scene_values *values)
{
    *values = (scene_values){0};
    return (option_group){.title = "Data set",
                          .options = scene_options,
                          .count = sizeof scene_options / sizeof *scene_options,
                          .values = values};
}

// The index in `words` of a recorded option; `fallback` if it was not recorded.
static int recorded_word(const json_t *config, const char *key, const char *words, int fallback)
{
    const int index = find_word(words, json_string_value(config_option(config, key)));
    return index >= 0 ? index : fallback;
}

void scene_share_memory(scene_values *values, const command_line *line, uint64_t limit)
{
    const uint64_t known = sgs_machine_memory(), least = UINT64_C(4) << 30,
                   machine =
                       (known < UINT64_MAX ? known : 4 * least) / (uint64_t)group_machine_ranks(),
                   memory = limit && limit < machine ? limit : machine,
                   wanted = memory / 4 > least ? memory / 4 : least;
    values->decode_bytes = memory / 8;
    if (!option_given(line, "image-cache"))
        values->cache_bytes = wanted < memory / 2 ? wanted : memory / 2;
}

int scene_resolve(scene_values *values, const command_line *line, const json_t *config)
{
    scene_share_memory(values, line, 0);
    const int splits = option_given(line, "eval") + option_given(line, "test-every") +
                       option_given(line, "test-images");
    values->line = line;
    if (splits > 1)
        return fail_usage(
            "--eval, --test-every and --test-images are mutually exclusive; choose one");
    if (values->test_images && !values->test_images[strspn(values->test_images, ",")])
        return fail_usage("--test-images: '%s' contains no name", values->test_images);
    if (option_given(line, "image-cache") && values->cache_bytes && values->cache_bytes < 1 << 20)
        print_warning(
            "--image-cache is %llu bytes, less than 1 MiB; append a unit, for example 4GiB",
            (unsigned long long)values->cache_bytes);
    if (values->masks && !strcmp(values->masks, "none") && option_given(line, "invert-masks"))
        return refuse_idle(line, "invert-masks", "with --masks none");
    if (values->eval)
        values->test_every = 8;
    values->use_dataset_split = values->eval;
    if (!splits) {
        values->test_every = (int)json_integer_value(config_option(config, "test_every"));
        values->test_images = json_string_value(config_option(config, "test_images"));
        values->held_out = json_object_get(config, "test_images");
        values->use_dataset_split = values->test_every > 0; // may be the record of --eval
    }
    if (!option_given(line, "images"))
        values->images = json_string_value(config_option(config, "images"));
    if (!option_given(line, "masks"))
        values->masks = json_string_value(config_option(config, "masks"));
    if (!option_given(line, "invert-masks"))
        values->invert_masks = json_is_true(config_option(config, "invert_masks"));
    if (!option_given(line, "alpha"))
        values->alpha = recorded_word(config, "alpha", ALPHA_WORDS, values->alpha);
    if (!option_given(line, "input-colorspace"))
        values->colorspace = json_string_value(config_option(config, "input_colorspace"));
    if (!option_given(line, "train-space"))
        values->space = recorded_word(config, "train_space", SPACE_WORDS, values->space);
    if (!option_given(line, "white"))
        values->white_point = json_number_value(config_option(config, "white"));
    if (!option_given(line, "downscale"))
        values->downscale = (int)json_integer_value(config_option(config, "downscale"));
    return -1;
}

// The strings of a JSON list, to be released with free(); members that are no strings become "".
static const char **json_strings(const json_t *list)
{
    const size_t count = json_array_size(list);
    const char **strings = calloc(count + 1, sizeof *strings);
    if (!strings)
        exit(fail_run("out of memory"));
    for (size_t k = 0; k < count; ++k) {
        const char *text = json_string_value(json_array_get(list, k));
        strings[k] = text ? text : "";
    }
    return strings;
}

static bool show_loading(void *user, size_t done, size_t total)
{
    (void)user;
    progress_count("loading", done, total);
    return !interrupt_signal();
}

// The cameras alone, after a failure to load the scene with its photos.
static sgs_status load_cameras(const char *path, sgs_scene_options *options, sgs_scene **scene)
{
    options->cameras_only = true;
    const sgs_status status = sgs_scene_load(path, options, scene);
    if (!status)
        print_note("%s: no images found; using the image sizes of the cameras", path);
    return status;
}

// Images beyond the cache can make decoding the slowest part of a training run.
static void note_cache(const sgs_scene *scene, uint64_t bytes)
{
    const double limit = (double)bytes, all = (double)scene->photo_bytes,
                 unit = limit >= 0x1p30   ? 0x1p30
                        : limit >= 0x1p20 ? 0x1p20
                                          : 0x1p10;
    if (scene->store)
        print_note("%s: about %.0f of %zu images fit in the image cache (%.2f of %.2f %s); the "
                   "others are decoded each time they are used; raise --image-cache if the memory "
                   "suffices",
                   scene->path, floor((double)scene->view_count * limit / all), scene->view_count,
                   limit / unit, all / unit,
                   unit == 0x1p30   ? "GiB"
                   : unit == 0x1p20 ? "MiB"
                                    : "KiB");
}

// with_photos: fails without them, as a load of images does.
static sgs_scene *open_scene(const char *path, const scene_values *values, bool load_images,
                             bool with_photos, int width, int height)
{
    sgs_scene_options options = sgs_scene_options_default();
    const char **held_out = values->held_out ? json_strings(values->held_out) : NULL;
    options.held_out = held_out;
    options.held_out_count = json_array_size(values->held_out);
    const char **kept = values->kept ? json_strings(values->kept) : NULL;
    options.kept = kept;
    options.kept_count = json_array_size(values->kept);
    options.use_dataset_split = values->use_dataset_split;
    options.images_dir = values->images;
    options.downscale = values->downscale;
    options.test_every = values->test_every;
    options.test_images = values->test_images;
    options.load_images = load_images;
    options.headers_only = values->headers_only;
    options.masks_dir = values->masks;
    options.invert_masks = values->invert_masks;
    options.alpha = (sgs_alpha)values->alpha;
    options.colorspace = values->colorspace;
    options.space = (sgs_space)values->space;
    options.white_point = values->white_point;
    options.measure_white_point = values->measure_white;
    options.image_cache = (size_t)values->cache_bytes;
    options.decode_memory = (size_t)values->decode_bytes;
    options.progress = show_loading;
    options.view_width = width;
    options.view_height = height;
    sgs_scene *scene = NULL;
    sgs_status status = sgs_scene_load(path, &options, &scene);
    if (status == SGS_STATUS_IO && !with_photos)
        status = load_cameras(path, &options, &scene);
    progress_end();
    interrupt_note_cancelled(status == SGS_STATUS_CANCELLED);
    if (status && status != SGS_STATUS_CANCELLED)
        fail_library();
    if (!status)
        note_cache(scene, values->cache_bytes);
    free(held_out);
    free(kept);
    if (scene && values->line && !scene_files_admit_outputs(scene, values->line)) {
        sgs_scene_destroy(scene);
        scene = NULL;
    }
    return scene;
}

sgs_scene *scene_open(const char *path, const scene_values *values, bool load_images)
{
    return open_scene(path, values, load_images, true, 0, 0);
}

sgs_scene *scene_open_cameras(const char *path, const scene_values *values, int width, int height)
{
    return open_scene(path, values, false, false, width, height);
}

void scene_warn_idle(const sgs_scene *scene, const scene_values *values, const command_line *line)
{
    char *why = format_text("on %s: no image has an alpha channel", scene->path);
    if (!scene->has_alpha)
        warn_idle(line, option_given(line, "opaque") ? "alpha" : "alpha|alpha-loss", why);
    free(why);
    why = format_text("on %s: no image is scene-linear", scene->path);
    if (!scene->linear_images)
        warn_idle(line, "white", why);
    free(why);
    why = format_text("on %s: there are no masks", scene->path);
    if (!scene->masks && (!values->masks || strcmp(values->masks, "none") != 0))
        warn_idle(line, "masks|invert-masks", why);
    free(why);
    why = format_text("on %s: the scene has points", scene->path);
    if (scene->point_count)
        warn_idle(line, "random-points", why);
    free(why);
}

bool view_in_split(const sgs_view *view, sgs_split split)
{
    return split == SGS_SPLIT_ALL || view->split == split;
}

bool scene_names_are_text(const sgs_scene *scene, const char *where)
{
    for (size_t v = 0; v < scene->view_count; ++v) {
        json_t *text = json_string(scene->views[v].name);
        json_decref(text);
        if (text)
            continue;
        fail_run("%s: the name of image %s is not UTF-8, and %s cannot contain it; rename the file "
                 "and its entry in the scene",
                 scene->path, scene->views[v].name, where);
        return false;
    }
    return true;
}

size_t scene_split_count(const sgs_scene *scene, sgs_split split)
{
    size_t count = 0;
    for (size_t v = 0; v < scene->view_count; ++v)
        count += view_in_split(&scene->views[v], split);
    return count;
}

static const option drawing_options[] = {
    {.name = "filter",
     .kind = OPTION_CHOICE,
     .offset = offsetof(drawing_values, filter),
     .argument = FILTER_WORDS,
     .initial = "3dgs",
     .shown = "as trained, else 3dgs",
     .help = "pixel filter: 0.3 px^2 dilation (3DGS), none, or Mip-Splatting's energy-preserving "
             "0.1 px^2"},
    {.name = "compact-box",
     .kind = OPTION_REAL,
     .offset = offsetof(drawing_values, compact_box),
     .low = 1e-3,
     .high = 1,
     .argument = "X",
     .initial = "1",
     .shown = "as trained, else 1",
     .help = "fraction of a primitive's support used to assign it to tiles; 1 is exact"},
    {.name = "background",
     .kind = OPTION_COLOR,
     .offset = offsetof(drawing_values, background),
     .argument = "R,G,B",
     .initial = "0,0,0",
     .shown = "as trained, else 0,0,0",
     .help = "background colour, from 0 to 1 in the space of the model: display values, or linear "
             "light after training in linear space"},
    {.name = "near",
     .kind = OPTION_REAL,
     .offset = offsetof(drawing_values, near_distance),
     .low = 1e-9,
     .high = 1e9,
     .argument = "X",
     .initial = "0.2",
     .shown = "as trained, else 0.2, or less for a small scene",
     .help = "near distance: hits closer to the camera than this are ignored; scene units"},
};

option_group drawing_group(drawing_values *values)
{
    *values = (drawing_values){.compact_box = 1, .white_point = 1, .near_distance = 0.2};
    return (option_group){.title = "Appearance",
                          .options = drawing_options,
                          .count = sizeof drawing_options / sizeof *drawing_options,
                          .values = values};
}

void drawing_resolve(drawing_values *values, const command_line *line, const json_t *config,
                     const scene_values *data, const sgs_scene *scene)
{
    if (!option_given(line, "filter"))
        values->filter = recorded_word(config, "filter", FILTER_WORDS, values->filter);
    values->filter_selected = option_given(line, "filter") || config_option(config, "filter");
    const double compact_box = json_number_value(config_option(config, "compact_box"));
    if (!option_given(line, "compact-box") && compact_box > 0 && compact_box <= 1)
        values->compact_box = compact_box;
    values->space = (sgs_space)data->space;
    values->white_point = data->white_point > 0             ? data->white_point
                          : scene && scene->white_point > 0 ? scene->white_point
                                                            : 1;
    const double trained = json_number_value(json_object_get(config, "near_distance"));
    values->near_selected = option_given(line, "near") || trained > 0 || scene;
    if (!option_given(line, "near"))
        values->near_distance =
            trained > 0 ? trained : sgs_near_distance(scene ? scene->extent : 1);
    if (option_given(line, "background"))
        return;
    const json_t *background = config_option(config, "background");
    for (size_t c = 0; c < 3; ++c) {
        if (json_is_array(background))
            values->background[c] = (float)json_number_value(json_array_get(background, c));
        else if (!background && scene && scene->white_background)
            values->background[c] = 1;
    }
}

sgs_render_options drawing_render_options(const drawing_values *values)
{
    sgs_render_options options = sgs_render_options_default();
    options.filter = (sgs_filter)values->filter;
    options.compact_box = values->compact_box;
    options.near_distance = values->near_distance;
    return options;
}

int command_parse(const command_spec *spec, int argc, char **argv, command_call *call)
{
    size_t count = 0;
    if (spec->option_count) {
        const option_group own = {.title = spec->title,
                                  .options = spec->options,
                                  .count = spec->option_count,
                                  .values = spec->values};
        call->groups[count++] = own;
    }
    if (spec->drawing)
        call->groups[count++] = drawing_group(spec->drawing);
    if (spec->scene)
        call->groups[count++] = scene_group(spec->scene);
    call->groups[count++] = common_group(&call->common, spec->name);
    call->line = (command_line){.command = spec->name,
                                .synopsis = spec->synopsis,
                                .description = spec->description,
                                .groups = call->groups,
                                .group_count = count,
                                .operand_minimum = spec->operand_minimum,
                                .operand_maximum = spec->operand_maximum};
    return command_line_parse(&call->line, argc, argv);
}

int command_begin(const command_spec *spec, int argc, char **argv, command_call *call)
{
    const int status = command_parse(spec, argc, argv, call);
    return status < 0 ? common_apply(&call->common, &call->line) : status;
}
