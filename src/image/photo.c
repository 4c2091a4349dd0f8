// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Decodes, then downscales, then masks, so that masks refer to the photo's own pixels.
//
// 8-bit sRGB photos stay 8-bit. All others become half floats: their 11 bits of precision
// exceed 8-bit sRGB everywhere, and their range is 30 stops. Values are averaged as stored (linear
// files in linear light), divided by the scene's white point if scene-linear, and only then
// encoded. The unit of light therefore does not matter: the same scene times eight has eight times
// the white point and the same values.

#include "image/photo.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "image/half.h"
#include "image/mask.h"
#include "sparegs/image.h"

enum { MAX_SIDE = 65536, MAX_PIXELS = 1 << 30 }; // of a display window

void sgsi_photo_release(sgs_photo *photo)
{
    sgsi_free(photo->pixels);
    sgsi_free(photo->valid_mask);
    sgsi_free(photo->halves);
    photo->pixels = NULL;
    photo->valid_mask = photo->halves = NULL;
}

void sgsi_photo_free(sgs_photo *photo)
{
    sgsi_photo_release(photo);
    *photo = (sgs_photo){0};
}

void sgs_photo_free(sgs_photo *photo)
{
    sgsi_photo_free(photo);
}

// 8-bit samples are kept if their encoding is that of the scene's space.
bool sgsi_photo_is_8bit(const sgsi_image_info *info, sgs_space space)
{
    return info->bytes && !info->linear && space == SGS_SPACE_SRGB;
}

size_t sgsi_photo_bytes(const sgsi_image_info *info, sgs_space space, int width, int height)
{
    const size_t values = (size_t)width * (size_t)height * (size_t)info->channels;
    return values * (sgsi_photo_is_8bit(info, space) ? 1 : 2) +
           sgs_mask_words(width) * (size_t)height * sizeof(uint16_t);
}

size_t sgsi_photo_decode_bytes(const sgsi_image_info *info)
{
    const size_t pixels = (size_t)info->width * (size_t)info->height;
    return pixels * (size_t)info->channels + pixels / 2;
}

typedef struct over_job {
    const sgs_photo *photo;
    const float *background;
    uint8_t *bytes;
} over_job;

static void over_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const over_job *job = context;
    const size_t plane = (size_t)job->photo->width * (size_t)job->photo->height;
    for (size_t c = 0; c < 3; ++c)
        for (size_t i = begin; i < end; ++i) {
            const float value = sgsi_photo_over(job->photo, c, i, job->background);
            job->bytes[c * plane + i] = (uint8_t)(255.0f * fmaxf(fminf(value, 1.0f), 0.0f) + 0.5f);
        }
}

void sgsi_photo_over_bytes(const sgs_photo *photo, const float background[3], uint8_t *bytes)
{
    over_job job = {photo, background, bytes};
    sgsi_parallel_ranges((size_t)photo->width * (size_t)photo->height, 1 << 14, over_range, &job);
}

static sgs_status check_display(const char *path, const sgsi_image_info *info)
{
    if (info->full_width <= MAX_SIDE && info->full_height <= MAX_SIDE &&
        (int64_t)info->full_width * info->full_height <= MAX_PIXELS)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_LIMIT,
                     "%s: its display window of %d x %d pixels exceeds the limit of %d per side "
                     "and 2^30 in total; save the image with equal windows",
                     path, info->full_width, info->full_height, MAX_SIDE);
}

sgs_status sgsi_photo_choose_window(const char *path, const sgsi_image_info *info,
                                    const sgs_camera *camera, bool *display)
{
    const bool whole = info->width == info->full_width && info->height == info->full_height,
               own = camera->width == info->width && camera->height == info->height;
    const double stretch =
        (double)info->full_width * camera->height / ((double)info->full_height * camera->width);
    const bool shown = !camera->width || fabs(stretch - 1) <= 0.02;
    *display = info->is_exr && (whole ? info->left || info->top : !own && shown);
    if (!info->is_exr && !whole && !own && shown)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: has %d x %d pixels of a picture of %d x %d, whose camera is given; "
                         "save the whole picture, or remove the size of the picture from the file",
                         path, info->width, info->height, info->full_width, info->full_height);
    return *display ? check_display(path, info) : SGS_STATUS_OK;
}

sgsi_image_info sgsi_photo_display(const sgsi_image_info *file)
{
    sgsi_image_info info = *file;
    info.width = file->full_width;
    info.height = file->full_height;
    const bool covered = file->left <= 0 && file->top <= 0 &&
                         file->left + file->width >= file->full_width &&
                         file->top + file->height >= file->full_height;
    info.channels = covered ? file->channels : 4; // transparent where there is no data
    return info;
}

// Call sgsi_image_check_complete before.
static sgs_status read_pixels(const sgsi_photo_source *source, sgs_image8 *image)
{
    sgs_status status = sgsi_oiio_read(source->image_path, false, image);
    if (status || (source->width == image->width && source->height == image->height))
        return status;
    sgs_image8 reduced;
    status = sgs_image8_downscale(image, source->width, source->height, &reduced);
    sgs_image8_free(image);
    *image = reduced;
    return status;
}

// ---- Float photos: area averages row by row, without a full-size float image ----

typedef struct reducer {
    const sgsi_photo_source *source;
    const sgsi_image_info *info;
    sgs_photo *photo;
    // [width * channels]: a source row downscaled horizontally; the output row being accumulated.
    float *across, *sum;
    size_t broken;
    sgs_status status;
} reducer;

// Overlap of source cell i and output cell j, as a fraction of the output cell.
static float overlap(int i, int j, int size, int out_size)
{
    const int64_t a = (int64_t)i * out_size, b = (int64_t)j * size;
    const int64_t begin = a > b ? a : b, end = a + out_size < b + size ? a + out_size : b + size;
    return end > begin ? (float)(end - begin) / (float)size : 0.0f;
}

static void reduce_across(reducer *r, int y, const float *row)
{
    const int width = r->info->width, out_width = r->photo->width, channels = r->info->channels;
    memset(r->across, 0, (size_t)out_width * (size_t)channels * sizeof *r->across);
    for (int x = 0; x < width; ++x) {
        const float *pixel = row + (size_t)x * (size_t)channels;
        float sum = 0.0f;
        for (int c = 0; c < channels; ++c)
            sum += pixel[c] * 0.0f;
        if (sum != 0.0f) { // NaN: a channel is not finite
            ++r->broken;
            if (!r->status)
                r->status = sgsi_mask_begin(r->photo);
            if (!r->status)
                sgsi_mask_drop(r->photo, width, r->info->height, x, y);
            continue;
        }
        const int first = (int)((int64_t)x * out_width / width);
        for (int j = first; j < out_width && (int64_t)j * width < (int64_t)(x + 1) * out_width;
             ++j) {
            const float weight = overlap(x, j, width, out_width);
            float *out = r->across + (size_t)j * (size_t)channels;
            for (int c = 0; c < channels; ++c)
                out[c] += weight * pixel[c];
        }
    }
}

float sgsi_photo_encode(float value, bool linear, sgs_space space, double white_point)
{
    if (linear) {
        value = fmaxf((float)(value / white_point), 0.0f); // outside of the gamut of Rec. 709
        return space == SGS_SPACE_SRGB ? sgs_srgb_encode(value) : value;
    }
    return space == SGS_SPACE_LINEAR ? sgs_srgb_decode(value) : value;
}

// Converts a value from the file's encoding to the photo's.
static float convert_value(const reducer *r, float value)
{
    const bool display = r->info->linear && !r->info->scene_linear; // with other primaries
    const double white = r->info->scene_linear ? r->source->white_point : 1;
    const float v = sgsi_photo_encode(value, r->info->linear, r->source->space, white);
    return display ? fminf(v, 1.0f) : v; // outside of the gamut of Rec. 709
}

static void finish_row(const reducer *r, int j)
{
    const size_t width = (size_t)r->photo->width, plane = width * (size_t)r->photo->height;
    const int channels = r->info->channels;
    for (size_t x = 0; x < width; ++x) {
        const float *in = r->sum + x * (size_t)channels;
        uint16_t *out = r->photo->halves + (size_t)j * width + x;
        const float alpha = channels == 4 ? in[3] : 1.0f;
        for (size_t c = 0; c < 3; ++c)
            out[c * plane] =
                sgsi_half_from_float(convert_value(r, alpha > 0.0f ? in[c] / alpha : 0.0f));
        if (channels == 4)
            out[3 * plane] = sgsi_half_from_float(alpha < 1.0f ? alpha : 1.0f);
    }
}

static void take_row(void *context, int y, const float *row)
{
    reducer *r = context;
    const int height = r->info->height, out_height = r->photo->height;
    const size_t floats = (size_t)r->photo->width * (size_t)r->info->channels;
    reduce_across(r, y, row);
    const int first = (int)((int64_t)y * out_height / height);
    for (int j = first; j < out_height && (int64_t)j * height < (int64_t)(y + 1) * out_height;
         ++j) {
        const float weight = overlap(y, j, height, out_height);
        if ((int64_t)y * out_height <= (int64_t)j * height)
            memset(r->sum, 0, floats * sizeof *r->sum); // first source row of this output row
        for (size_t i = 0; i < floats; ++i)
            r->sum[i] += weight * r->across[i];
        if ((int64_t)(y + 1) * out_height >= (int64_t)(j + 1) * height)
            finish_row(r, j);
    }
}

// The part [begin, end) of a data window of `size` pixels at `offset` that lies in the display
// window [0, shown).
static void shown_range(int offset, int size, int shown, int *begin, int *end)
{
    const int64_t low = offset < 0 ? -(int64_t)offset : 0, high = (int64_t)shown - offset;
    *begin = (int)(low < size ? low : size);
    *end = (int)(high < size ? high : size);
}

// Places the rows of a data window in the display window.
typedef struct placer {
    reducer *reducer;
    const sgsi_image_info *file;
    float *row; // [width of the display window][channels of the photo]
    int next;   // row of the display window
} placer;

// Rows outside of the data window, up to `end`.
static void take_empty_rows(placer *p, int end)
{
    const size_t channels = (size_t)p->reducer->info->channels;
    if (p->next < end)
        memset(p->row, 0, channels * (size_t)p->file->full_width * sizeof *p->row);
    for (; p->next < end; ++p->next)
        take_row(p->reducer, p->next, p->row);
}

static void place_row(void *context, int y, const float *row)
{
    placer *p = context;
    const sgsi_image_info *file = p->file;
    const int64_t at = (int64_t)y + file->top;
    const int channels = p->reducer->info->channels;
    if (at < 0 || at >= file->full_height)
        return;
    take_empty_rows(p, (int)at);
    memset(p->row, 0, (size_t)channels * (size_t)file->full_width * sizeof *p->row);
    int begin, end;
    shown_range(file->left, file->width, file->full_width, &begin, &end);
    for (int x = begin; x < end; ++x) {
        const float *in = row + (size_t)x * (size_t)file->channels;
        float *out = p->row + (size_t)channels * (size_t)(x + file->left);
        memcpy(out, in, 3 * sizeof *out);
        if (channels == 4)
            out[3] = file->channels == 4 ? in[3] : 1.0f;
    }
    take_row(p->reducer, (int)at, p->row);
    p->next = (int)at + 1;
}

static sgs_status read_display(reducer *r, const sgsi_image_info *file)
{
    placer p = {.reducer = r, .file = file};
    p.row = sgsi_alloc(4 * (size_t)file->full_width, sizeof *p.row);
    if (!p.row)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for the image",
                         r->source->image_path);
    const sgs_status status =
        sgsi_oiio_read_rows(r->source->image_path, r->source->colorspace, place_row, &p);
    if (!status)
        take_empty_rows(&p, file->full_height);
    sgsi_free(p.row);
    return status;
}

static sgs_status read_floats(const sgsi_photo_source *source, const sgsi_image_info *file,
                              sgs_photo *photo, size_t *broken)
{
    const sgsi_image_info shown = sgsi_photo_display(file),
                          *info = source->display_window ? &shown : file;
    *photo = (sgs_photo){.width = source->width,
                         .height = source->height,
                         .channels = info->channels,
                         .is_hdr = info->scene_linear};
    const size_t row = (size_t)photo->width * (size_t)info->channels;
    reducer r = {.source = source, .info = info, .photo = photo};
    photo->halves = sgsi_alloc(row * (size_t)photo->height, sizeof *photo->halves);
    r.across = sgsi_alloc(2 * row, sizeof *r.across);
    sgs_status status = SGS_STATUS_OK;
    if (!photo->halves || !r.across) {
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for the image",
                           source->image_path);
    } else {
        r.sum = r.across + row;
        status = source->display_window
                     ? read_display(&r, file)
                     : sgsi_oiio_read_rows(source->image_path, source->colorspace, take_row, &r);
    }
    sgsi_free(r.across);
    *broken = r.broken;
    return status ? status : r.status;
}

// ---- Loading ----

static float alpha_at(const sgs_photo *photo, size_t at)
{
    return photo->pixels ? (float)photo->pixels[at] / 255.0f
                         : sgsi_half_to_float(photo->halves[at]);
}

// Uses the alpha channel as a mask. Its plane is the last one and remains allocated but unused.
static sgs_status mask_by_alpha(sgs_photo *photo)
{
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    const sgs_status status = sgsi_mask_begin(photo);
    for (size_t at = 0; !status && at < plane; ++at)
        if (alpha_at(photo, 3 * plane + at) < 0.5f)
            sgsi_mask_drop(photo, photo->width, photo->height, (int)(at % (size_t)photo->width),
                           (int)(at / (size_t)photo->width));
    return status;
}

sgs_status sgsi_photo_use_alpha(sgs_photo *photo, sgs_alpha alpha)
{
    sgs_status status = SGS_STATUS_OK;
    if (photo->channels == 4 && alpha == SGS_ALPHA_MASK)
        status = mask_by_alpha(photo);
    if (photo->channels == 4 && alpha != SGS_ALPHA_OVER)
        photo->channels = 3;
    return status;
}

static sgs_status read_photo(const sgsi_photo_source *source, sgs_photo *photo, size_t *broken)
{
    sgsi_image_info info;
    sgs_image8 image;
    sgs_status status = sgsi_image_check_complete(source->image_path, true);
    if (!status)
        status = sgsi_oiio_describe(source->image_path, source->colorspace, &info);
    if (!status && source->display_window)
        status = check_display(source->image_path, &info);
    if (status)
        return status;
    const int width = source->display_window ? info.full_width : info.width,
              height = source->display_window ? info.full_height : info.height;
    if (width < source->width || height < source->height)
        status = sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: now has %d x %d pixels, fewer than the required %d x %d; was the file replaced?",
            source->image_path, width, height, source->width, source->height);
    if (status)
        return status;
    if (!sgsi_photo_is_8bit(&info, source->space))
        return read_floats(source, &info, photo, broken);
    status = read_pixels(source, &image);
    if (!status)
        *photo = (sgs_photo){.width = image.width,
                             .height = image.height,
                             .channels = image.channels,
                             .pixels = image.pixels};
    return status;
}

static sgs_status load(const sgsi_photo_source *source, sgs_photo *photo, sgsi_photo_report *report)
{
    sgs_status status = read_photo(source, photo, &report->pixels_nonfinite);
    if (!status)
        status = sgsi_photo_use_alpha(photo, source->alpha);
    if (!status && source->mask_path) {
        const sgsi_mask_file mask = {source->mask_path,   source->image_path,
                                     source->file_width,  source->file_height,
                                     source->invert_mask, source->dynamic_mask};
        status = sgsi_mask_apply_file(photo, &mask, &report->mask);
        report->mask_failed = status != SGS_STATUS_OK;
    }
    if (!status)
        status = sgsi_mask_intersect(photo, source->lens);
    if (status)
        sgsi_photo_free(photo);
    else
        sgsi_mask_finish(photo);
    return status;
}

sgs_status sgsi_photo_load(const sgsi_photo_source *source, sgs_photo *photo,
                           sgsi_photo_report *report)
{
    *photo = (sgs_photo){0};
    *report = (sgsi_photo_report){0};
    sgsi_decode_begin(source->decode_limit, source->decode_bytes);
    const sgs_status status = load(source, photo, report);
    sgsi_decode_end(source->decode_limit, source->decode_bytes);
    return status;
}

// ---- Luminance ----

typedef struct light_rows {
    sgsi_light *light;
    int channels, left, right, top, bottom; // ends exclusive
} light_rows;

void sgsi_light_add_value(sgsi_light *light, float brightest)
{
    if (!(brightest > 0.0f) || !isfinite(brightest))
        return;
    const double bin = floor(SGSI_LIGHT_OCTAVE * (log2((double)brightest) - SGSI_LIGHT_LOW));
    ++light->bins[(size_t)fmin(fmax(bin, 0), SGSI_LIGHT_BINS - 1)];
}

static void light_row(void *context, int y, const float *row)
{
    const light_rows *rows = context;
    if (y < rows->top || y >= rows->bottom)
        return;
    for (int x = rows->left; x < rows->right; ++x) {
        const float *pixel = row + (size_t)x * (size_t)rows->channels;
        const float brightest = fmaxf(pixel[0], fmaxf(pixel[1], pixel[2]));
        sgsi_light_add_value(rows->light, brightest);
    }
}

sgs_status sgsi_light_add(sgsi_light *light, const char *path, const char *colorspace,
                          bool display_window)
{
    sgsi_image_info info;
    const sgs_status status = sgsi_oiio_describe(path, colorspace, &info);
    if (status)
        return status;
    light_rows rows = {light, info.channels, 0, info.width, 0, info.height};
    if (display_window) {
        shown_range(info.left, info.width, info.full_width, &rows.left, &rows.right);
        shown_range(info.top, info.height, info.full_height, &rows.top, &rows.bottom);
    }
    return sgsi_oiio_read_rows(path, colorspace, light_row, &rows);
}

double sgsi_light_quantile(const sgsi_light *light, double share)
{
    uint64_t total = 0, passed = 0;
    for (int i = 0; i < SGSI_LIGHT_BINS; ++i)
        total += light->bins[i];
    for (int i = 0; i < SGSI_LIGHT_BINS && total; ++i) {
        passed += light->bins[i];
        if ((double)passed >= share * (double)total)
            return exp2((double)(i + 1) / SGSI_LIGHT_OCTAVE + SGSI_LIGHT_LOW); // upper edge
    }
    return 1.0;
}
