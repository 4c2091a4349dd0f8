// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs view`: shows a stored model in the browser, rendered by the tracer.

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "cameras/camera_export.h"
#include "cameras/camera_path.h"
#include "cli/commands.h"
#include "cli/json_output.h"
#include "cli/json_result.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "cli/standard_output.h"
#include "processes/interrupt.h"
#include "viewer/view_session.h"

static const char description[] =
    "Shows MODEL (a model file, or a run folder, whose latest iteration is used) in the browser, "
    "rendered by the ray tracer. Prints the address to open and serves until SIGINT or SIGTERM. "
    "With SCENE, its photos can be shown next to the renders. A run folder provides its cameras, "
    "even without SCENE, and the curves of its training.";

typedef struct view_values {
    int port;
    const char *address, *token, *export, *run;
} view_values;

static const option view_options_table[] = {
    {.name = "port",
     .kind = OPTION_INTEGER,
     .offset = offsetof(view_values, port),
     .low = 0,
     .high = 65535,
     .argument = "N",
     .initial = "8080",
     .help = "port to listen on; 0 chooses a free one"},
    {.name = "address",
     .kind = OPTION_TEXT,
     .offset = offsetof(view_values, address),
     .argument = "A",
     .initial = "127.0.0.1",
     .help = "IPv4 address to listen on; 0.0.0.0 for all. Every address outside 127.0.0.0/8 "
             "requires the token that is part of the printed URL"},
    {.name = "token",
     .kind = OPTION_TEXT,
     .offset = offsetof(view_values, token),
     .argument = "T",
     .shown = "SPAREGS_TOKEN, else none for 127.0.0.0/8 and random for others",
     .help = "require this token: random, or 8 to 128 letters, digits, '-' or '_'. Other users of "
             "the machine can read it on the command line, but not in the environment variable "
             "SPAREGS_TOKEN"},
    {.name = "export",
     .kind = OPTION_TEXT,
     .path = PATH_OUTPUT,
     .offset = offsetof(view_values, export),
     .argument = "FILE.html",
     .shown = "serve",
     .help = "write a page that shows the model offline with WebGL 2, compressed as SOG, with the "
             "cameras; do not serve"},
    RUN_OPTION(view_values),
};

// Waits for a signal.
static void serve(void)
{
    const struct timespec pause = {0, 50000000};
    while (!interrupt_signal())
        nanosleep(&pause, NULL);
}

// Prints the address now, not when the command ends. False after printing the error.
static bool print_address(const view_session *session, bool json)
{
    if (!json) {
        view_session_print(session);
        return true;
    }
    json_t *root = json_result_new();
    json_object_set_new(root, "url", json_string(view_session_url(session)));
    json_result_set(root);
    const bool printed = json_result_print(EXIT_DONE, true);
    stdout_flush();
    return printed;
}

static int export_page(const char *path, const view_source *source, bool json)
{
    const camera_list *views = &source->views;
    if (!make_folder_of(path))
        return EXIT_FAILED;
    model_cameras list = {.cameras = calloc(views->count + 1, sizeof *list.cameras)};
    if (!list.cameras)
        return fail_run("not enough memory for %zu cameras", views->count);
    for (size_t k = 0; k < views->count; ++k)
        model_cameras_add(&list, views->cameras[k].name, &views->cameras[k].camera,
                          &views->cameras[k].pose);
    model_cameras_warn(&list, SGS_MODEL_HTML);
    sgs_model_write_options options = model_write_options(&source->drawing);
    options.cameras = list.cameras;
    options.camera_count = list.count;
    camera_path_up(source->scene, views, options.up);
    options.progress = model_show_encoding;
    model_warn_unmarked(path, SGS_MODEL_HTML, &options);
    progress_work_start();
    const sgs_status status = sgs_model_write(path, source->model, &options, NULL);
    progress_end();
    free(list.cameras);
    if (status == SGS_STATUS_CANCELLED)
        return interrupt_status();
    if (status)
        return fail_library();
    if (json) {
        json_t *root = json_result_new();
        json_object_set_new(root, "file", json_text(path));
        return print_json(root) ? EXIT_DONE : EXIT_FAILED;
    }
    printf("%s\n", path);
    return EXIT_DONE;
}

// The options of `convert` that give a crop the filter and colour space of the rendered model. Of
// itself, it uses those of the file, or of its own run folder. Release with free().
static char *convert_marks(const command_line *line, const view_values *values,
                           const model_path *located, const sgs_model_info *info,
                           const drawing_values *drawing)
{
    const sgs_model_colors colors = model_colors(drawing->space, drawing->white_point);
    const bool is_mip = drawing->filter == SGS_FILTER_MIP,
               is_own = !values->run && is_mip == model_is_antialiased(located, info);
    const char *filter = is_own && !option_given(line, "filter") ? ""
                         : is_mip                                ? "--antialiased on"
                                                                 : "--antialiased off";
    if (!(colors.white_point > 0) && !values->run && !option_given(line, "train-space") &&
        !option_given(line, "white"))
        return format_text("%s", filter);
    return format_text("%s%s--train-space %s --white %.9g", filter, *filter ? " " : "",
                       colors.space == SGS_SPACE_LINEAR ? "linear" : "srgb", drawing->white_point);
}

static int view_model(const command_line *line, const model_path *located,
                      const view_values *values, drawing_values *drawing, view_session *session,
                      bool json)
{
    view_session_options options = {.token = values->token, .share = 1};
    sgs_gaussians *model = NULL;
    sgs_model_info info;
    options.address.port = values->port;
    view_address_host(values->address, &options.address);
    if ((values->export && !check_output(values->export)) ||
        !model_read_info(located, drawing, &model, &info))
        return EXIT_FAILED;
    session->source.marks = convert_marks(line, values, located, &info, drawing);
    session->source.drawing = *drawing;
    const bool done = view_source_open(
        &session->source, model, located->iteration ? located->run : NULL, located->iteration);
    if (done && !session->source.folder) {
        const char *slash = strrchr(located->ply_path, '/');
        session->source.folder =
            slash ? format_text("%.*s", (int)(slash - located->ply_path), located->ply_path)
                  : format_text(".");
    }
    if (done && values->export)
        return export_page(values->export, &session->source, json);
    if (!done || !view_session_start(session, &options) || !print_address(session, json))
        return EXIT_FAILED;
    print_note("%s: %zu primitives; press Ctrl-C to stop", line->operands[0],
               session->source.model->count);
    serve();
    return EXIT_DONE;
}

static int run_view(const command_line *line, const view_values *values, scene_values *data,
                    drawing_values *drawing, bool json)
{
    model_path located;
    sgs_scene *scene = NULL;
    view_session session = {0};
    int status = model_locate_of_run(line->operands[0], values->run, &located) ? -1 : EXIT_FAILED;
    if (status < 0)
        status = model_scene_resolve(data, line, &located);
    if (status < 0 && line->operand_count > 1) {
        data->measure_white = !values->export; // of the photos that are shown
        scene = scene_open(line->operands[1], data, false);
        status = scene ? -1 : EXIT_FAILED;
    }
    if (status < 0) {
        drawing_resolve(drawing, line, located.config, data, scene);
        session.source.name = line->operands[0];
        session.source.scene = scene;
        status = view_model(line, &located, values, drawing, &session, json);
    }
    view_session_stop(&session);
    view_source_close(&session.source);
    sgs_scene_destroy(scene);
    model_path_free(&located);
    return status;
}

// Checks values with their own syntax. Returns -1 to continue, or an exit status.
static int check_values(const view_values *values)
{
    view_address address;
    if (!view_address_host(values->address, &address))
        return fail_usage("--address: '%s' is not a numeric IPv4 address such as 127.0.0.1 or "
                          "0.0.0.0",
                          values->address);
    sgs_model_format format;
    if (values->export &&
        (!sgs_model_format_of_name(values->export, &format) || format != SGS_MODEL_HTML))
        return fail_usage("--export: '%s' does not end in .html", values->export);
    if ((values->token || !values->export) && !view_token_is_possible(values->token))
        return fail_usage("%s: " VIEW_TOKEN_SYNTAX,
                          values->token ? "--token" : VIEW_TOKEN_VARIABLE);
    return -1;
}

int command_view(int argc, char **argv)
{
    command_call call;
    scene_values data;
    drawing_values drawing;
    view_values values = {0};
    const command_spec spec = {.name = "view",
                               .synopsis = "MODEL [SCENE] [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 2,
                               .title = "Server",
                               .options = view_options_table,
                               .option_count =
                                   sizeof view_options_table / sizeof *view_options_table,
                               .values = &values,
                               .scene = &data,
                               .drawing = &drawing};
    int status = command_parse(&spec, argc, argv, &call);
    if (status < 0)
        status = check_values(&values);
    if (status < 0 && values.export)
        status = refuse_idle(&call.line, "port|address|token|background|near|compact-box",
                             "with --export");
    if (status < 0)
        status = common_apply(&call.common, &call.line);
    if (status >= 0)
        return status;
    if (call.line.operand_count < 2)
        warn_idle(&call.line, "images|downscale|eval|test-every|test-images|alpha|input-colorspace",
                  "without SCENE");
    else if (values.export)
        warn_idle(&call.line, "alpha|input-colorspace", "with --export");
    warn_idle(&call.line, "masks|invert-masks|image-cache", "on view");
    interrupt_watch();
    return run_view(&call.line, &values, &data, &drawing, call.common.json);
}
