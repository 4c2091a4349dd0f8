// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// IDs consist of a transfer function, primaries and an image state (annex C of the recommendation),
// so two small tables cover them. lin_ciexyzd65_scene is not among them: its neutral colours have
// unequal components, which the matrices of primaries.h exclude. Neither are the HDR displays (PQ,
// HLG).

#include "image/color_interop.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "sparegs/image.h"

static const double ADOBE_GAMMA = 563.0 / 256; // Adobe RGB (1998), 4.3.1.2; "g22" in its ID

static const struct {
    const char *name;
    double gamma;
} curves[] = {{"lin", 1}, {"srgb", 0}, {"g18", 1.8}, {"g22", 2.2}, {"g24", 2.4}};

static const struct {
    const char *name;
    float chromaticities[SGSI_CHROMATICITIES];
} primaries[] = {
    {"rec709", {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f}},
    {"ap0", {0.7347f, 0.2653f, 0.0f, 1.0f, 0.0001f, -0.0770f, 0.32168f, 0.33767f}},
    {"ap1", {0.713f, 0.293f, 0.165f, 0.830f, 0.128f, 0.044f, 0.32168f, 0.33767f}},
    {"p3d65", {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.3127f, 0.3290f}},
    {"rec2020", {0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.3290f}},
    {"adobergb", {0.640f, 0.330f, 0.210f, 0.710f, 0.150f, 0.060f, 0.3127f, 0.3290f}},
};

// Moves *id past `word` and the underscore after it, if there is one. False if *id begins with
// another word.
static bool take_word(const char **id, const char *word)
{
    const size_t length = strlen(word);
    if (strncmp(*id, word, length) != 0 || ((*id)[length] && (*id)[length] != '_'))
        return false;
    *id += length + ((*id)[length] == '_');
    return true;
}

bool sgsi_interop_find(const char *id, sgsi_interop_space *space)
{
    const size_t curve_count = sizeof curves / sizeof *curves,
                 primaries_count = sizeof primaries / sizeof *primaries;
    size_t curve = 0, gamut = 0;
    while (curve < curve_count && !take_word(&id, curves[curve].name))
        ++curve;
    while (gamut < primaries_count && !take_word(&id, primaries[gamut].name))
        ++gamut;
    if (curve == curve_count || gamut == primaries_count ||
        (*id && strcmp(id, "scene") != 0 && strcmp(id, "display") != 0))
        return false;
    *space = (sgsi_interop_space){curves[curve].gamma, primaries[gamut].chromaticities};
    if (!strcmp(curves[curve].name, "g22") && !strcmp(primaries[gamut].name, "adobergb"))
        space->gamma = ADOBE_GAMMA;
    return true;
}

float sgsi_interop_decode(const sgsi_interop_space *space, float value)
{
    if (space->gamma == 0)
        return sgs_srgb_decode(value);
    return value > 0.0f ? (float)pow((double)value, space->gamma) : value;
}
