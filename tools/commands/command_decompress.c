// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs decompress`: a compressed model as a PLY file or in another format of models.

#include <stdlib.h>

#include "cli/commands.h"
#include "processes/interrupt.h"
#include "cli/json_result.h"
#include "cli/json_output.h"
#include "arguments/model_argument.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "arguments/shared_options.h"
#include "sparegs/compress.h"

static const char description[] =
    "Writes the model in FILE, made by `sparegs compress`, as a PLY file, or in the model format "
    "that the name of OUT selects, as `sparegs convert` does. The bytes of a PLY file are the same "
    "on every machine and with any number of threads.";

typedef struct decompress_values {
    const char *output;
} decompress_values;

static const option decompress_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_TEXT,
     .offset = offsetof(decompress_values, output),
     .path = PATH_OUTPUT,
     .argument = "OUT.ply",
     .help = "output file; its extension selects the format (required)"},
};

// Writes the model in the format of the name, with what the compressed file records about it. False
// after printing the error or after a signal.
static bool write_model(const char *path, sgs_model_format format, const sgs_gaussians *model,
                        const sgs_compress_info *info, sgs_model_written *written)
{
    sgs_model_write_options options = sgs_model_write_options_default();
    options.progress = model_show_encoding;
    options.antialiased = info->antialiased;
    options.colors = info->colors;
    model_warn_unmarked(path, format, &options);
    if (!make_folder_of(path))
        return false;
    progress_work_start();
    const sgs_status status = sgs_model_write(path, model, &options, written);
    progress_end();
    if (status && status != SGS_STATUS_CANCELLED)
        fail_library();
    return !status;
}

static int decompress_file(const char *path, const char *output, sgs_model_format format, bool json)
{
    sgs_gaussians *model = NULL;
    sgs_compress_info info;
    sgs_model_written written = {0};
    const double start = clock_seconds();
    if (sgs_decompress(path, &model, &info))
        return fail_library();
    const bool done = !interrupt_signal() && write_model(output, format, model, &info, &written);
    sgs_gaussians_destroy(model);
    if (interrupt_signal())
        return interrupt_status();
    if (!done)
        return EXIT_FAILED;
    if (!json) {
        printf("%s: %s, %zu primitives, SH degree %d\n", output,
               sgs_compress_method_name(info.method), info.gaussians, info.sh_degree);
        return EXIT_DONE;
    }
    json_t *root = json_result_new();
    json_object_set_new(root, "file", json_text(output));
    json_object_set_new(root, "method", json_string(sgs_compress_method_name(info.method)));
    json_object_set_new(root, "input", json_integer((json_int_t)info.input));
    json_object_set_new(root, "gaussians", json_integer((json_int_t)info.gaussians));
    json_object_set_new(root, "bytes", json_integer((json_int_t)written.bytes));
    json_object_set_new(root, "bytes_per_gaussian",
                        json_number((double)written.bytes / (double)info.gaussians));
    json_object_set_new(root, "input_bytes", json_integer((json_int_t)info.bytes));
    json_object_set_new(root, "seconds", json_number(clock_seconds() - start));
    return print_json(root) ? EXIT_DONE : EXIT_FAILED;
}

int command_decompress(int argc, char **argv)
{
    command_call call;
    decompress_values values = {0};
    const command_spec spec = {.name = "decompress",
                               .synopsis = "FILE -o OUT.ply [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 1,
                               .title = "Decompression",
                               .options = decompress_options,
                               .option_count =
                                   sizeof decompress_options / sizeof *decompress_options,
                               .values = &values};
    int status = command_begin(&spec, argc, argv, &call);
    if (status >= 0)
        return status;
    if (!values.output)
        return fail_usage("decompress requires -o OUT.ply");
    sgs_model_format format;
    status = model_output_format(values.output, &format);
    if (status >= 0)
        return status;
    if (!check_output(values.output))
        return EXIT_FAILED;
    interrupt_watch();
    return decompress_file(call.line.operands[0], values.output, format, call.common.json);
}
