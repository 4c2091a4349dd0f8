// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Renderers write one EXR file with many layers, and channels are sorted by name: the ambient
// occlusion of Blender's ViewLayer.AO.R stands before the picture, ViewLayer.Combined.R. So the
// picture is recognised by the names in use: Combined (Blender), Beauty (Arnold, V-Ray, Redshift),
// RGBA and RGB (Nuke, Arnold), Composite (Blender).

#include "image/exr_channels.h"

#include <string.h>
#include <strings.h>

int sgsi_exr_layer_length(const char *name)
{
    const char *dot = strrchr(name, '.');
    return dot ? (int)(dot - name) : 0;
}

static const char *last_component(const char *name)
{
    const char *dot = strrchr(name, '.');
    return dot ? dot + 1 : name;
}

// Index of a channel in the layer of channel `like`, or -1.
static int find_channel(const char *const *names, int count, const char *like, const char *wanted)
{
    const size_t layer = (size_t)(last_component(like) - like); // with the dot
    for (int c = 0; c < count; ++c)
        if (!strncmp(names[c], like, layer) && !strcasecmp(names[c] + layer, wanted))
            return c;
    return -1;
}

// True if the last component of the layer's name is one of those that name the picture.
static bool is_picture(const char *name)
{
    static const char *const pictures[] = {"combined", "beauty", "rgba", "rgb", "composite"};
    const size_t length = (size_t)sgsi_exr_layer_length(name);
    size_t begin = length;
    while (begin > 0 && name[begin - 1] != '.')
        --begin;
    for (size_t i = 0; i < sizeof pictures / sizeof *pictures; ++i)
        if (length - begin == strlen(pictures[i]) &&
            !strncasecmp(name + begin, pictures[i], length - begin))
            return true;
    return false;
}

bool sgsi_exr_find_colors(const char *const *names, int count, sgsi_exr_colors *colors)
{
    static const char *const wanted[4] = {"R", "G", "B", "A"};
    *colors = (sgsi_exr_colors){{-1, -1, -1, -1}, 0};
    bool chose_picture = false;
    for (int c = 0; c < count; ++c) {
        int own[4];
        if (strcasecmp(last_component(names[c]), "R") != 0)
            continue;
        for (int k = 0; k < 4; ++k)
            own[k] = find_channel(names, count, names[c], wanted[k]);
        if (own[0] != c || own[1] < 0 || own[2] < 0)
            continue;
        const bool is_main = !strchr(names[c], '.'), picture = is_picture(names[c]);
        if (is_main || !colors->rgb_layers || (picture && !chose_picture)) {
            memcpy(colors->channels, own, sizeof own);
            chose_picture = picture;
        }
        ++colors->rgb_layers;
        if (is_main) {
            colors->rgb_layers = 1;
            return true;
        }
    }
    const int grey = colors->rgb_layers ? -1 : find_channel(names, count, "Y", "Y");
    if (grey >= 0) {
        const int alpha = find_channel(names, count, "Y", "A");
        *colors = (sgsi_exr_colors){{grey, grey, grey, alpha}, 0};
    }
    return colors->rgb_layers || grey >= 0;
}
