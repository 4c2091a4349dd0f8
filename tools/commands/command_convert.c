// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs convert`: reads a model of any format, filters and transforms it, and writes another
// format. The file name of OUT selects the format. Filters act first, in the coordinates of IN,
// then scale, rotation and translation, in this order.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "arguments/model_argument.h"
#include "arguments/model_reader.h"
#include "arguments/scene_files.h"
#include "arguments/shared_options.h"
#include "cameras/camera_export.h"
#include "cameras/camera_path.h"
#include "cli/commands.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "cli/run_files.h"
#include "draw/region_map.h"
#include "processes/interrupt.h"
#include "run/model_filter.h"
#include "sparegs/model_edit.h"
#include "sparegs/model_file.h"
#include "sparegs/prune.h"

static const char description[] =
    "Converts a model: reads IN (a file of a known format, a SOG folder or a run folder, "
    "whose latest iteration is used) and writes OUT in the format that its name selects: .ply, "
    ".compressed.ply, "
    ".splat, "
    ".spz, .ksplat, .glb, .sog, FOLDER/meta.json (SOG in files), FOLDER/lod-meta.json (SOG with "
    "levels of detail), .usda (OpenUSD) or .html (a page that shows the model offline).\nFilters "
    "are applied first and use the axes of a 3DGS PLY, regardless of the format of IN; then the "
    "model is scaled, rotated about x, y and z, and translated. SCENE is the data set of the "
    "model: its cameras are added to .usda and .html, --filter-unseen requires it, and its views "
    "rank the primitives for lod-meta.json.";

enum { MAX_NUMBERS = 8, MAX_CONDITIONS = 16 };
enum { ANTIALIASED_AUTO, ANTIALIASED_ON }; // words of --antialiased
#define NO_SLACK (-1e9)                    // below that of any region

typedef struct convert_values {
    const char *box, *sphere, *conditions, *floaters, *translate, *rotate;
    int region, harmonics, spz_version, spz_axes, input_spz_axes, ksplat_level, palette, iterations,
        levels, lod, antialiased;
    double opacity, scale, slack;
    bool drop_nan, unseen;
} convert_values;

static const option convert_options[] = {
    {.name = "filter-nan",
     .kind = OPTION_FLAG,
     .offset = offsetof(convert_values, drop_nan),
     .help =
         "also drop primitives with a zero quaternion (otherwise read as the identity); "
         "primitives with NaN or infinite values are always dropped; an opacity of 0 or 1 and a "
         "scale of 0 are valid"},
    {.name = "filter-box",
     .kind = OPTION_TEXT,
     .offset = offsetof(convert_values, box),
     .argument = "x,y,z,X,Y,Z",
     .shown = "none",
     .help = "keep primitives with centres from x,y,z to X,Y,Z; '-' means no limit"},
    {.name = "filter-sphere",
     .kind = OPTION_TEXT,
     .offset = offsetof(convert_values, sphere),
     .argument = "x,y,z,r",
     .shown = "none",
     .help = "keep primitives with centres within r of x,y,z"},
    {.name = "filter-value",
     .kind = OPTION_TEXT,
     .offset = offsetof(convert_values, conditions),
     .argument = "NAME,CMP,V[,...]",
     .shown = "none",
     .help = "keep primitives whose property satisfies the comparison; CMP is lt, lte, gt, gte, eq "
             "or neq. opacity is 0 to 1, scale_0 to scale_2 are in scene units, f_dc_0 to f_dc_2 "
             "are a colour; with the suffix _raw, stored values are compared. Several conditions "
             "are separated by commas"},
    {.name = "filter-opacity",
     .kind = OPTION_REAL,
     .offset = offsetof(convert_values, opacity),
     .high = 1,
     .argument = "MIN",
     .initial = "0",
     .help = "keep primitives of at least this opacity"},
    {.name = "filter-floaters",
     .kind = OPTION_TEXT,
     .offset = offsetof(convert_values, floaters),
     .argument = "auto|SIZE[,OPACITY[,SHARE]]",
     .shown = "none",
     .help = "keep connected primitives: voxels of SIZE scene units (auto: 4 times the median "
             "distance to the third neighbour) that contain the centre of a primitive with at "
             "least OPACITY (0.1) form components; those with less than SHARE (0.01) of the "
             "primitives are dropped"},
    {.name = "filter-unseen",
     .kind = OPTION_FLAG,
     .offset = offsetof(convert_values, unseen),
     .help = "drop primitives that no training view of SCENE sees: the sum of their blending "
             "weights is 0"},
    {.name = "filter-slack",
     .kind = OPTION_REAL,
     .offset = offsetof(convert_values, slack),
     .low = NO_SLACK,
     .high = -NO_SLACK,
     .argument = "MIN",
     .initial = "-1e9",
     .shown = "none",
     .help = "keep primitives of SPARE-GS regions with at least this slack at the last structural "
             "update; IN must be a run folder"},
    {.name = "filter-region",
     .kind = OPTION_INTEGER,
     .offset = offsetof(convert_values, region),
     .low = -1,
     .high = 256 * 256 * 256,
     .argument = "N",
     .initial = "-1",
     .shown = "all",
     .help = "keep primitives of this SPARE-GS region (see explain); IN must be a run folder"},
    {.name = "filter-harmonics",
     .kind = OPTION_INTEGER,
     .offset = offsetof(convert_values, harmonics),
     .high = 3,
     .argument = "N",
     .initial = "3",
     .help = "keep SH of degree N at most"},
    {.name = "scale",
     .kind = OPTION_REAL,
     .offset = offsetof(convert_values, scale),
     .low = 1e-6,
     .high = 1e6,
     .argument = "S",
     .initial = "1",
     .help = "scale about the origin"},
    {.name = "rotate",
     .kind = OPTION_TEXT,
     .offset = offsetof(convert_values, rotate),
     .argument = "x,y,z",
     .shown = "none",
     .unit = "degrees",
     .help = "rotate about the x axis, then y, then z, including the SH"},
    {.name = "translate",
     .kind = OPTION_TEXT,
     .offset = offsetof(convert_values, translate),
     .argument = "x,y,z",
     .shown = "none",
     .unit = "scene units",
     .help = "translate, after scaling and rotating"},
    {.name = "antialiased",
     .kind = OPTION_CHOICE,
     .offset = offsetof(convert_values, antialiased),
     .argument = "auto|on|off",
     .initial = "auto",
     .help = "mark OUT as trained with Mip-Splatting's filters (.ply, .compressed.ply, .spz, SOG, "
             ".html; other formats cannot record it); auto: if IN is marked, or its run used "
             "--filter mip"},
    {.name = "input-spz-axes",
     .kind = OPTION_CHOICE,
     .offset = offsetof(convert_values, input_spz_axes),
     .argument = "rub|rdf",
     .initial = "rub",
     .help = "axes of an .spz IN that does not declare them: rub (the specification) or rdf (those "
             "of the PLY)"},
    {.name = "lod",
     .kind = OPTION_INTEGER,
     .offset = offsetof(convert_values, lod),
     .high = 255,
     .argument = "N",
     .initial = "0",
     .help = "level of detail to read from a lod-meta.json; 0 is the finest"},
    {.name = "spz-version",
     .kind = OPTION_CHOICE,
     .offset = offsetof(convert_values, spz_version),
     .argument = "3|4",
     .initial = "3",
     .help = "version of .spz: 3 (gzip), which most programs read, or 4 (Zstandard)"},
    {.name = "spz-axes",
     .kind = OPTION_CHOICE,
     .offset = offsetof(convert_values, spz_axes),
     .argument = "rub|rdf",
     .initial = "rub",
     .help = "axes of .spz: rub (the specification), or rdf with a record that declares them"},
    {.name = "ksplat-level",
     .kind = OPTION_INTEGER,
     .offset = offsetof(convert_values, ksplat_level),
     .high = 2,
     .argument = "L",
     .initial = "1",
     .help = "compression of .ksplat: 0 floats, 1 16 bits, 2 SH in 8 bits"},
    {.name = "sh-palette",
     .kind = OPTION_INTEGER,
     .offset = offsetof(convert_values, palette),
     .high = 65536,
     .argument = "N",
     .initial = "0",
     .shown = "by the number of primitives",
     .help = "entries of the SH palette of SOG"},
    {.name = "iterations",
     .kind = OPTION_INTEGER,
     .offset = offsetof(convert_values, iterations),
     .low = 1,
     .high = 1000,
     .argument = "N",
     .initial = "10",
     .help = "iterations of k-means for the SH palette of SOG"},
    {.name = "lod-levels",
     .kind = OPTION_INTEGER,
     .offset = offsetof(convert_values, levels),
     .low = 1,
     .high = 16,
     .argument = "N",
     .initial = "4",
     .help = "levels of lod-meta.json; each holds the more important half of the previous level"},
};

// ---- Parsing ----

// Comma-separated numbers; "-" becomes `absent` if that is not NaN. Returns how many, or -1.
static int parse_numbers(const char *text, double absent, double *values, int most)
{
    int count = 0;
    for (const char *at = text; count < most; ++at) {
        char *end;
        values[count] = strtod(at, &end);
        if (end == at && *at == '-' && !isnan(absent)) {
            values[count] = absent;
            end = (char *)at + 1;
        } else if (end == at || !isfinite(values[count])) {
            return -1;
        }
        ++count;
        at = end;
        if (!*at)
            return count;
        if (*at != ',')
            return -1;
    }
    return -1;
}

typedef struct convert_plan {
    const convert_values *values;
    double box[6], sphere[4], rotate[3], translate[3];
    model_condition conditions[MAX_CONDITIONS];
    int condition_count;
    sgs_floater_options floaters;
    sgs_model_format format; // of OUT
} convert_plan;

static int parse_conditions(convert_plan *plan)
{
    static const char *const words[] = {"lt", "lte", "gt", "gte", "eq", "neq"};
    const char *at = plan->values->conditions;
    while (at) {
        model_condition *c = &plan->conditions[plan->condition_count];
        char comparison[8];
        int length = 0;
        if (plan->condition_count == MAX_CONDITIONS)
            return fail_usage("--filter-value: more than %d conditions", MAX_CONDITIONS);
        if (sscanf(at, "%31[^,],%7[^,],%lf%n", c->name, comparison, &c->value, &length) != 3 ||
            (at[length] && at[length] != ',') || isnan(c->value))
            return fail_usage("--filter-value: '%s' is not NAME,CMP,V", at);
        int k = 0;
        while (k < 6 && strcmp(words[k], comparison))
            ++k;
        if (k == 6)
            return fail_usage("--filter-value: '%s' is not lt, lte, gt, gte, eq or neq",
                              comparison);
        c->comparison = (sgs_comparison)k;
        ++plan->condition_count;
        at = at[length] ? at + length + 1 : NULL;
    }
    return -1;
}

static int parse_floaters(convert_plan *plan)
{
    const char *text = plan->values->floaters;
    double numbers[3] = {0, 0.1, 0.01};
    plan->floaters = (sgs_floater_options){.opacity = 0.1, .share = 0.01};
    if (!text)
        return -1;
    const bool automatic = !strncmp(text, "auto", 4) && (!text[4] || text[4] == ',');
    bool valid = true;
    if (!automatic)
        valid = parse_numbers(text, NAN, numbers, 3) > 0 && numbers[0] > 0;
    else if (text[4])
        valid = parse_numbers(text + 5, NAN, numbers + 1, 2) > 0;
    if (!valid || numbers[1] < 0 || numbers[2] < 0)
        return fail_usage("--filter-floaters: '%s' is not auto or SIZE, with [,OPACITY[,SHARE]]",
                          text);
    plan->floaters = (sgs_floater_options){numbers[0], numbers[1], numbers[2]};
    return -1;
}

// True if IN exists and is no .spz file.
static bool is_other(const char *in)
{
    sgs_model_format format;
    return file_exists(in) && !(sgs_model_format_detect(in, &format) && format == SGS_MODEL_SPZ);
}

static int parse_plan(const command_line *line, const convert_values *values, convert_plan *plan)
{
    *plan = (convert_plan){.values = values};
    const char *out = line->operands[1];
    if (!sgs_model_format_of_name(out, &plan->format))
        return fail_usage("%s: the name has no known extension; use .ply, .compressed.ply, .splat, "
                          ".spz, .ksplat, .glb, .sog, meta.json, lod-meta.json, .usda or .html",
                          out);
    if (values->box) {
        const int low = parse_numbers(values->box, -INFINITY, plan->box, 6);
        double high[6];
        if (low != 6)
            return fail_usage("--filter-box: '%s' is not x,y,z,X,Y,Z", values->box);
        parse_numbers(values->box, INFINITY, high, 6);
        memcpy(plan->box + 3, high + 3, 3 * sizeof *high);
    }
    if (values->sphere &&
        (parse_numbers(values->sphere, NAN, plan->sphere, 4) != 4 || plan->sphere[3] < 0))
        return fail_usage("--filter-sphere: '%s' is not x,y,z,r", values->sphere);
    if (values->rotate && parse_numbers(values->rotate, NAN, plan->rotate, 3) != 3)
        return fail_usage("--rotate: '%s' is not x,y,z", values->rotate);
    if (values->translate && parse_numbers(values->translate, NAN, plan->translate, 3) != 3)
        return fail_usage("--translate: '%s' is not x,y,z", values->translate);
    int status = parse_conditions(plan);
    if (status < 0)
        status = parse_floaters(plan);
    if (status < 0 && option_given(line, "input-spz-axes") && is_other(line->operands[0]))
        status = refuse_idle(line, "input-spz-axes", "unless IN is an .spz file");
    if (status < 0 && plan->format != SGS_MODEL_SPZ)
        status = refuse_idle(line, "spz-version|spz-axes", "unless OUT is an .spz file");
    if (status < 0 && plan->format != SGS_MODEL_KSPLAT)
        status = refuse_idle(line, "ksplat-level", "unless OUT is a .ksplat file");
    if (status < 0 && plan->format != SGS_MODEL_SOG && plan->format != SGS_MODEL_LOD_SOG &&
        plan->format != SGS_MODEL_HTML)
        status = refuse_idle(line, "sh-palette|iterations", "unless OUT is SOG or .html");
    if (status < 0 && plan->format != SGS_MODEL_LOD_SOG)
        status = refuse_idle(line, "lod-levels", "unless OUT is a lod-meta.json");
    if (status < 0 && values->antialiased == ANTIALIASED_ON &&
        !sgs_model_format_marks_filter(plan->format))
        status = fail_usage("--antialiased on has no effect on %s: the format cannot record it; "
                            "render with --filter mip",
                            out);
    if (status < 0 && line->operand_count == 2)
        status = refuse_idle(line, "filter-unseen", "without a SCENE");
    if (status < 0 && line->operand_count == 3 && !values->unseen &&
        plan->format != SGS_MODEL_USDA && plan->format != SGS_MODEL_HTML &&
        plan->format != SGS_MODEL_LOD_SOG)
        status = fail_usage("SCENE has no effect without --filter-unseen, unless OUT is a .usda or "
                            ".html file or a lod-meta.json");
    return status;
}

// ---- Filters and transform ----

// The regions of the primitives for the filters that use them; false after printing the error.
static bool read_regions(const convert_plan *plan, const char *folder, const opened_model *opened,
                         region_map *regions)
{
    const convert_values *values = plan->values;
    if (values->region < 0 && !(values->slack > NO_SLACK))
        return true;
    if (!opened->located.iteration) {
        fail_run("%s: --filter-slack and --filter-region require a run folder", folder);
        return false;
    }
    if (!region_map_read(opened->located.run, opened->located.iteration, opened->gaussians,
                         regions))
        return false;
    if (!regions->iteration)
        fail_run("%s: contains no records of SPARE-GS regions", folder);
    return regions->iteration > 0;
}

static bool filter_model(const convert_plan *plan, const char *name, const opened_model *opened)
{
    const convert_values *values = plan->values;
    sgs_gaussians *model = opened->gaussians;
    region_map regions = {0};
    if (!read_regions(plan, name, opened, &regions))
        return false;
    const model_filter filter = {.box = values->box ? plan->box : NULL,
                                 .sphere = values->sphere ? plan->sphere : NULL,
                                 .conditions = plan->conditions,
                                 .condition_count = plan->condition_count,
                                 .opacity = values->opacity,
                                 .region = regions.region,
                                 .slack = regions.slack,
                                 .only_region = values->region,
                                 .slack_low = values->slack,
                                 .floaters = values->floaters ? &plan->floaters : NULL};
    unsigned char *keep = malloc(model->count + 1);
    if (!keep)
        fail_run("not enough memory to filter %zu primitives", model->count);
    const bool done = keep && model_filter_select(&filter, model, keep);
    if (done)
        sgs_selection_apply(model, keep);
    free(keep);
    region_map_free(&regions);
    sgs_gaussians_limit_sh(model, values->harmonics);
    return done;
}

static bool show_views(void *user, size_t done, size_t total)
{
    (void)user;
    progress_work("views", done, total);
    return !interrupt_signal();
}

// Sums of the blending weights of each primitive over the training views; free(). NULL after
// printing the error.
static float *view_weights(const opened_model *opened, const sgs_scene *scene)
{
    const size_t count = opened->gaussians->count;
    sgs_contribution *contributions = malloc((count + 1) * sizeof *contributions);
    float *weights = malloc((count + 1) * sizeof *weights);
    sgs_view_pass_options options = sgs_view_pass_options_default();
    sgs_render_options render = sgs_render_options_default();
    render.filter = opened->antialiased ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
    render.near_distance = sgs_near_distance(scene->extent);
    options.render = &render;
    options.progress = show_views;
    progress_work_start();
    bool done = contributions && weights;
    if (!done) {
        fail_run("not enough memory for the weights of %zu primitives", count);
    } else {
        const sgs_status status =
            sgs_contributions(opened->gaussians, scene, &options, contributions);
        done = !status;
        if (status && status != SGS_STATUS_CANCELLED)
            fail_library();
    }
    progress_end();
    for (size_t i = 0; done && i < count; ++i)
        weights[i] = (float)contributions[i].weight;
    free(contributions);
    if (done)
        return weights;
    free(weights);
    return NULL;
}

static bool drop_unseen(const opened_model *opened, const sgs_scene *scene)
{
    const size_t count = opened->gaussians->count;
    float *weights = view_weights(opened, scene);
    unsigned char *keep = weights ? malloc(count + 1) : NULL;
    for (size_t i = 0; keep && i < count; ++i)
        keep[i] = weights[i] > 0;
    if (keep)
        sgs_selection_apply(opened->gaussians, keep);
    const bool done = keep != NULL;
    free(keep);
    free(weights);
    return done;
}

static bool transform_model(const convert_plan *plan, sgs_gaussians *model)
{
    const convert_values *values = plan->values;
    if (values->scale == 1 && !values->rotate && !values->translate)
        return true;
    sgs_similarity similarity = {.scale = values->scale, .rotation = {1, 0, 0, 0}};
    memcpy(similarity.translation, plan->translate, sizeof plan->translate);
    for (int axis = 0; axis < 3; ++axis) { // the quaternion of the axis times the one so far
        const double half = plan->rotate[axis] * acos(-1.0) / 360.0, c = cos(half), s = sin(half);
        const double *q = similarity.rotation;
        const int i = 1 + axis, j = 1 + (axis + 1) % 3, k = 1 + (axis + 2) % 3;
        double turned[4];
        turned[0] = c * q[0] - s * q[i];
        turned[i] = c * q[i] + s * q[0];
        turned[j] = c * q[j] - s * q[k];
        turned[k] = c * q[k] + s * q[j];
        memcpy(similarity.rotation, turned, sizeof turned);
    }
    if (sgs_gaussians_transform(model, &similarity)) {
        fail_library();
        return false;
    }
    return true;
}

// The rotation of the model as a matrix.
static void plan_rotation(const convert_plan *plan, double rotation[3][3])
{
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            rotation[row][column] = row == column;
    for (int axis = 0; axis < 3; ++axis) {
        const double angle = plan->rotate[axis] * acos(-1.0) / 180.0, c = cos(angle),
                     s = sin(angle);
        const int j = (axis + 1) % 3, k = (axis + 2) % 3;
        for (int column = 0; column < 3; ++column) {
            const double a = rotation[j][column], b = rotation[k][column];
            rotation[j][column] = c * a - s * b;
            rotation[k][column] = s * a + c * b;
        }
    }
}

// The up axis of the capture, which turns with the model.
static void transform_up(const convert_plan *plan, const sgs_scene *scene, double up[3])
{
    double rotation[3][3], before[3];
    plan_rotation(plan, rotation);
    camera_path_up(scene, NULL, before);
    for (int row = 0; row < 3; ++row)
        up[row] = rotation[row][0] * before[0] + rotation[row][1] * before[1] +
                  rotation[row][2] * before[2];
}

// The cameras move with the model.
static void transform_camera(const convert_plan *plan, sgs_model_camera *camera)
{
    double rotation[3][3], turned[9];
    plan_rotation(plan, rotation);
    // x' = S R x + T: the new pose is r R^T, S t - r R^T T.
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) {
            turned[3 * row + column] = 0;
            for (int k = 0; k < 3; ++k)
                turned[3 * row + column] += camera->rotation[3 * row + k] * rotation[column][k];
        }
    memcpy(camera->rotation, turned, sizeof turned);
    for (int row = 0; row < 3; ++row) {
        camera->translation[row] *= plan->values->scale;
        for (int k = 0; k < 3; ++k)
            camera->translation[row] -= turned[3 * row + k] * plan->translate[k];
    }
}

// ---- Writing ----

// False without memory.
static bool make_cameras(const convert_plan *plan, const sgs_scene *scene, model_cameras *list)
{
    list->cameras = calloc(scene->view_count + 1, sizeof *list->cameras);
    if (!list->cameras)
        return false;
    for (size_t v = 0; v < scene->view_count; ++v)
        model_cameras_add(list, scene->views[v].name, &scene->views[v].camera,
                          &scene->views[v].pose);
    for (size_t k = 0; k < list->count; ++k)
        transform_camera(plan, &list->cameras[k]);
    model_cameras_warn(list, plan->format);
    return true;
}

// What OUT should record about the model.
typedef struct model_marks {
    bool antialiased;
    sgs_model_colors colors;
} model_marks;

static bool write_model(const convert_plan *plan, const char *path, const sgs_gaussians *model,
                        const sgs_scene *scene, const float *importance, const model_marks *marks,
                        sgs_model_written *written)
{
    const convert_values *values = plan->values;
    sgs_model_write_options options = sgs_model_write_options_default();
    options.antialiased = marks->antialiased;
    options.colors = marks->colors;
    options.spz_version = values->spz_version + 3;
    options.spz_axes = (sgs_spz_axes)values->spz_axes;
    options.ksplat_level = values->ksplat_level;
    options.sh_palette = values->palette;
    options.palette_iterations = values->iterations;
    options.lod_levels = values->levels;
    options.importance = importance;
    options.progress = model_show_encoding;
    model_warn_unmarked(path, plan->format, &options);
    const bool has_cameras =
        scene && (plan->format == SGS_MODEL_USDA || plan->format == SGS_MODEL_HTML);
    model_cameras cameras = {0};
    if (has_cameras && !make_cameras(plan, scene, &cameras)) {
        fail_run("%s: not enough memory for %zu cameras", path, scene->view_count);
        return false;
    }
    progress_work_start();
    options.cameras = cameras.cameras;
    options.camera_count = cameras.count;
    if (has_cameras)
        transform_up(plan, scene, options.up);
    const sgs_status status = sgs_model_write(path, model, &options, written);
    progress_end();
    free(cameras.cameras);
    if (status && status != SGS_STATUS_CANCELLED)
        fail_library();
    return !status;
}

static bool report(const char *path, size_t input, const sgs_model_written *written,
                   const char *input_format, bool antialiased, bool json)
{
    static const char *const orders[] = {
        [SGS_ROWS_KEPT] = "kept",
        [SGS_ROWS_MORTON] = "morton",
        [SGS_ROWS_IMPORTANCE] = "importance",
        [SGS_ROWS_BUCKETS] = "buckets",
    };
    if (!json) {
        printf("%s\n", path);
        return true;
    }
    json_t *root = json_object();
    json_object_set_new(root, "input", json_integer((json_int_t)input));
    json_object_set_new(root, "output", json_integer((json_int_t)written->count));
    json_object_set_new(root, "bytes", json_integer((json_int_t)written->bytes));
    json_object_set_new(root, "order", json_string(orders[written->order]));
    json_object_set_new(root, "input_format", json_string(input_format));
    json_object_set_new(root, "antialiased", json_boolean(antialiased));
    json_object_set_new(root, "file", json_text(path));
    return print_json(root);
}

static int refuse_input_at(const char *out)
{
    return fail_usage("OUT: %s is an input of this command; choose another file", out);
}

static int convert(const command_line *line, const convert_plan *plan, scene_values *data,
                   bool json)
{
    const char *out = line->operands[1];
    sgs_model_read_options options = sgs_model_read_options_default();
    options.spz_axes = (sgs_spz_axes)plan->values->input_spz_axes;
    options.lod = plan->values->lod;
    options.drop_zero_quaternions = plan->values->drop_nan;
    opened_model opened;
    sgs_scene *scene = NULL;
    float *importance = NULL;
    sgs_model_written written = {0};
    if (!model_open(line->operands[0], &options, &opened))
        return EXIT_FAILED;
    const int usage = same_file(out, opened.located.ply_path) // the model in a run folder
                          ? refuse_input_at(out)
                          : model_scene_resolve(data, line, &opened.located);
    bool done = usage < 0;
    if (done && line->operand_count == 3) {
        scene = scene_open(line->operands[2], data, false);
        scene_files files = scene_files_of(scene);
        done = scene && scene_files_admit(&files, out, "choose another file");
        scene_files_free(&files);
    }
    const size_t input = opened.gaussians->count + opened.info.dropped;
    const model_marks marks = {.antialiased = plan->values->antialiased == ANTIALIASED_AUTO
                                                  ? opened.antialiased
                                                  : plan->values->antialiased == ANTIALIASED_ON,
                               .colors = model_colors((sgs_space)data->space, data->white_point)};
    done = done && filter_model(plan, line->operands[0], &opened) &&
           (!plan->values->unseen || (scene && drop_unseen(&opened, scene)));
    if (done && !opened.gaussians->count) {
        fail_run("%s: no primitive is left; nothing was written", line->operands[0]);
        done = false;
    }
    if (done && scene && plan->format == SGS_MODEL_LOD_SOG) {
        importance = view_weights(&opened, scene);
        done = importance != NULL;
    }
    done = done && transform_model(plan, opened.gaussians) && make_folder_of(out) &&
           write_model(plan, out, opened.gaussians, scene, importance, &marks, &written) &&
           report(out, input, &written, model_reader_format(opened.located.ply_path, &opened.info),
                  marks.antialiased && sgs_model_format_marks_filter(plan->format), json);
    free(importance);
    sgs_scene_destroy(scene);
    opened_model_free(&opened);
    if (usage >= 0)
        return usage;
    return interrupt_signal() && !done ? interrupt_status() : done ? EXIT_DONE : EXIT_FAILED;
}

int command_convert(int argc, char **argv)
{
    command_call call;
    convert_values values = {0};
    scene_values data;
    convert_plan plan;
    const command_spec spec = {.name = "convert",
                               .synopsis = "IN OUT [SCENE] [options]",
                               .description = description,
                               .operand_minimum = 2,
                               .operand_maximum = 3,
                               .title = "Conversion",
                               .options = convert_options,
                               .option_count = sizeof convert_options / sizeof *convert_options,
                               .values = &values,
                               .scene = &data};
    int status = command_parse(&spec, argc, argv, &call);
    if (status < 0)
        status = parse_plan(&call.line, &values, &plan);
    if (status < 0)
        status = common_apply(&call.common, &call.line);
    if (status >= 0)
        return status;
    if (call.line.operand_count == 2)
        warn_idle(&call.line, "images|downscale|eval|test-every|test-images", "without a SCENE");
    warn_idle(&call.line, "masks|invert-masks|alpha|image-cache|input-colorspace",
              "on convert, which reads no photos");
    const char *out = call.line.operands[1];
    if (same_file(out, call.line.operands[0]))
        return refuse_input_at(out);
    const char *owner = run_file_owner(out, NULL);
    if (owner)
        return fail_usage("OUT: %s is a file of %s; choose another file", out, owner);
    const int manifest = model_check_manifest(out);
    if (manifest >= 0)
        return manifest;
    if (!check_output(out))
        return EXIT_FAILED;
    interrupt_watch();
    return convert(&call.line, &plan, &data, call.common.json);
}
