// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Self-Organizing Gaussians (Morgenstern et al. 2024) for a trained model: primitives are sorted
// into a square grid (plas.h), every attribute becomes an image of integers, which lossless image
// codecs store. Limits follow the released experiment jxl_quant_sh. Its depths are 14, 5, 6, 6 and
// 6 bits for positions, upper bands, scales, rotations and opacities; those of the presets were
// chosen to give the sizes in the tables of SPARE-GS.
//
// The side of the grid is int(sqrt(N)); the primitives of lowest opacity beyond it are dropped. A
// value v with q bits is round((v - low) / (high - low) 2^q), so there are 2^q + 1 levels.
// Positions are sign(x) ln(1 + |x|) before. Decoders compute with portable_math.h.
//
// The published x has its origin at 0, where the cells are smallest. Far from there, they are
// larger than the primitives: 1.5 units at 3000. Layout 2 stores another origin, the median of the
// positions, if this halves the geometric mean of the cells, and 0 otherwise; layout 1 has none.
//
// Differences from the released code: rotations are unit quaternions with w >= 0; SH band 0 is
// quantised and stored losslessly; low and high of SH, rotations and opacities are the limits that
// the released code clips to, not the least and largest value of the model. So an outlier does not
// make the steps coarser, and 0, which most SH coefficients are close to, is a level of the bands
// above 0: at 13 bytes per primitive, levels beside 0 cost almost 1 dB.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/compare.h"
#include "base/threads.h"
#include "compress/compress_method.h"
#include "compress/image_codec.h"
#include "compress/plas.h"
#include "compress/portable_math.h"

enum { ATTRIBUTES = 6, MEANS = 0, DC, REST, SCALE, ROTATION, OPACITY, MAX_IMAGES = 24 };
static const double IMPROVEMENT_BREAK = 1e-4;
static const float MIN_LOG_SCALE = -104.0f; // exp(-104) is 0 in single precision

// Attributes: limits, or the range of the data (low = high).
static const struct {
    const char *name;
    int param;
    float low, high;
} attributes[ATTRIBUTES] = {
    {"mean", SGS_PARAM_MEAN, 0, 0},          {"sh_dc", SGS_PARAM_SH_DC, -2, 4},
    {"sh_rest", SGS_PARAM_SH_REST, -1, 1},   {"scale", SGS_PARAM_SCALE, 0, 0},
    {"rotation", SGS_PARAM_ROTATION, -1, 2}, {"opacity", SGS_PARAM_OPACITY, -6, 12}};

static int channels_of(int attribute, int sh_degree)
{
    static const int counts[ATTRIBUTES] = {3, 3, 0, 3, 4, 1};
    return attribute == REST ? 3 * sgsi_sh_rest_count(sh_degree) : counts[attribute];
}

// Quantiser of an attribute; stored as it is.
typedef struct sog_range {
    float low, high;
    uint32_t bits;
} sog_range;

typedef struct sog_header {
    uint32_t side, codec;
    sog_range ranges[ATTRIBUTES];
    float origin[3]; // of the positions; since layout 2
} sog_header;
_Static_assert(sizeof(sog_header) == 92, "the section 'grid' has no padding");
enum { LAYOUT = 2, FIRST_LAYOUT = 1, FIRST_HEADER_BYTES = offsetof(sog_header, origin) };

// One image of the file: up to three channels of an attribute.
typedef struct sog_image {
    char name[SGSI_CONTAINER_NAME + 1];
    int attribute, param; // first parameter
    sgsi_image16 image;
    uint8_t *bytes; // encoder: from malloc
    const uint8_t *stored;
    size_t size;
    sgs_status status; // of the encoder
    bool done;         // by the decoder
} sog_image;

// The images of a model, without pixels.
static int list_images(const sog_header *header, int sh_degree, sog_image images[MAX_IMAGES])
{
    int count = 0;
    for (int a = 0; a < ATTRIBUTES; ++a)
        for (int c = 0, total = channels_of(a, sh_degree); c < total;) {
            const int channels = total - c >= 3 ? 3 : 1;
            sog_image *image = &images[count++];
            *image = (sog_image){.attribute = a,
                                 .param = attributes[a].param + c,
                                 .image = {.width = (int)header->side,
                                           .height = (int)header->side,
                                           .channels = channels,
                                           .wide = header->ranges[a].bits > 7}};
            snprintf(image->name, sizeof image->name, "%s_%d", attributes[a].name, c / 3);
            c += channels;
        }
    return count;
}

static bool allocate_pixels(sog_image *image)
{
    const size_t side = (size_t)image->image.width;
    image->image.pixels = sgsi_alloc(side * side, (size_t)image->image.channels * sizeof(uint16_t));
    return image->image.pixels != NULL;
}

static void free_images(sog_image *images, int count)
{
    for (int k = 0; k < count; ++k) {
        sgsi_free(images[k].image.pixels);
        free(images[k].bytes);
    }
}

// ---- Encoding ----

static float contracted(float x, float origin)
{
    const double offset = (double)x - (double)origin;
    return (float)copysign(log1p(fabs(offset)), offset);
}

// Mean logarithm of the cells, whose size is proportional to the range times 1 + |x|.
static double mean_log_cell(const sgsi_compress_job *job, const float origin[3])
{
    double sum = 0, low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < job->count; ++i)
        for (size_t k = 0; k < 3; ++k) {
            const double v = (double)contracted(job->rows[i * SGS_PARAM_COUNT + k], origin[k]);
            sum += fabs(v);
            low = fmin(low, v);
            high = fmax(high, v);
        }
    return sum / (3 * (double)job->count) + log(high - low);
}

static sgs_status choose_origin(const sgsi_compress_job *job, float origin[3])
{
    static const float published[3] = {0, 0, 0};
    float *values = sgsi_alloc(job->count, sizeof *values);
    if (!values)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                         job->count);
    for (size_t k = 0; k < 3; ++k) {
        for (size_t i = 0; i < job->count; ++i)
            values[i] = job->rows[i * SGS_PARAM_COUNT + k];
        qsort(values, job->count, sizeof *values, sgsi_compare_floats);
        origin[k] = values[job->count / 2];
    }
    sgsi_free(values);
    if (!(mean_log_cell(job, origin) < mean_log_cell(job, published) - log(2)))
        memcpy(origin, published, sizeof published);
    return SGS_STATUS_OK;
}

// Positions in the log domain, unit quaternions with w >= 0. A scale below the least float is one
// of 0; its logarithm has no limit, but would take the range of all others.
static void prepare_rows(sgsi_compress_job *job, const float origin[3])
{
    for (size_t i = 0; i < job->count; ++i) {
        float *row = job->rows + i * SGS_PARAM_COUNT, *q = row + SGS_PARAM_ROTATION;
        for (int k = 0; k < 3; ++k) {
            row[k] = contracted(row[k], origin[k]);
            row[SGS_PARAM_SCALE + k] = fmaxf(row[SGS_PARAM_SCALE + k], MIN_LOG_SCALE);
        }
        double length = 0;
        for (int k = 0; k < 4; ++k)
            length += (double)q[k] * q[k];
        length = length > 0 ? (q[0] < 0 ? -1 : 1) / sqrt(length) : 0;
        for (int k = 0; k < 4; ++k)
            q[k] = (float)(q[k] * length);
    }
}

typedef struct opacity_key {
    float opacity;
    uint32_t row;
} opacity_key;

static int by_opacity(const void *a, const void *b)
{
    const opacity_key *x = a, *y = b;
    return x->opacity != y->opacity ? (x->opacity < y->opacity) - (x->opacity > y->opacity)
                                    : (x->row > y->row) - (x->row < y->row);
}

// The rows of the `count` highest opacities.
static sgs_status choose_rows(const sgsi_compress_job *job, size_t count, uint32_t *chosen)
{
    opacity_key *keys = sgsi_alloc(job->count, sizeof *keys);
    if (!keys)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                         job->count);
    for (size_t i = 0; i < job->count; ++i)
        keys[i] = (opacity_key){job->rows[i * SGS_PARAM_COUNT + SGS_PARAM_OPACITY], (uint32_t)i};
    qsort(keys, job->count, sizeof *keys, by_opacity);
    for (size_t i = 0; i < count; ++i)
        chosen[i] = keys[i].row;
    sgsi_free(keys);
    return SGS_STATUS_OK;
}

// Features: positions from the origin, band 0 and activated scales, each block with mean 0 and
// deviation 1. As in the release, positions are not contracted.
static void fill_features(const sgsi_compress_job *job, const float origin[3],
                          const uint32_t *chosen, size_t count, float *features)
{
    static const int params[3] = {SGS_PARAM_MEAN, SGS_PARAM_SH_DC, SGS_PARAM_SCALE};
    for (int block = 0; block < 3; ++block) {
        double sum = 0, squares = 0;
        for (size_t i = 0; i < count; ++i)
            for (int k = 0; k < 3; ++k) {
                const double v = (double)job->rows[chosen[i] * (size_t)SGS_PARAM_COUNT +
                                                   (size_t)params[block] + (size_t)k];
                const double x = params[block] == SGS_PARAM_SCALE  ? exp(v)
                                 : params[block] == SGS_PARAM_MEAN ? v - (double)origin[k]
                                                                   : v;
                features[i * SGSI_PLAS_CHANNELS + (size_t)(3 * block + k)] = (float)x;
                sum += x;
                squares += x * x;
            }
        const double mean = sum / (double)(3 * count);
        const double variance = squares / (double)(3 * count) - mean * mean;
        const double factor = variance > 0 ? 1 / sqrt(variance) : 0;
        for (size_t i = 0; i < count; ++i)
            for (int k = 0; k < 3; ++k) {
                float *f = &features[i * SGSI_PLAS_CHANNELS + (size_t)(3 * block + k)];
                *f = (float)(((double)*f - mean) * factor);
            }
    }
}

static bool sorting_progress(void *user, size_t done, size_t total)
{
    return !sgsi_compress_progress(user, "sorting", done, total);
}

// cells: [side * side] the row at each cell. Rows are those of the model.
static sgs_status sort_rows(sgsi_compress_job *job, const float origin[3], size_t side,
                            uint32_t *cells)
{
    const size_t count = side * side;
    uint32_t *chosen = sgsi_alloc(count, sizeof *chosen);
    float *features = sgsi_calloc(count, SGSI_PLAS_CHANNELS * sizeof *features);
    sgs_status status = SGS_STATUS_OK;
    if (!chosen || !features)
        status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to sort %zu primitives", count);
    if (!status)
        status = choose_rows(job, count, chosen);
    if (!status) {
        fill_features(job, origin, chosen, count, features);
        sgsi_plas plas = {.side = (int)side,
                          .features = features,
                          .order = cells,
                          .seed = job->options->seed,
                          .improvement_break = IMPROVEMENT_BREAK,
                          .progress = sorting_progress,
                          .progress_user = job};
        status = sgsi_plas_sort(&plas);
    }
    for (size_t i = 0; !status && i < count; ++i)
        cells[i] = chosen[cells[i]];
    sgsi_free(chosen);
    sgsi_free(features);
    return status;
}

static void set_ranges(const sgsi_compress_job *job, const uint32_t *cells, sog_header *header)
{
    const sgs_compress_options *o = job->options;
    const int bits[ATTRIBUTES] = {o->position_bits, o->dc_bits,       o->sh_bits,
                                  o->scale_bits,    o->rotation_bits, o->opacity_bits};
    for (int a = 0; a < ATTRIBUTES; ++a) {
        sog_range *range = &header->ranges[a];
        *range = (sog_range){attributes[a].low, attributes[a].high, (uint32_t)bits[a]};
        // The published limits are those of colours from 0 to 1. Linear light has highlights.
        const bool bright = channels_of(a, job->sh_degree) && (a == DC || a == REST) &&
                            o->colors.space_known && o->colors.space == SGS_SPACE_LINEAR;
        if (range->low != range->high && !bright)
            continue;
        range->low = INFINITY;
        range->high = -INFINITY;
        for (size_t i = 0; i < (size_t)header->side * header->side; ++i)
            for (int k = 0; k < channels_of(a, job->sh_degree); ++k) {
                const float v = job->rows[cells[i] * (size_t)SGS_PARAM_COUNT +
                                          (size_t)(attributes[a].param + k)];
                range->low = v < range->low ? v : range->low;
                range->high = v > range->high ? v : range->high;
            }
    }
}

typedef struct sog_encoding {
    const sgsi_compress_job *job;
    const sog_header *header;
    const uint32_t *cells;
    sog_image *images;
} sog_encoding;

static void encode_image(void *context, size_t k, int thread)
{
    (void)thread;
    const sog_encoding *encoding = context;
    sog_image *image = &encoding->images[k];
    const sog_range *range = &encoding->header->ranges[image->attribute];
    const double levels = (double)(1u << range->bits);
    const double span = (double)range->high - range->low;
    const size_t channels = (size_t)image->image.channels;
    image->status = allocate_pixels(image) ? SGS_STATUS_OK : SGS_STATUS_OUT_OF_MEMORY;
    if (image->status)
        return;
    for (size_t i = 0; i < (size_t)encoding->header->side * encoding->header->side; ++i)
        for (size_t c = 0; c < channels; ++c) {
            const double v =
                (double)encoding->job
                    ->rows[encoding->cells[i] * (size_t)SGS_PARAM_COUNT + (size_t)image->param + c];
            const double level = span > 0 ? floor((v - range->low) / span * levels + 0.5) : 0;
            image->image.pixels[i * channels + c] =
                (uint16_t)(level > 0 ? (level < levels ? level : levels) : 0);
        }
    image->status = sgsi_image_encode((sgs_image_codec)encoding->header->codec, &image->image,
                                      &image->bytes, &image->size);
    sgsi_free(image->image.pixels);
    image->image.pixels = NULL;
}

static sgs_status encode_images(const sgsi_compress_job *job, const sog_header *header,
                                const uint32_t *cells)
{
    sog_image images[MAX_IMAGES];
    sog_encoding encoding = {job, header, cells, images};
    const int count = list_images(header, job->sh_degree, images);
    const int portion = sgsi_threads();
    sgs_status status = SGS_STATUS_OK;
    for (int done = 0; done < count && !status; done += portion) {
        status = sgsi_compress_progress(job, "encoding images", (size_t)done, (size_t)count);
        encoding.images = images + done;
        if (!status)
            sgsi_parallel_for((size_t)(count - done < portion ? count - done : portion), 1,
                              encode_image, &encoding);
    }
    for (int k = 0; k < count && !status; ++k) {
        if (images[k].status == SGS_STATUS_OUT_OF_MEMORY)
            status = sgsi_fail(images[k].status, "not enough memory to encode image '%s'",
                               images[k].name);
        else if (images[k].status)
            status = sgsi_fail(images[k].status,
                               "image '%s' of %u x %u pixels: the encoder failed; choose another "
                               "codec with option codec",
                               images[k].name, header->side, header->side);
        else
            sgsi_packer_add(job->out, images[k].name, images[k].bytes, images[k].size, false);
    }
    free_images(images, count);
    return status ? status : job->out->status;
}

static void defaults(sgs_compress_options *options)
{
    // mean, band 0, other bands, scale, rotation, opacity
    static const int bits[3][ATTRIBUTES] = {
        {14, 10, 5, 7, 6, 7}, {14, 7, 5, 5, 5, 5}, {14, 7, 4, 6, 6, 6}};
    int *const fields[ATTRIBUTES] = {&options->position_bits, &options->dc_bits,
                                     &options->sh_bits,       &options->scale_bits,
                                     &options->rotation_bits, &options->opacity_bits};
    for (int a = 0; a < ATTRIBUTES; ++a)
        if (!*fields[a])
            *fields[a] = bits[options->preset - 1][a];
}

static sgs_status encode(sgsi_compress_job *job)
{
    size_t side = (size_t)sqrt((double)job->count);
    side += (side + 1) * (side + 1) <= job->count;
    if (!sgsi_image_fits(job->options->codec, side))
        return sgsi_fail(SGS_STATUS_LIMIT, "%zu primitives are too many for an image of the codec",
                         job->count);
    sog_header header = {.side = (uint32_t)side, .codec = (uint32_t)job->options->codec};
    uint32_t *cells = sgsi_alloc(side * side, sizeof *cells);
    if (!cells)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                         job->count);
    sgs_status status = choose_origin(job, header.origin);
    if (!status)
        status = sort_rows(job, header.origin, side, cells);
    if (!status) {
        prepare_rows(job, header.origin);
        set_ranges(job, cells, &header);
        const sog_range *means = &header.ranges[MEANS];
        sgsi_warn_about_log_cells(
            job, ldexp((double)means->high - (double)means->low, -(int)means->bits));
        job->out->header.count = side * side;
        sgsi_packer_add(job->out, "grid", &header, sizeof header, false);
        status = encode_images(job, &header, cells);
    }
    sgsi_free(cells);
    return status;
}

// ---- Decoding ----

static sgs_status read_header(sgsi_container *in, sog_header *header)
{
    const size_t size = in->header.version == FIRST_LAYOUT ? FIRST_HEADER_BYTES : sizeof *header;
    const uint8_t *bytes;
    const sgs_status status = sgsi_container_take(in, "grid", (int64_t)size, &bytes, NULL);
    if (status)
        return status;
    *header = (sog_header){0};
    memcpy(header, bytes, size);
    if ((uint64_t)header->side * header->side != in->header.count)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section 'grid': side %u is not that of %llu cells",
                         in->path, header->side, (unsigned long long)in->header.count);
    if (header->codec > SGS_IMAGE_CODEC_EXR)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: section 'grid': unknown image codec %u",
                         in->path, header->codec);
    if (!sgsi_image_fits((sgs_image_codec)header->codec, header->side))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section 'grid': side %u is too large", in->path,
                         header->side);
    for (int a = 0; a < ATTRIBUTES; ++a) {
        const sog_range *range = &header->ranges[a];
        if (!(fabsf(range->low) < 1e6f && fabsf(range->high) < 1e6f) || range->bits < 1 ||
            range->bits > SGSI_SOG_MAX_BITS)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: section 'grid': invalid range of '%s'",
                             in->path, attributes[a].name);
    }
    for (int k = 0; k < 3; ++k)
        if (!isfinite(header->origin[k]))
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: section 'grid': the origin is not finite",
                             in->path);
    return SGS_STATUS_OK;
}

typedef struct sog_decoding {
    sog_image *images;
    sgs_image_codec codec;
} sog_decoding;

static void decode_image(void *context, size_t k, int thread)
{
    (void)thread;
    const sog_decoding *decoding = context;
    sog_image *image = &decoding->images[k];
    image->done = allocate_pixels(image) &&
                  sgsi_image_decode(decoding->codec, image->stored, image->size, &image->image);
}

static void apply_image(const sog_image *image, const sog_header *header, sgs_gaussians *model)
{
    const sog_range *range = &header->ranges[image->attribute];
    const double step = ((double)range->high - range->low) / (double)(1u << range->bits);
    for (size_t i = 0; i < model->count; ++i)
        for (int c = 0; c < image->image.channels; ++c) {
            const uint16_t level =
                image->image.pixels[i * (size_t)image->image.channels + (size_t)c];
            double v = (double)range->low + (double)level * step;
            if (image->attribute == MEANS)
                v = (v < 0 ? -sgsi_portable_expm1(-v) : sgsi_portable_expm1(v)) +
                    (double)header->origin[c];
            *sgs_gaussians_at(model, i, image->param + c) = (float)v;
        }
}

static sgs_status decode_images(sgsi_container *in, const sog_header *header, sog_image *images,
                                int count)
{
    sgs_status status = SGS_STATUS_OK;
    for (int k = 0; k < count && !status; ++k)
        status = sgsi_container_take(in, images[k].name, SGSI_ANY_SIZE, &images[k].stored,
                                     &images[k].size);
    if (!status)
        status = sgsi_container_finish(in);
    if (status)
        return status;
    sog_decoding decoding = {images, (sgs_image_codec)header->codec};
    sgsi_parallel_for((size_t)count, 1, decode_image, &decoding);
    for (int k = 0; k < count; ++k)
        if (!images[k].done)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: section '%s' is not an image of %u x %u pixels with %d channels",
                             in->path, images[k].name, header->side, header->side,
                             images[k].image.channels);
    return SGS_STATUS_OK;
}

static sgs_status decode(sgsi_container *in, sgs_gaussians **model)
{
    sog_header header;
    sog_image images[MAX_IMAGES];
    sgs_status status = read_header(in, &header);
    if (status)
        return status;
    const int count = list_images(&header, (int)in->header.sh_degree, images);
    status = decode_images(in, &header, images, count);
    if (!status)
        status = sgsi_decoded_create(in, model);
    for (int k = 0; k < count && !status; ++k)
        apply_image(&images[k], &header, *model);
    free_images(images, count);
    return status;
}

const sgsi_compress_method sgsi_method_sog = {.name = "sog",
                                              .version = LAYOUT,
                                              .oldest = FIRST_LAYOUT,
                                              .defaults = defaults,
                                              .encode = encode,
                                              .decode = decode};
