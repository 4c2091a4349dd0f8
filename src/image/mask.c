// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A pixel is either valid or not. A partly masked pixel would still show part of what the mask
// hides, so a pixel of a downscaled photo is valid only if all source pixels it overlaps are.

#include "image/mask.h"

#include <dirent.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "base/base_name.h"
#include "base/core.h"
#include "image/image_oiio.h"
#include "sparegs/image.h"
#include "base/threads.h"

static const char suffix[] = "_mask.png", dynamic_prefix[] = "dynamic_mask_",
                  dynamic_end[] = ".png";

static bool ends_with(const char *name, const char *tail)
{
    const size_t length = strlen(name), end = strlen(tail);
    return length > end && !strcmp(name + length - end, tail);
}

bool sgs_mask_is_name(const char *name)
{
    const char *base = sgsi_base_name(name);
    const size_t prefix = sizeof dynamic_prefix - 1;
    return ends_with(base, suffix) ||
           (!strncmp(base, dynamic_prefix, prefix) && ends_with(base + prefix, dynamic_end));
}

// Uses `candidate` if the file exists and *path is NULL. Takes ownership; NULL: out of memory.
static sgs_status use_if_file(char *candidate, char **path)
{
    bool found = false;
    if (!candidate)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to search for masks");
    const sgs_status status = *path ? SGS_STATUS_OK : sgsi_find_file(candidate, &found);
    if (found)
        *path = candidate;
    else
        sgsi_free(candidate);
    return status;
}

static bool same_file(const char *a, const char *b)
{
    struct stat x, y;
    return !stat(a, &x) && !stat(b, &y) && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

// In the order of the search.
enum { EXTENSIONS = 10, ALL_EXTENSIONS = (1 << EXTENSIONS) - 1, MAX_DEPTH = 8 };
static const char *const extensions[EXTENSIONS] = {"png",  "PNG", "jpg", "JPG",  "jpeg",
                                                   "JPEG", "tif", "TIF", "tiff", "TIFF"};

static unsigned extensions_below(const char *path, int depth)
{
    unsigned present = 0;
    DIR *folder = opendir(path);
    if (!folder)
        return ALL_EXTENSIONS;
    for (struct dirent *entry; present != ALL_EXTENSIONS && (entry = readdir(folder));) {
        const char *dot = strrchr(entry->d_name, '.');
        for (int i = 0; i < EXTENSIONS && dot; ++i)
            present |= (unsigned)!strcmp(dot + 1, extensions[i]) << i;
        if (entry->d_name[0] == '.' || depth == MAX_DEPTH ||
            (entry->d_type != DT_DIR && entry->d_type != DT_LNK && entry->d_type != DT_UNKNOWN))
            continue;
        char *below = sgsi_format("%s/%s", path, entry->d_name);
        if (below && sgsi_is_folder(below))
            present |= extensions_below(below, depth + 1);
        sgsi_free(below);
    }
    closedir(folder);
    return present;
}

unsigned sgsi_mask_extensions(const char *folder)
{
    return extensions_below(folder, 0) | 1; // png: the search for it reports broken folders
}

// BASE/STEM.png, BASE/NAME.png or, as Metashape exports them, BASE/STEM_mask.png; then the same in
// other formats. The folder may also be that of the photos, which are no masks.
static sgs_status use_named(const char *base, unsigned present, const char *name,
                            const char *image_path, char **path)
{
    const int stem = sgsi_stem_length(name);
    sgs_status status = SGS_STATUS_OK;
    for (int i = 0; i < EXTENSIONS && !*path && !status; ++i) {
        const char *extension = extensions[i];
        if (!(present >> i & 1))
            continue;
        status = use_if_file(sgsi_format("%s/%.*s.%s", base, stem, name, extension), path);
        if (*path && same_file(*path, image_path)) {
            sgsi_free(*path);
            *path = NULL;
        }
        if (!status && !*path)
            status = use_if_file(sgsi_format("%s/%s.%s", base, name, extension), path);
        if (!status && !*path)
            status = use_if_file(sgsi_format("%s/%.*s_mask.%s", base, stem, name, extension), path);
    }
    return status;
}

// STEM_mask.png, or dynamic_mask_STEM.png of instant-ngp.
static sgs_status use_beside(const char *image_path, char **path, bool *dynamic)
{
    const char *base = sgsi_base_name(image_path);
    const int folder = (int)(base - image_path);
    sgs_status status =
        use_if_file(sgsi_format("%.*s%s", sgsi_stem_length(image_path), image_path, suffix), path);
    if (status || *path)
        return status;
    status = use_if_file(sgsi_format("%.*s%s%.*s%s", folder, image_path, dynamic_prefix,
                                     sgsi_stem_length(base), base, dynamic_end),
                         path);
    *dynamic = *path != NULL;
    return status;
}

sgs_status sgsi_mask_find(const sgsi_mask_places *places, const char *image_path, const char *name,
                          size_t skip, char **path, bool *dynamic)
{
    sgs_status status = SGS_STATUS_OK;
    *path = NULL;
    *dynamic = false;
    for (size_t i = 0; i < places->folder_count && !status && !*path; ++i) {
        const char *folder = places->folders[i];
        status = use_named(folder, places->extensions, name + skip, image_path, path);
        if (!status && !*path && skip)
            status = use_named(folder, places->extensions, name, image_path, path);
    }
    return !status && !*path && places->beside ? use_beside(image_path, path, dynamic) : status;
}

static void set_all(uint16_t *valid_mask, int width, int height)
{
    const size_t words = sgs_mask_words(width);
    memset(valid_mask, 0xff, words * (size_t)height * sizeof *valid_mask);
    for (int y = 0; width % 16 && y < height; ++y)
        valid_mask[(size_t)(y + 1) * words - 1] = (uint16_t)((1u << width % 16) - 1);
}

static sgs_status create(int width, int height, uint16_t **valid_mask)
{
    *valid_mask = sgsi_alloc(sgs_mask_words(width) * (size_t)height, sizeof **valid_mask);
    if (!*valid_mask)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a mask of %d x %d pixels",
                         width, height);
    set_all(*valid_mask, width, height);
    return SGS_STATUS_OK;
}

sgs_status sgsi_mask_begin(sgs_photo *photo)
{
    return photo->valid_mask ? SGS_STATUS_OK
                             : create(photo->width, photo->height, &photo->valid_mask);
}

void sgsi_mask_drop(sgs_photo *photo, int width, int height, int x, int y)
{
    const long long w = photo->width, h = photo->height;
    const int x0 = (int)(x * w / width), x1 = (int)(((x + 1) * w + width - 1) / width);
    const int y0 = (int)(y * h / height), y1 = (int)(((y + 1) * h + height - 1) / height);
    const size_t words = sgs_mask_words(photo->width);
    for (int j = y0; j < y1; ++j)
        for (int i = x0; i < x1; ++i)
            photo->valid_mask[(size_t)j * words + (size_t)i / 16] &= (uint16_t) ~(1u << i % 16);
}

// Of instant-ngp: the largest colour channel. Alpha is ignored.
static int brightness(const sgs_image8 *mask, size_t at, size_t plane)
{
    int largest = 0;
    for (size_t c = 0; c < 3; ++c)
        largest = mask->pixels[c * plane + at] > largest ? mask->pixels[c * plane + at] : largest;
    return largest;
}

// Mean of the colour channels, times a straight alpha; at least 1 unless that is 0.
static int whiteness(const sgs_image8 *mask, size_t at, size_t plane)
{
    const int sum = mask->pixels[at] + mask->pixels[plane + at] + mask->pixels[2 * plane + at];
    const int scaled = mask->channels == 4 ? sum * mask->pixels[3 * plane + at] : sum * 255;
    return scaled && scaled < 3 * 255 ? 1 : scaled / (3 * 255);
}

static int opacity(const sgs_image8 *mask, size_t at, size_t plane)
{
    return mask->pixels[3 * plane + at];
}

// True for a cut-out, whose mask is the alpha channel: the colours that are not transparent are
// those of a photo, or one other than white. The colours of a mask have two values, except for some
// at its edges.
static bool is_cutout(const sgs_image8 *mask, size_t plane)
{
    size_t counts[256] = {0}, visible = 0, between = 0;
    int least = 255, most = 0, low = 255, high = 0;
    for (size_t at = 0; mask->channels == 4 && at < plane; ++at) {
        const int alpha = opacity(mask, at, plane);
        least = alpha < least ? alpha : least;
        most = alpha > most ? alpha : most;
        visible += alpha > 0;
        counts[(mask->pixels[at] + mask->pixels[plane + at] + mask->pixels[2 * plane + at]) / 3] +=
            alpha > 0;
    }
    for (int value = 0; value < 256; ++value)
        if (counts[value]) {
            low = value < low ? value : low;
            high = value;
        }
    const int margin = (high - low) / 16;
    for (int value = low + margin + 1; value < high - margin; ++value)
        between += counts[value];
    return least < most && (low == high ? low < 255 : between > visible / 10);
}

typedef int (*pixel_value)(const sgs_image8 *mask, size_t at, size_t plane);

// The lowest valid value. Masks of 0 and 1, or of labels, are read as COLMAP does: all but 0 is
// valid.
static int lowest_valid(const sgs_image8 *mask, size_t plane, pixel_value value_of)
{
    bool all_zero = true;
    for (size_t at = 0; at < plane; ++at) {
        const int value = value_of(mask, at, plane);
        if (value >= 128)
            return 128;
        all_zero = all_zero && !value;
    }
    return all_zero ? 128 : 1;
}

sgs_status sgsi_mask_apply_file(sgs_photo *photo, const sgsi_mask_file *file, sgsi_mask_use *use)
{
    sgs_image8 mask;
    *use = (sgsi_mask_use){0};
    sgs_status status = sgsi_image_read_checked(file->path, true, &mask);
    if (status)
        return status;
    // Downscaled photos may have full-size masks; their sizes were rounded to whole pixels.
    const double width = (double)mask.width * file->height / mask.height;
    if (mask.width < file->width || width < file->width - 1.0 || width > file->width + 1.0)
        status = sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: the mask has %d x %d pixels, but its photo %s has %d x %d; use the same size",
            file->path, mask.width, mask.height, file->photo_path, file->width, file->height);
    if (!status)
        status = sgsi_mask_begin(photo);
    const size_t plane = (size_t)mask.width * (size_t)mask.height;
    use->by_alpha = !status && !file->dynamic && is_cutout(&mask, plane);
    const pixel_value value = file->dynamic ? brightness : use->by_alpha ? opacity : whiteness;
    const int lowest = status ? 0 : file->dynamic ? 1 : lowest_valid(&mask, plane, value);
    const bool drops_white = file->invert != file->dynamic;
    size_t dropped = 0;
    for (size_t at = 0; !status && at < plane; ++at)
        if ((value(&mask, at, plane) >= lowest) == drops_white) {
            sgsi_mask_drop(photo, mask.width, mask.height, (int)(at % (size_t)mask.width),
                           (int)(at / (size_t)mask.width));
            ++dropped;
        }
    use->excludes = dropped > 0;
    use->excludes_all = dropped == plane;
    sgs_image8_free(&mask);
    return status;
}

typedef struct lens_rows {
    const sgs_camera *camera;
    double circle; // 0 = none
    uint16_t *valid_mask;
} lens_rows;

static bool has_ray(const lens_rows *rows, int x, int y)
{
    const sgs_camera *camera = rows->camera;
    const double center_x = x + 0.5, center_y = y + 0.5;
    double direction[3];
    // The corner that is farthest from the image centre.
    if (rows->circle > 0 && hypot(fabs(center_x - 0.5 * camera->width) + 0.5,
                                  fabs(center_y - 0.5 * camera->height) + 0.5) > rows->circle)
        return false;
    return sgs_camera_unproject(camera, (double[2]){center_x, center_y}, direction);
}

// The valid image of a lens is the image of a disc under a continuous injection, so it has no
// holes, and neither has the circle. If the whole border is inside, every pixel is.
static bool border_has_rays(const lens_rows *rows)
{
    const int width = rows->camera->width, height = rows->camera->height;
    for (int x = 0; x < width; ++x)
        if (!has_ray(rows, x, 0) || !has_ray(rows, x, height - 1))
            return false;
    for (int y = 0; y < height; ++y)
        if (!has_ray(rows, 0, y) || !has_ray(rows, width - 1, y))
            return false;
    return true;
}

static void lens_row(void *context, size_t y, int thread)
{
    (void)thread;
    const lens_rows *rows = context;
    uint16_t *row = rows->valid_mask + y * sgs_mask_words(rows->camera->width);
    for (int x = 0; x < rows->camera->width; ++x)
        if (!has_ray(rows, x, (int)y))
            row[x / 16] &= (uint16_t) ~(1u << x % 16);
}

sgs_status sgsi_mask_of_lens(const sgs_camera *camera, double circle, uint16_t **valid_mask,
                             size_t *rays)
{
    lens_rows rows = {.camera = camera, .circle = circle};
    *valid_mask = NULL;
    *rays = (size_t)camera->width * (size_t)camera->height;
    if (border_has_rays(&rows))
        return SGS_STATUS_OK;
    const sgs_status status = create(camera->width, camera->height, valid_mask);
    if (status)
        return status;
    rows.valid_mask = *valid_mask;
    sgsi_parallel_for((size_t)camera->height, 8, lens_row, &rows);
    *rays = sgsi_mask_count(*valid_mask, camera->width, camera->height);
    return SGS_STATUS_OK;
}

sgs_status sgsi_mask_intersect(sgs_photo *photo, const uint16_t *valid_mask)
{
    if (!valid_mask)
        return SGS_STATUS_OK;
    const sgs_status status = sgsi_mask_begin(photo);
    for (size_t i = 0; !status && i < sgs_mask_words(photo->width) * (size_t)photo->height; ++i)
        photo->valid_mask[i] &= valid_mask[i];
    return status;
}

size_t sgsi_mask_count(const uint16_t *valid_mask, int width, int height)
{
    const size_t words = sgs_mask_words(width);
    const unsigned last = 0xFFFFu >> (15 - (width - 1) % 16); // bits of the last word of a row
    if (!valid_mask)
        return (size_t)width * (size_t)height;
    size_t count = 0;
    for (size_t i = 0; i < words * (size_t)height; ++i)
        count += (size_t)__builtin_popcount(valid_mask[i] & ((i + 1) % words ? 0xFFFFu : last));
    return count;
}

void sgsi_mask_finish(sgs_photo *photo)
{
    const size_t all = (size_t)photo->width * (size_t)photo->height;
    photo->kept = all;
    if (!photo->valid_mask)
        return;
    photo->kept = sgsi_mask_count(photo->valid_mask, photo->width, photo->height);
    if (photo->kept == all) {
        sgsi_free(photo->valid_mask);
        photo->valid_mask = NULL;
    }
}
