// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The trainer's whole state in one file, little-endian:
//
//   magic "SPAREGS1", version, section count; a fingerprint of the options and the scene;
//   per section: tag (4 bytes), bytes (8), content; at the end XXH64 of everything before it.
//
// Sections: PROG (counters, averages, equilibrium, seconds), MODL, MOM1, MOM2 (rows 0..count, 59 floats each), STAT (a, |a|, d, rho),
// GUES (the depth guesses, which decide which hidden candidates take part and so the last bits of a step), ORDR (view order).
// The BVH is not stored: padded bounds make the hits independent of it. A file that is cut, changed or of another
// run is refused before the trainer is touched.

#include <math.h>
#include <string.h>
#include <xxhash.h>

#include "core.h"
#include "trainer_state.h"

static const char magic[8] = {'S', 'P', 'A', 'R', 'E', 'G', 'S', '1'};
enum { VERSION = 2, SECTIONS = 7 };

typedef struct file_header {
    char magic[8];
    uint32_t version, sections;
    uint64_t fingerprint, count;
} file_header;

typedef struct section_header {
    char tag[4];
    uint32_t reserved;
    uint64_t bytes;
} section_header;

// Everything that shapes the run and is not in the sections.
static uint64_t run_fingerprint(const sgs_trainer *trainer)
{
    const sgs_train_options *o = &trainer->options;
    const double values[] = {o->iterations, o->schedule, o->pipeline, o->filter, o->optimizer, o->sh_degree, o->background[0],
                             o->background[1], o->background[2], o->background_random, (double)o->max_gaussians, (double)o->seed,
                             o->spare, o->spare_grid, o->spare_tau_alpha, o->spare_eps_loss, o->spare_eps_count,
                             o->spare_patience, o->spare_interval, o->spare_demand, (double)trainer->train_view_count,
                             (double)trainer->scene->point_count};
    XXH64_state_t *state = XXH64_createState();
    if (!state)
        return 0;
    XXH64_reset(state, 0);
    XXH64_update(state, values, sizeof values);
    for (size_t i = 0; i < trainer->train_view_count; ++i) {
        const sgs_view *view = &trainer->scene->views[trainer->train_views[i]];
        XXH64_update(state, view->name, strlen(view->name));
        XXH64_update(state, &view->camera.width, sizeof view->camera.width);
        XXH64_update(state, view->camera.params, sizeof view->camera.params);
        XXH64_update(state, &view->pose, sizeof view->pose);
    }
    const uint64_t digest = XXH64_digest(state);
    XXH64_freeState(state);
    return digest;
}

typedef struct checkpoint_writer {
    FILE *stream;
    XXH64_state_t *hash;
    bool failed;
} checkpoint_writer;

static void put(checkpoint_writer *writer, const void *data, size_t bytes)
{
    if (writer->failed || !bytes)
        return;
    writer->failed = fwrite(data, 1, bytes, writer->stream) != bytes || XXH64_update(writer->hash, data, bytes) != XXH_OK;
}

static void put_section(checkpoint_writer *writer, const char *tag, size_t bytes)
{
    section_header header = {.bytes = bytes};
    memcpy(header.tag, tag, 4);
    put(writer, &header, sizeof header);
}

static void put_rows(checkpoint_writer *writer, const char *tag, const float *block, size_t count)
{
    put_section(writer, tag, count * SGS_PARAM_COUNT * sizeof(float));
    float row[SGS_PARAM_COUNT];
    for (size_t i = 0; i < count; ++i) {
        const float *from = block + i / SGS_LANES * SGS_PARAM_COUNT * SGS_LANES + i % SGS_LANES;
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            row[k] = from[k * SGS_LANES];
        put(writer, row, sizeof row);
    }
}

static void put_state(checkpoint_writer *writer, const sgs_trainer *trainer)
{
    const size_t n = trainer->model->count;
    const file_header header = {.version = VERSION, .sections = SECTIONS, .fingerprint = run_fingerprint(trainer), .count = n};
    file_header named = header;
    memcpy(named.magic, magic, sizeof magic);
    put(writer, &named, sizeof named);
    put_section(writer, "PROG", sizeof trainer->progress);
    put(writer, &trainer->progress, sizeof trainer->progress);
    put_rows(writer, "MODL", trainer->model->data, n);
    put_rows(writer, "MOM1", trainer->m, n);
    put_rows(writer, "MOM2", trainer->v, n);
    put_section(writer, "STAT", n * 16);
    put(writer, trainer->statistics.gradient_sum, n * sizeof(float));
    put(writer, trainer->statistics.absolute_sum, n * sizeof(float));
    put(writer, trainer->statistics.visible_count, n * sizeof(uint32_t));
    put(writer, trainer->statistics.radius_max, n * sizeof(float));
    size_t tiles = 0;
    for (size_t i = 0; i < trainer->train_view_count; ++i)
        tiles += trainer->tile_counts[i];
    put_section(writer, "GUES", tiles * sizeof(float));
    for (size_t i = 0; i < trainer->train_view_count; ++i)
        put(writer, trainer->depth_guesses[i], trainer->tile_counts[i] * sizeof(float));
    put_section(writer, "ORDR", trainer->train_view_count * sizeof(uint32_t));
    put(writer, trainer->order, trainer->train_view_count * sizeof(uint32_t));
}

sgs_status sgs_trainer_save_checkpoint(const sgs_trainer *trainer, const char *path)
{
    sgsi_atomic_file file;
    sgs_status status = sgsi_atomic_open(&file, path);
    if (status)
        return status;
    checkpoint_writer writer = {file.stream, XXH64_createState(), false};
    if (!writer.hash) {
        sgsi_atomic_abort(&file);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: no memory to write it", path);
    }
    XXH64_reset(writer.hash, 0);
    put_state(&writer, trainer);
    const uint64_t digest = XXH64_digest(writer.hash);
    XXH64_freeState(writer.hash);
    if (!writer.failed && fwrite(&digest, sizeof digest, 1, file.stream) != 1)
        writer.failed = true;
    return sgsi_atomic_commit(&file);
}

typedef struct checkpoint_reader {
    const uint8_t *bytes;
    size_t size, at;
    const char *path;
} checkpoint_reader;

// The content of the next section, which must have this tag and size.
static const uint8_t *next_section(checkpoint_reader *reader, const char *tag, size_t bytes)
{
    section_header header;
    if (reader->size - reader->at < sizeof header)
        return NULL;
    memcpy(&header, reader->bytes + reader->at, sizeof header);
    if (memcmp(header.tag, tag, 4) || header.bytes != bytes || reader->size - reader->at - sizeof header < bytes)
        return NULL;
    const uint8_t *content = reader->bytes + reader->at + sizeof header;
    reader->at += sizeof header + bytes;
    return content;
}

static void scatter_rows(float *block, const uint8_t *content, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        float row[SGS_PARAM_COUNT];
        memcpy(row, content + i * sizeof row, sizeof row);
        float *to = block + i / SGS_LANES * SGS_PARAM_COUNT * SGS_LANES + i % SGS_LANES;
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            to[k * SGS_LANES] = row[k];
    }
}

typedef struct checkpoint_content {
    const uint8_t *progress, *model, *m, *v, *statistics, *guesses, *order;
    size_t count, tiles;
} checkpoint_content;

static sgs_status parse(checkpoint_reader *reader, const sgs_trainer *trainer, checkpoint_content *content)
{
    file_header header;
    uint64_t digest;
    if (reader->size < sizeof header + sizeof digest || memcmp(reader->bytes, magic, sizeof magic))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: is not a checkpoint", reader->path);
    memcpy(&header, reader->bytes, sizeof header);
    memcpy(&digest, reader->bytes + reader->size - sizeof digest, sizeof digest);
    if (header.version != VERSION)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: has version %u, this program reads %d", reader->path, header.version, VERSION);
    reader->size -= sizeof digest;
    if (XXH64(reader->bytes, reader->size, 0) != digest)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: the checksum does not match; the file is cut or damaged", reader->path);
    if (header.fingerprint != run_fingerprint(trainer))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: belongs to a run with other options or another scene", reader->path);
    const size_t n = header.count, rows = SGS_PARAM_COUNT * sizeof(float);
    if (n > reader->size / rows)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %zu primitives do not fit into the file", reader->path, n);
    reader->at = sizeof header;
    content->count = n;
    for (size_t i = 0; i < trainer->train_view_count; ++i)
        content->tiles += trainer->tile_counts[i];
    content->progress = next_section(reader, "PROG", sizeof(sgsi_progress));
    content->model = next_section(reader, "MODL", n * rows);
    content->m = next_section(reader, "MOM1", n * rows);
    content->v = next_section(reader, "MOM2", n * rows);
    content->statistics = next_section(reader, "STAT", n * 16);
    content->guesses = next_section(reader, "GUES", content->tiles * sizeof(float));
    content->order = next_section(reader, "ORDR", trainer->train_view_count * sizeof(uint32_t));
    if (!content->progress || !content->model || !content->m || !content->v || !content->statistics || !content->guesses || !content->order)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: byte %zu: a section is missing or has another size", reader->path, reader->at);
    return SGS_STATUS_OK;
}

static sgs_status restore(sgs_trainer *trainer, const checkpoint_content *content, const char *path)
{
    const size_t n = content->count;
    sgs_gaussians *model;
    sgs_status status = sgs_gaussians_create(n + SGS_LANES, &model);
    if (!status)
        status = sgs_gaussians_resize(model, n);
    if (status)
        return status;
    float *m = sgsi_calloc(model->capacity, SGS_PARAM_COUNT * sizeof(float));
    float *v = sgsi_calloc(model->capacity, SGS_PARAM_COUNT * sizeof(float));
    if (!m || !v || sgsi_statistics_reserve(&trainer->statistics, model->capacity)) {
        sgsi_free(m);
        sgsi_free(v);
        sgs_gaussians_destroy(model);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: no memory for its %zu primitives", path, n);
    }
    scatter_rows(model->data, content->model, n);
    scatter_rows(m, content->m, n);
    scatter_rows(v, content->v, n);
    model->sh_degree = trainer->options.sh_degree;
    sgs_gaussians_destroy(trainer->model);
    sgsi_free(trainer->m);
    sgsi_free(trainer->v);
    trainer->model = model;
    trainer->m = m;
    trainer->v = v;
    memcpy(trainer->statistics.gradient_sum, content->statistics, n * 4);
    memcpy(trainer->statistics.absolute_sum, content->statistics + n * 4, n * 4);
    memcpy(trainer->statistics.visible_count, content->statistics + n * 8, n * 4);
    memcpy(trainer->statistics.radius_max, content->statistics + n * 12, n * 4);
    const uint8_t *guess = content->guesses;
    for (size_t i = 0; i < trainer->train_view_count; ++i) {
        memcpy(trainer->depth_guesses[i], guess, trainer->tile_counts[i] * sizeof(float));
        guess += trainer->tile_counts[i] * sizeof(float);
    }
    memcpy(trainer->order, content->order, trainer->train_view_count * sizeof(uint32_t));
    memcpy(&trainer->progress, content->progress, sizeof trainer->progress);
    trainer->structure_changed = true;
    return SGS_STATUS_OK;
}

sgs_status sgs_trainer_load_checkpoint(sgs_trainer *trainer, const char *path)
{
    uint8_t *bytes;
    size_t size;
    sgs_status status = sgsi_file_read(path, 0, &bytes, &size);
    if (status)
        return status;
    checkpoint_reader reader = {bytes, size, 0, path};
    checkpoint_content content = {0};
    status = parse(&reader, trainer, &content);
    if (!status) {
        sgsi_progress progress;
        memcpy(&progress, content.progress, sizeof progress);
        for (size_t i = 0; !status && i < trainer->train_view_count; ++i) {
            uint32_t view;
            memcpy(&view, content.order + 4 * i, sizeof view);
            if (view >= trainer->train_view_count)
                status = sgsi_fail(SGS_STATUS_FORMAT, "%s: the view order names view %u of %zu", path, view, trainer->train_view_count);
        }
        if (!status && (progress.iteration < 0 || progress.order_position > trainer->train_view_count))
            status = sgsi_fail(SGS_STATUS_FORMAT, "%s: the iteration counter is out of range", path);
    }
    if (!status)
        status = restore(trainer, &content, path);
    sgsi_free(bytes);
    return status;
}
