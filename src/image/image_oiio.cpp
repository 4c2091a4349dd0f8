// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reads photos and encodes PNG and DWAA EXR with OpenImageIO (2.2 to 3.x), which is a C++
// library.
//
// Pixels are returned as stored: no colour conversion, no Exif rotation, straight alpha. Other
// formats are converted to 8-bit RGB(A): grey is replicated, palettes are expanded by OpenImageIO,
// CMYK becomes RGB, 16 bits are rounded to 8, and floats are treated as linear light and encoded as
// sRGB unless the file declares sRGB. Further channels are dropped.
//
// sgsi_oiio_read_rows returns floats instead, for photos whose range or colour space exceeds
// 8-bit sRGB. oiio_color.cpp converts them.
//
// Sizes are checked before allocation. Rows are decoded in slabs of scanlines or of one row of
// tiles, so that the interleaved image never exists as a whole.

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include <sys/stat.h>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/Imath.h>
#include <OpenImageIO/imageio.h>

#include "image/image_oiio.h"
#include "image/oiio_color.h"

extern "C" {
#include "base/core.h"
#include "image/exr_channels.h"
#include "image/icc_profile.h"
#include "sparegs/runtime.h"
}

using namespace sgsi;

namespace
{

constexpr int max_size = 65536;
constexpr int64_t max_pixels = int64_t(1) << 30;
constexpr int slab_rows = 64;
constexpr size_t slab_bytes = size_t(1) << 28; // of more than one scanline
constexpr size_t max_slab_bytes = size_t(1) << 31;

// Mapping of a file's channels to RGB(A).
struct Layout {
    int channels = 3;             // output channels
    int source[4] = {0, 0, 0, 0}; // of each output channel, counted from `first`
    int first = 0, read = 1;      // range of file channels to decode
    bool cmyk = false;
    bool associated = false; // the file's colour is premultiplied by alpha
    bool linear = false;
    bool is_mask = false;                        // samples above 0 stay above 0
    OIIO::TypeDesc type = OIIO::TypeDesc::UINT8; // type in which rows are decoded
};

sgs_status unreadable(const char *path, const std::string &reason)
{
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: cannot read the image: %s", path,
                     one_line(reason).c_str());
}

// Runs body() and converts exceptions to a status.
template <typename Body> sgs_status guarded(const char *path, Body body)
{
    try {
        return body();
    } catch (const std::bad_alloc &) {
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for the image", path);
    } catch (const std::exception &e) {
        return sgsi_fail(SGS_STATUS_INTERNAL, "%s: OpenImageIO failed: %s", path, e.what());
    } catch (...) {
        return sgsi_fail(SGS_STATUS_INTERNAL, "%s: OpenImageIO failed", path);
    }
}

Layout layout_of(const OIIO::ImageSpec &spec)
{
    Layout out;
    const int n = spec.nchannels;
    const int alpha = spec.alpha_channel >= 0 && spec.alpha_channel < n ? spec.alpha_channel : -1;
    const std::string space = spec.get_string_attribute("oiio:ColorSpace");
    const bool cmyk_names = n >= 4 && spec.channelnames.size() >= 4 &&
                            spec.channelnames[0] == "C" && spec.channelnames[3] == "K";
    out.cmyk = cmyk_names || (n >= 4 && space == "CMYK");
    const bool grey = n - (alpha >= 0) < 3;
    for (int c = 0; c < 3; ++c)
        out.source[c] = grey ? (alpha == 0 && n > 1 ? 1 : 0) : c;
    if (alpha >= 0 && n > 1 && !out.cmyk) {
        out.channels = 4;
        out.source[3] = alpha;
        out.associated = spec.get_int_attribute("oiio:UnassociatedAlpha", 0) == 0;
    }
    out.read = 1 + *std::max_element(out.source, out.source + out.channels);
    if (out.cmyk)
        out.read = 4;
    if (spec.format.is_floating_point()) {
        out.type = OIIO::TypeDesc::FLOAT;
        out.linear = !is_encoded(space);
    } else if (spec.format.size() > 1) {
        out.type = spec.format.size() > 2 ? OIIO::TypeDesc::FLOAT : OIIO::TypeDesc::UINT16;
    }
    return out;
}

// True for the file signature of WebP: RIFF, a size, WEBP.
bool is_webp(const char *path)
{
    char head[12] = "";
    return OIIO::Filesystem::read_bytes(path, head, sizeof head) == sizeof head &&
           !std::memcmp(head, "RIFF", 4) && !std::memcmp(head + 8, "WEBP", 4);
}

// OpenImageIO takes what follows a '?' in a path for options of the reader. So such a file is
// opened by a reader that is chosen here: that of its extension, else the first that recognises the
// file.
std::unique_ptr<OIIO::ImageInput> open_by_format(const std::string &path,
                                                 const std::string &formats,
                                                 const OIIO::ImageSpec &config, std::string &error)
{
    std::string names = OIIO::Filesystem::extension(path, false) + "," + formats;
    for (char *next = &names[0], *name; (name = strsep(&next, ","));) {
        auto input = *name ? OIIO::ImageInput::create(name) : nullptr;
        OIIO::ImageSpec spec;
        if (!input || !input->valid_file(path))
            continue;
        if (input->open(path, spec, config))
            return input;
        error = input->geterror();
        return nullptr;
    }
    (void)OIIO::geterror(); // of names that are no formats
    error = "no reader of OpenImageIO recognises its format";
    return nullptr;
}

sgs_status open_file(const char *path, std::unique_ptr<OIIO::ImageInput> &input)
{
    struct stat info;
    if (stat(path, &info))
        return sgsi_fail(SGS_STATUS_IO, "%s: %s", path,
                         errno == ENOENT ? "no such file" : std::strerror(errno));
    if (!S_ISREG(info.st_mode))
        return sgsi_fail(SGS_STATUS_IO, "%s: is not a regular file", path);
    // Registers the formats before the first file: OpenImageIO 2.4 lets a second thread try only
    // the formats registered so far, which fails for a PNG file named .jpg.
    static const std::string formats = OIIO::get_string_attribute("input_format_list");
    // Requests straight alpha. The attribute of the same name says whether it was obtained, with
    // two exceptions: WebP in OpenImageIO 3.1.3 to 3.1.9, so that all versions have to premultiply
    // it, and JPEG 2000, which is always straight then.
    OIIO::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", int(!is_webp(path)));
    std::string error;
    input = std::strchr(path, '?') ? open_by_format(path, formats, config, error)
                                   : OIIO::ImageInput::open(path, &config);
    if (!input)
        return unreadable(path, error.empty() ? OIIO::geterror() : error);
    input->threads(1); // the caller reads several images in parallel
    return SGS_STATUS_OK;
}

// Checks the current part of a file and finds its channels.
sgs_status find_layout(const char *path, const OIIO::ImageInput &input, Layout &layout)
{
    const OIIO::ImageSpec &spec = input.spec();
    if (spec.width < 1 || spec.height < 1 || spec.width > max_size || spec.height > max_size ||
        int64_t(spec.width) * spec.height > max_pixels)
        return sgsi_fail(SGS_STATUS_LIMIT,
                         "%s: %d x %d pixels exceed the limit of %d per side and 2^30 in total",
                         path, spec.width, spec.height, max_size);
    if (spec.deep || spec.nchannels < 1 || spec.depth > 1)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: not a flat two-dimensional image", path);
    layout = layout_of(spec);
    if (std::strcmp(input.format_name(), "jpeg2000") == 0)
        layout.associated = false;
    return SGS_STATUS_OK;
}

sgs_status open_image(const char *path, std::unique_ptr<OIIO::ImageInput> &input, Layout &layout)
{
    const sgs_status opened = open_file(path, input);
    return opened ? opened : find_layout(path, *input, layout);
}

// One sample as a value in [0, 1].
float sample(const unsigned char *row, size_t i, const Layout &layout)
{
    if (layout.type == OIIO::TypeDesc::UINT8)
        return float(row[i]) / 255;
    if (layout.type == OIIO::TypeDesc::UINT16)
        return float(reinterpret_cast<const uint16_t *>(row)[i]) / 65535;
    const float value = reinterpret_cast<const float *>(row)[i];
    return value > 0 ? std::min(value, 1.0f) : 0; // NaN becomes 0
}

float srgb_curve(float v)
{
    return v <= 0.0031308f ? 12.92f * v : 1.055f * std::pow(v, 1 / 2.4f) - 0.055f;
}

uint8_t quantised(float v, const Layout &layout)
{
    const uint8_t rounded = uint8_t(std::min(v, 1.0f) * 255 + 0.5f);
    return layout.is_mask && v > 0 && !rounded ? 1 : rounded;
}

// Converts any layout, sample by sample.
void convert_pixel(const unsigned char *row, size_t x, const Layout &layout, uint8_t out[4])
{
    const size_t at = x * size_t(layout.read);
    if (layout.cmyk) {
        const float white = 1 - sample(row, at + 3, layout);
        for (size_t c = 0; c < 3; ++c)
            out[c] = quantised((1 - sample(row, at + c, layout)) * white, layout);
        return;
    }
    const float alpha =
        layout.channels == 4 ? sample(row, at + size_t(layout.source[3]), layout) : 1;
    for (int c = 0; c < 3; ++c) {
        float v = sample(row, at + size_t(layout.source[c]), layout);
        if (layout.associated && alpha > 0)
            v = std::min(v / alpha, 1.0f);
        out[c] = quantised(layout.linear ? srgb_curve(v) : v, layout);
    }
    out[3] = quantised(alpha, layout);
}

void convert_rows(const unsigned char *rows, int y0, int y1, const Layout &layout,
                  sgs_image8 &image)
{
    const size_t width = size_t(image.width), plane = width * size_t(image.height);
    const size_t row_bytes = width * size_t(layout.read) * layout.type.size();
    const bool plain = layout.type == OIIO::TypeDesc::UINT8 && !layout.cmyk && !layout.associated;
    for (int y = y0; y < y1; ++y) {
        const unsigned char *row = rows + size_t(y - y0) * row_bytes;
        uint8_t *out = image.pixels + size_t(y) * width;
        if (plain) {
            for (int c = 0; c < layout.channels; ++c) {
                const unsigned char *in = row + layout.source[c];
                for (size_t x = 0; x < width; ++x)
                    out[size_t(c) * plane + x] = in[x * size_t(layout.read)];
            }
            continue;
        }
        for (size_t x = 0; x < width; ++x) {
            uint8_t pixel[4];
            convert_pixel(row, x, layout, pixel);
            for (int c = 0; c < layout.channels; ++c)
                out[size_t(c) * plane + x] = pixel[c];
        }
    }
}

// Number of rows that are decoded at once, at most image height.
sgs_status slab_height(const char *path, const OIIO::ImageSpec &spec, const Layout &layout,
                       int &rows)
{
    const size_t pitch = size_t(spec.width) * size_t(layout.read) * layout.type.size();
    if (spec.tile_width > 0)
        rows = spec.tile_height;
    else
        rows = int(std::clamp(slab_bytes / pitch, size_t(1), size_t(slab_rows)));
    rows = std::min(rows, spec.height);
    if (size_t(rows) * pitch <= max_slab_bytes)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_LIMIT,
                     "%s: %d rows of %d pixels with %d channels exceed the limit of 2 GiB that are "
                     "decoded at once; save it with fewer channels or smaller tiles",
                     path, rows, spec.width, layout.read);
}

// Decodes rows y to end - 1, counted from 0.
bool read_slab(OIIO::ImageInput &input, const OIIO::ImageSpec &spec, const Layout &layout, int y,
               int end, void *slab)
{
    const int channel_end = layout.first + layout.read, part = input.current_subimage();
    // OpenImageIO converts scanlines in a buffer of 16 MB, unless no type is given.
    const bool native = layout.type == spec.format && spec.channelformats.empty();
    const OIIO::TypeDesc type = native ? OIIO::TypeDesc() : layout.type;
    return spec.tile_width > 0
               ? input.read_tiles(part, 0, spec.x, spec.x + spec.width, spec.y + y, spec.y + end,
                                  spec.z, spec.z + 1, layout.first, channel_end, layout.type, slab)
               : input.read_scanlines(part, 0, spec.y + y, spec.y + end, spec.z, layout.first,
                                      channel_end, type, slab);
}

sgs_status read_pixels(const char *path, OIIO::ImageInput &input, const Layout &layout,
                       sgs_image8 &image)
{
    const OIIO::ImageSpec spec = input.spec();
    int rows;
    const sgs_status status = slab_height(path, spec, layout, rows);
    if (status)
        return status;
    std::vector<unsigned char> slab(size_t(rows) * size_t(spec.width) * size_t(layout.read) *
                                    layout.type.size());
    for (int y = 0; y < spec.height; y += rows) {
        const int end = std::min(y + rows, spec.height);
        if (!read_slab(input, spec, layout, y, end, slab.data()))
            return unreadable(path, input.geterror());
        convert_rows(slab.data(), y, end, layout, image);
    }
    return SGS_STATUS_OK;
}

// ---- Rows of floats ----

// A flat channel of an EXR file. Those of a file with several parts are named PART.CHANNEL, so that
// each part is a layer.
struct ExrChannel {
    std::string name;
    size_t prefix;   // length of "PART."
    int part, place; // place: index in the part
};

std::vector<ExrChannel> list_exr_channels(OIIO::ImageInput &input)
{
    std::vector<ExrChannel> out;
    int count = 0;
    while (input.seek_subimage(count, 0))
        ++count;
    (void)input.geterror(); // of the part after the last one
    for (int part = 0; part < count && input.seek_subimage(part, 0); ++part) {
        const OIIO::ImageSpec &spec = input.spec();
        const std::string name = spec.get_string_attribute("oiio:subimagename"),
                          layer = name.empty() ? "part " + std::to_string(part) : name,
                          prefix = count > 1 ? layer + "." : "";
        for (int c = 0; c < spec.nchannels && !spec.deep; ++c)
            out.push_back({prefix + spec.channelnames[size_t(c)], prefix.size(), part, c});
    }
    return out;
}

// Chooses among the channels [begin, end). False if they have no colours, or those of several
// parts.
bool choose_exr_channels(const std::vector<ExrChannel> &channels, size_t begin, size_t end,
                         bool with_parts, sgsi_exr_colors &colors)
{
    std::vector<const char *> names;
    for (size_t c = begin; c < end; ++c)
        names.push_back(channels[c].name.c_str() + (with_parts ? 0 : channels[c].prefix));
    if (!sgsi_exr_find_colors(names.data(), int(names.size()), &colors))
        return false;
    bool one_part = true;
    for (int &c : colors.channels) {
        c += c < 0 ? 0 : int(begin);
        one_part &= c < 0 || channels[size_t(c)].part == channels[size_t(*colors.channels)].part;
    }
    return one_part;
}

// The colours of the layers of all parts, else the grey of the first part that has it.
bool find_exr_colors(const std::vector<ExrChannel> &channels, sgsi_exr_colors &colors)
{
    bool found = choose_exr_channels(channels, 0, channels.size(), true, colors);
    for (size_t begin = 0, end; begin < channels.size() && !found; begin = end) {
        end = begin + 1;
        while (end < channels.size() && channels[end].part == channels[begin].part)
            ++end;
        found = choose_exr_channels(channels, begin, end, false, colors);
    }
    return found;
}

std::string names_of(const std::vector<ExrChannel> &channels)
{
    std::vector<std::string> names;
    for (const ExrChannel &channel : channels)
        names.push_back(channel.name);
    return joined(names);
}

// Uses the colour channels of an EXR file and seeks to their part. The note says which of several
// layers they are.
sgs_status find_exr_channels(const char *path, OIIO::ImageInput &input, Layout &layout,
                             std::string &note)
{
    const std::vector<ExrChannel> channels = list_exr_channels(input);
    sgsi_exr_colors colors;
    const bool found = find_exr_colors(channels, colors);
    const int *const chosen = colors.channels;
    if (!input.seek_subimage(found ? channels[size_t(*chosen)].part : 0, 0))
        return unreadable(path, input.geterror());
    const sgs_status checked = find_layout(path, input, layout);
    if (checked)
        return checked;
    if (!found)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: no colour channels R, G, B or Y; the channels are %s", path,
                         names_of(channels).c_str());
    layout.channels = chosen[3] >= 0 ? 4 : 3;
    layout.associated = layout.channels == 4;
    layout.cmyk = false; // the channels found are colours, whatever the others are
    for (int c = 0; c < layout.channels; ++c)
        layout.source[c] = channels[size_t(chosen[c])].place;
    int *const sources_end = layout.source + layout.channels;
    layout.first = *std::min_element(layout.source, sources_end);
    layout.read = 1 + *std::max_element(layout.source, sources_end) - layout.first;
    for (int c = 0; c < layout.channels; ++c)
        layout.source[c] -= layout.first;
    const char *const red = channels[size_t(*chosen)].name.c_str();
    const std::string layer(red, size_t(sgsi_exr_layer_length(red)));
    if (colors.rgb_layers > 1)
        note = std::to_string(colors.rgb_layers) + " layers have R, G and B; '" +
               one_line(layer.substr(0, max_shown)) +
               "' is used; to select another one, name it Combined";
    return SGS_STATUS_OK;
}

sgs_status open_photo(const char *path, const char *colorspace,
                      std::unique_ptr<OIIO::ImageInput> &input, Layout &layout, Colors &colors)
{
    sgs_status status = open_file(path, input);
    const bool is_exr = !status && std::strcmp(input->format_name(), "openexr") == 0;
    if (is_exr)
        status = find_exr_channels(path, *input, layout, colors.notes[SGSI_NOTE_LAYER]);
    else if (!status)
        status = find_layout(path, *input, layout);
    layout.type = OIIO::TypeDesc::FLOAT;
    return status ? status : choose_colors(path, input->spec(), is_exr, colorspace, colors);
}

// Decodes a row if required and premultiplies it.
void convert_row(int width, const Layout &layout, const Colors &colors, float *row)
{
    if (layout.channels < 4) {
        decode_row(width, 3, colors, row);
        return;
    }
    // Transfer functions apply to unpremultiplied colours.
    if (decodes(colors) && layout.associated)
        for (size_t x = 0; x < size_t(width); ++x)
            for (size_t c = 0; c < 3; ++c)
                row[4 * x + c] = row[4 * x + 3] > 0 ? row[4 * x + c] / row[4 * x + 3] : 0;
    decode_row(width, 4, colors, row);
    if (decodes(colors) || !layout.associated)
        for (size_t x = 0; x < size_t(width); ++x)
            for (size_t c = 0; c < 3; ++c)
                row[4 * x + c] *= row[4 * x + 3];
}

// Writes one row as [width][channels], colour premultiplied by alpha. `raw`: layout.read floats per
// pixel.
void arrange_row(const float *raw, int width, const Layout &layout, const Colors &colors,
                 float *row)
{
    const size_t channels = size_t(layout.channels);
    for (size_t x = 0; x < size_t(width); ++x) {
        const float *in = raw + x * size_t(layout.read);
        float *out = row + x * channels;
        for (size_t c = 0; c < channels; ++c)
            out[c] = in[layout.source[c]];
        if (layout.cmyk)
            for (size_t c = 0; c < 3; ++c)
                out[c] = (1 - in[c]) * (1 - in[3]);
    }
    convert_row(width, layout, colors, row);
    convert_primaries(width, channels, colors, row);
}

sgs_status read_rows(const char *path, OIIO::ImageInput &input, const Layout &layout,
                     const Colors &colors, sgsi_row_fn take, void *context)
{
    const OIIO::ImageSpec spec = input.spec();
    int rows;
    const sgs_status status = slab_height(path, spec, layout, rows);
    if (status)
        return status;
    const size_t pitch = size_t(spec.width) * size_t(layout.read);
    std::vector<float> slab(size_t(rows) * pitch),
        row(size_t(spec.width) * size_t(layout.channels));
    for (int y = 0; y < spec.height; y += rows) {
        const int end = std::min(y + rows, spec.height);
        if (!read_slab(input, spec, layout, y, end, slab.data()))
            return unreadable(path, input.geterror());
        for (int k = y; k < end; ++k) {
            arrange_row(slab.data() + size_t(k - y) * pitch, spec.width, layout, colors,
                        row.data());
            take(context, k, row.data());
        }
    }
    return SGS_STATUS_OK;
}

} // namespace

sgs_status sgsi_oiio_read(const char *path, bool is_mask, sgs_image8 *image)
{
    *image = sgs_image8{};
    const sgs_status status = guarded(path, [&]() {
        std::unique_ptr<OIIO::ImageInput> input;
        Layout layout;
        const sgs_status opened = open_image(path, input, layout);
        if (opened)
            return opened;
        layout.is_mask = is_mask;
        image->width = input->spec().width;
        image->height = input->spec().height;
        image->channels = layout.channels;
        image->pixels = static_cast<uint8_t *>(
            sgsi_alloc(size_t(image->width) * size_t(image->height), size_t(image->channels)));
        if (!image->pixels)
            throw std::bad_alloc();
        return read_pixels(path, *input, layout, *image);
    });
    if (status) {
        sgsi_free(image->pixels);
        *image = sgs_image8{};
    }
    return status;
}

sgs_status sgsi_oiio_probe(const char *path, int *width, int *height, int *channels)
{
    return guarded(path, [&]() {
        std::unique_ptr<OIIO::ImageInput> input;
        Layout layout;
        const sgs_status opened = open_image(path, input, layout);
        if (opened)
            return opened;
        *width = input->spec().width;
        *height = input->spec().height;
        *channels = layout.channels;
        return SGS_STATUS_OK;
    });
}

sgs_status sgsi_oiio_describe(const char *path, const char *colorspace, sgsi_image_info *info)
{
    *info = sgsi_image_info{};
    return guarded(path, [&]() {
        std::unique_ptr<OIIO::ImageInput> input;
        Layout layout;
        Colors colors;
        const sgs_status opened = open_photo(path, colorspace, input, layout, colors);
        if (opened)
            return opened;
        const OIIO::ImageSpec &spec = input->spec();
        const bool is_exr = std::strcmp(input->format_name(), "openexr") == 0;
        *info = {spec.width,
                 spec.height,
                 layout.channels,
                 spec.format == OIIO::TypeDesc::UINT8,
                 colors.encoding != Encoding::srgb,
                 colors.scene_linear,
                 spec.full_width,
                 spec.full_height,
                 is_exr,
                 is_exr ? spec.x - spec.full_x : 0,
                 is_exr ? spec.y - spec.full_y : 0,
                 spec.get_int_attribute("Orientation", 1),
                 {},
                 {}};
        std::snprintf(info->space, SGSI_SPACE_SIZE, "%s", colors.name.c_str());
        for (int k = 0; k < SGSI_NOTES; ++k)
            std::snprintf(info->notes[k], SGSI_NOTE_SIZE, "%s", colors.notes[k].c_str());
        const OIIO::ParamValue *const profile = spec.find_attribute("ICCProfile");
        if (profile && !colorspace)
            sgsi_icc_note(profile->data(), size_t(profile->datasize()),
                          info->notes[SGSI_NOTE_PROFILE], SGSI_NOTE_SIZE);
        return SGS_STATUS_OK;
    });
}

sgs_status sgsi_oiio_read_rows(const char *path, const char *colorspace, sgsi_row_fn take,
                               void *context)
{
    return guarded(path, [&]() {
        std::unique_ptr<OIIO::ImageInput> input;
        Layout layout;
        Colors colors;
        const sgs_status opened = open_photo(path, colorspace, input, layout, colors);
        return opened ? opened : read_rows(path, *input, layout, colors, take, context);
    });
}

namespace
{

// A file encoded in memory, for the caller, who releases it with sgsi_free.
sgs_status copy_encoded(const std::vector<unsigned char> &encoded, uint8_t **bytes, size_t *size)
{
    *bytes = static_cast<uint8_t *>(sgsi_alloc(encoded.size(), 1));
    if (!*bytes)
        throw std::bad_alloc();
    std::memcpy(*bytes, encoded.data(), encoded.size());
    *size = encoded.size();
    return SGS_STATUS_OK;
}

} // namespace

sgs_status sgsi_oiio_png_encode(const char *path, const sgs_image8 *image, const char *description,
                                uint8_t **bytes, size_t *size)
{
    *bytes = nullptr;
    *size = 0;
    return guarded(path, [&]() {
        const size_t width = size_t(image->width), channels = size_t(image->channels);
        const size_t plane = width * size_t(image->height);
        std::vector<unsigned char> encoded;
        OIIO::Filesystem::IOVecOutput memory(encoded);
        auto output = OIIO::ImageOutput::create("png");
        if (!output || !output->supports("ioproxy") || !output->set_ioproxy(&memory))
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: this build of OpenImageIO cannot write PNG", path);
        OIIO::ImageSpec spec(image->width, image->height, image->channels, OIIO::TypeDesc::UINT8);
        spec.attribute("oiio:UnassociatedAlpha", 1);
        spec.attribute("oiio:ColorSpace", "sRGB");
        if (description)
            spec.attribute("ImageDescription", description);
        if (!output->open("memory.png", spec))
            return sgsi_fail(SGS_STATUS_IO, "%s: encoding failed: %s", path,
                             one_line(output->geterror()).c_str());
        std::vector<unsigned char> row(width * channels);
        for (int y = 0; y < image->height; ++y) {
            for (size_t c = 0; c < channels; ++c) {
                const uint8_t *in = image->pixels + c * plane + size_t(y) * width;
                for (size_t x = 0; x < width; ++x)
                    row[x * channels + c] = in[x];
            }
            if (!output->write_scanline(y, 0, OIIO::TypeDesc::UINT8, row.data()))
                return sgsi_fail(SGS_STATUS_IO, "%s: cannot be encoded: %s", path,
                                 one_line(output->geterror()).c_str());
        }
        if (!output->close())
            return sgsi_fail(SGS_STATUS_IO, "%s: cannot be encoded: %s", path,
                             one_line(output->geterror()).c_str());
        return copy_encoded(encoded, bytes, size);
    });
}

namespace
{

// Channels and compression only. OpenEXR's DWA codes channels lossily whose name, without the
// layer, is R, G, B, or Y, RY, BY: those of luma and chroma. The latter are renamed, because here Y
// is an axis. The appended character keeps their order.
OIIO::ImageSpec describe_dwaa(const sgs_exr_info &info, const sgs_exr_channel *channels, int count)
{
    OIIO::ImageSpec spec(info.width, info.height, count, OIIO::TypeDesc::FLOAT);
    spec.channelnames.clear();
    for (int k = 0; k < count; ++k) {
        std::string name = channels[k].name;
        if (name.back() == 'Y')
            name += '\1';
        spec.channelnames.push_back(name);
        spec.channelformats.push_back(channels[k].uints  ? OIIO::TypeDesc::UINT32
                                      : channels[k].half ? OIIO::TypeDesc::HALF
                                                         : OIIO::TypeDesc::FLOAT);
        if (channels[k].name[0] == 'A' && !channels[k].name[1])
            spec.alpha_channel = k;
    }
    spec.attribute("compression", "dwaa");
    return spec;
}

} // namespace

sgs_status sgsi_oiio_dwaa_encode(const char *path, const sgs_exr_info *info,
                                 const sgs_exr_channel *channels, int channel_count,
                                 uint8_t **bytes, size_t *size)
{
    *bytes = nullptr;
    *size = 0;
    return guarded(path, [&]() {
        std::vector<unsigned char> encoded;
        OIIO::Filesystem::IOVecOutput memory(encoded);
        auto output = OIIO::ImageOutput::create("openexr");
        if (!output || !output->supports("ioproxy") || !output->set_ioproxy(&memory))
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: this build of OpenImageIO cannot write EXR", path);
        const OIIO::ImageSpec spec = describe_dwaa(*info, channels, channel_count);
        if (!output->open("memory.exr", spec))
            return sgsi_fail(SGS_STATUS_IO, "%s: cannot be encoded: %s", path,
                             one_line(output->geterror()).c_str());
        // Pixels interleaved in the file's own types: 2 or 4 bytes per channel.
        const size_t pixel_bytes = spec.pixel_bytes(true), width = size_t(info->width);
        std::vector<unsigned char> pixels(pixel_bytes * width * size_t(info->height));
        size_t offset = 0;
        for (int k = 0; k < channel_count; ++k) {
            unsigned char *at = pixels.data() + offset;
            for (size_t i = 0; i < width * size_t(info->height); ++i, at += pixel_bytes) {
                if (channels[k].half) {
                    const half value = half(channels[k].floats[i]);
                    std::memcpy(at, &value, sizeof value);
                } else {
                    std::memcpy(at,
                                channels[k].uints
                                    ? static_cast<const void *>(channels[k].uints + i)
                                    : static_cast<const void *>(channels[k].floats + i),
                                4);
                }
            }
            offset += channels[k].half ? 2 : 4;
        }
        if (!output->write_image(OIIO::TypeDesc::UNKNOWN, pixels.data()) || !output->close())
            return sgsi_fail(SGS_STATUS_IO, "%s: cannot be encoded: %s", path,
                             one_line(output->geterror()).c_str());
        return copy_encoded(encoded, bytes, size);
    });
}
