// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// sRGB with the primaries of Rec. 709 stays encoded, linear light stays linear, and all other
// colour spaces are converted to linear light: those with an ID of the Color Interop Forum by our
// own table, the others by OpenImageIO. Linear light is converted to Rec. 709 from the primaries of
// that ID, or of an EXR file's attribute chromaticities.
//
// What a transfer curve encodes is display-referred, white is 1: such colours are decoded for the
// conversion of their primaries only. Linear values have no natural white. Neither have encodings
// whose code value 1 is brighter than white, such as the logarithmic ones of cameras.

#include "image/oiio_color.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <iterator>

extern "C" {
#include "base/core.h"
#include "image/primaries.h"
}

namespace sgsi
{

std::string one_line(std::string text)
{
    while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())))
        text.pop_back();
    std::replace_if(
        text.begin(), text.end(), [](unsigned char c) { return c < 0x20; }, ' ');
    return text.empty() ? "no reason given" : text;
}

std::string joined(const std::vector<std::string> &words)
{
    std::string text;
    for (const std::string &word : words)
        text += (text.empty() ? "" : ", ") + word;
    return text;
}

namespace
{

std::string lower(std::string text)
{
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return char(std::tolower(c)); });
    return text;
}

bool begins(const std::string &text, const char *head)
{
    return text.compare(0, std::strlen(head), head) == 0;
}

// The colour spaces to choose from, each name once.
std::string color_spaces(const OIIO::ColorConfig &config)
{
    std::vector<std::string> names = {"linear", "sRGB"};
    for (const std::string &name : config.getColorSpaceNames())
        if (std::none_of(names.begin(), names.end(),
                         [&](const std::string &known) { return lower(known) == lower(name); }))
            names.push_back(name);
    return joined(names);
}

// To linear Rec. 709, by the names of the common configurations, or to ACES2065-1, whose primaries
// are known. The role scene_linear is the last choice: it is ACEScg in configurations for ACES.
bool find_processor(const OIIO::ColorConfig &config, const std::string &space, Colors &colors)
{
    static const char *const rec709[] = {"lin_rec709", "lin_srgb", "Linear Rec.709 (sRGB)",
                                         "Utility - Linear - sRGB", "Utility - Linear - Rec.709"};
    static const char *const aces[] = {"aces_interchange", "ACES2065-1", "ACES - ACES2065-1"};
    static const char *const linear[] = {"scene_linear", "linear"};
    sgsi_interop_space ap0;
    for (const char *target : rec709)
        if ((colors.processor = config.createColorProcessor(space, target)))
            return true;
    for (const char *target : aces)
        if ((colors.processor = config.createColorProcessor(space, target))) {
            colors.primaries = sgsi_interop_find("lin_ap0_scene", &ap0) &&
                               sgsi_primaries_to_rec709(ap0.chromaticities, colors.matrix);
            return true;
        }
    for (const char *target : linear)
        if ((colors.processor = config.createColorProcessor(space, target)))
            return true;
    return false;
}

// False for colours encoded for display; see the top of this file.
bool is_scene_linear(const OIIO::ColorProcessor &processor)
{
    enum { levels = 3 };
    float grey[levels][3] = {{0.25f, 0.25f, 0.25f}, {0.5f, 0.5f, 0.5f}, {1, 1, 1}};
    processor.apply(grey[0], levels, 1, 3, sizeof(float), sizeof grey[0], sizeof grey);
    bool is_linear = true;
    float brightest = 0;
    for (int c = 0; c < 3; ++c) {
        const float white = grey[2][c];
        brightest = std::max(brightest, white);
        is_linear &= std::abs(grey[1][c] - white / 2) <= 1e-3f * std::abs(white) &&
                     std::abs(grey[0][c] - white / 4) <= 1e-3f * std::abs(white);
    }
    return is_linear || brightest > 2;
}

// Names of OpenImageIO 2.2 to 3 for a PNG file with the gamma of sRGB, 1/2.2, in its chunk gAMA and
// no chunk sRGB, as ImageMagick writes them: photos in sRGB.
bool is_display_gamma(const std::string &name)
{
    return name == "gammacorrected2.2" || name == "gamma2.2" || begins(name, "g22_rec709");
}

bool is_linear_rec709(const std::string &name)
{
    return name == "lin_srgb" || name == "lin_rec709" || name == "lin_rec709_scene";
}

// Uses the space that an ID of the Color Interop Forum names. False if it is unknown.
bool use_interop(const std::string &id, Colors &colors)
{
    if (!sgsi_interop_find(id.c_str(), &colors.space))
        return false;
    const bool is_rec709 = sgsi_primaries_are_rec709(colors.space.chromaticities);
    colors.encoding = is_rec709 && colors.space.gamma == 0 ? Encoding::srgb : Encoding::linear;
    colors.name = id;
    colors.scene_linear = colors.space.gamma == 1;
    colors.decodes = colors.encoding == Encoding::linear && !colors.scene_linear;
    colors.primaries =
        !is_rec709 && sgsi_primaries_to_rec709(colors.space.chromaticities, colors.matrix);
    return true;
}

// True if the user's configuration defines this role: then it also says what the role means.
bool is_configured_role(const char *colorspace, const std::string &name)
{
    const char *const configuration = std::getenv("OCIO");
    return colorspace && name == "scene_linear" && configuration && *configuration;
}

sgs_status choose_named_colors(const char *path, const OIIO::ImageSpec &spec,
                               const char *colorspace, Colors &colors)
{
    std::string space = colorspace ? colorspace : spec.get_string_attribute("oiio:ColorSpace");
    if (space.empty())
        space = spec.format.is_floating_point() ? "linear" : "sRGB";
    const std::string name = lower(space);
    const bool sampled = !colorspace && !spec.format.is_floating_point();
    if (is_srgb(name) || name == "cmyk" || name == "ycbcr" || (sampled && is_display_gamma(name))) {
        colors.encoding = Encoding::srgb;
        colors.name = "sRGB";
        return SGS_STATUS_OK;
    }
    if (name == "linear" || is_linear_rec709(name) ||
        (name == "scene_linear" && !is_configured_role(colorspace, name))) {
        colors.encoding = Encoding::linear;
        colors.scene_linear = true;
        colors.name = "linear";
        return SGS_STATUS_OK;
    }
    if (use_interop(name, colors)) // OpenImageIO 3 describes files by these IDs
        return SGS_STATUS_OK;
    const OIIO::ColorConfig config; // of the OCIO environment variable, or OpenImageIO's default
    colors.encoding = Encoding::other;
    colors.name = one_line(space);
    if (!find_processor(config, space, colors))
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: unknown colour space '%s'; choose with option colorspace from %s",
                         path, one_line(space).c_str(), color_spaces(config).c_str());
    colors.scene_linear = is_scene_linear(*colors.processor);
    return SGS_STATUS_OK;
}

// The attribute of that name, or NULL.
const float *chromaticities_of(const OIIO::ImageSpec &spec)
{
    const OIIO::ParamValue *attribute = spec.find_attribute(
        "chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, SGSI_CHROMATICITIES));
    return attribute ? static_cast<const float *>(attribute->data()) : nullptr;
}

// Linear EXR files have the primaries of their attribute, unless the user names a space with its
// own. OpenImageIO 2.4 calls all of them "Linear".
sgs_status choose_primaries(const char *path, const OIIO::ImageSpec &spec, Colors &colors)
{
    const float *const chromaticities = chromaticities_of(spec);
    if (!chromaticities || colors.encoding != Encoding::linear ||
        sgsi_primaries_are_rec709(chromaticities))
        return SGS_STATUS_OK;
    colors.primaries = true;
    colors.name = "linear with chromaticities";
    return sgsi_primaries_to_rec709(chromaticities, colors.matrix)
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_UNSUPPORTED,
                           "%s: the chromaticities attribute is degenerate (its primaries form no "
                           "triangle); correct it, or set option colorspace to lin_rec709",
                           path);
}

// The ID takes precedence over the chromaticities, which programs often copy without regard to the
// pixels ("Identifying the Color Space of OpenEXR Files"). OpenImageIO 2.4 passes it on unread.
sgs_status choose_exr_colors(const char *path, const OIIO::ImageSpec &spec, Colors &colors)
{
    const std::string id = spec.get_string_attribute("colorInteropID"),
                      shown = "colorInteropID '" + one_line(id.substr(0, max_shown)) + "'";
    std::string &note = colors.notes[SGSI_NOTE_COLOR];
    if (use_interop(id, colors)) {
        const float *const chromaticities = chromaticities_of(spec);
        if (chromaticities &&
            !sgsi_primaries_are_equal(chromaticities, colors.space.chromaticities))
            note = shown + " contradicts the attribute chromaticities, which is ignored; set "
                           "option colorspace to linear to use it instead";
        return SGS_STATUS_OK;
    }
    const sgs_status chosen = choose_named_colors(path, spec, nullptr, colors);
    if (!id.empty() && id != "unknown" && !colors.processor)
        note = shown + " is unknown; the colours are read as " +
               (colors.encoding == Encoding::srgb ? "sRGB" : "linear light") +
               "; name their space with option colorspace";
    return chosen ? chosen : choose_primaries(path, spec, colors);
}

} // namespace

sgs_status choose_colors(const char *path, const OIIO::ImageSpec &spec, bool is_exr,
                         const char *colorspace, Colors &colors)
{
    if (colorspace && use_interop(lower(colorspace), colors))
        return SGS_STATUS_OK;
    if (is_exr && !colorspace)
        return choose_exr_colors(path, spec, colors);
    const sgs_status chosen = choose_named_colors(path, spec, colorspace, colors);
    return chosen || !is_exr || is_linear_rec709(lower(colorspace))
               ? chosen
               : choose_primaries(path, spec, colors);
}

// Other names that begin with sRGB are spaces of their own, such as "sRGB Encoded AP1 - Texture" of
// the ACES configurations.
bool is_srgb(const std::string &space)
{
    static const char *const names[] = {"srgb", "srgb - texture", "srgb_tx", "srgb_texture"};
    const std::string name = lower(space);
    return std::find(std::begin(names), std::end(names), name) != std::end(names) ||
           begins(name, "srgb_rec709") || begins(name, "srgb encoded rec.709 (srgb)");
}

bool is_encoded(const std::string &space)
{
    sgsi_interop_space found;
    return is_srgb(space) || (sgsi_interop_find(lower(space).c_str(), &found) && found.gamma != 1);
}

bool decodes(const Colors &colors)
{
    return colors.processor || colors.decodes;
}

void decode_row(int width, size_t channels, const Colors &colors, float *row)
{
    if (colors.processor)
        colors.processor->apply(row, width, 1, 3, sizeof(float), int64_t(channels * sizeof(float)),
                                OIIO::stride_t(size_t(width) * channels * sizeof(float)));
    for (size_t x = 0; colors.decodes && x < size_t(width); ++x)
        for (size_t c = 0; c < 3; ++c)
            row[channels * x + c] = sgsi_interop_decode(&colors.space, row[channels * x + c]);
}

void convert_primaries(int width, size_t channels, const Colors &colors, float *row)
{
    for (size_t x = 0; colors.primaries && x < size_t(width); ++x) {
        float *const out = row + x * channels;
        const double r = double(out[0]), g = double(out[1]), b = double(out[2]);
        for (size_t c = 0; c < 3; ++c)
            out[c] =
                float(colors.matrix[c][0] * r + colors.matrix[c][1] * g + colors.matrix[c][2] * b);
    }
}

} // namespace sgsi
