// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "storage/color_marks.h"

#include <float.h>
#include <locale.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/core.h"
#include "base/plain_numbers.h"

void sgsi_color_comments_write(FILE *stream, const sgs_model_colors *colors)
{
    const bool linear = colors->space == SGS_SPACE_LINEAR;
    if (linear || colors->white_point > 0.0)
        fprintf(stream, "comment ColorSpace: %s\n", linear ? "linear" : "srgb");
    if (!(colors->white_point > 0.0))
        return;
    const sgsi_plain_numbers numbers = sgsi_plain_numbers_begin();
    fprintf(stream, "comment WhitePoint: %.9g\n", colors->white_point);
    sgsi_plain_numbers_end(&numbers);
}

const char *sgsi_colors_wrong(const sgs_model_colors *colors)
{
    if (colors->space != SGS_SPACE_SRGB && colors->space != SGS_SPACE_LINEAR)
        return "colors.space is unknown";
    return colors->white_point >= 0.0 && colors->white_point <= DBL_MAX
               ? NULL
               : "colors.white_point is negative or not finite";
}

double sgsi_white_point_checked(double value)
{
    return value > 0.0 && value <= 1e30 ? value : 0.0;
}

double sgsi_white_point_parse(const char *text)
{
    char *end;
    const locale_t plain = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0);
    if (!plain)
        return 0.0;
    const double value = strtod_l(text, &end, plain);
    freelocale(plain);
    return end > text ? sgsi_white_point_checked(value) : 0.0;
}

void sgsi_color_comment_parse(const char *key, const char *value, sgs_model_colors *colors)
{
    if (!strcasecmp(key, "ColorSpace:")) {
        const bool linear = !strcasecmp(value, "linear");
        colors->space_known = linear || !strcasecmp(value, "srgb");
        colors->space = linear ? SGS_SPACE_LINEAR : SGS_SPACE_SRGB;
    } else if (!strcasecmp(key, "WhitePoint:")) {
        colors->white_point = sgsi_white_point_parse(value);
    }
}

void sgsi_color_space_parse(const char *path, const char *name, sgs_model_colors *colors)
{
    static const char *const known[] = {"srgb_rec709_display", "lin_rec709_scene",
                                        "lin_rec709_display", "srgb_rec709_scene"};
    const bool linear = !strncmp(name, "lin_", 4);
    colors->space_known = true;
    colors->space = linear ? SGS_SPACE_LINEAR : SGS_SPACE_SRGB;
    for (size_t k = 0; k < sizeof known / sizeof *known; ++k)
        if (!strcmp(name, known[k]))
            return;
    char shown[64];
    snprintf(shown, sizeof shown, "%s", name);
    for (char *at = shown; *at; ++at) // of an untrusted file
        if ((unsigned char)*at < 32 || (unsigned char)*at > 126)
            *at = '?';
    if (path)
        sgsi_warn("%s: colour space '%s' is read as %s with Rec. 709 primaries", path, shown,
                  linear ? "linear light" : "sRGB");
}
