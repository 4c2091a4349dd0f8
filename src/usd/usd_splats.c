// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The ParticleField schemas of usdVol (OpenUSD 26.03): the positions define the number of splats.
// Other values are cut to it; if there are fewer, they are ignored. Ignored and missing values have
// fallbacks: no rotation, scale 1, opacity 1, and SH of degree 0 with the colour 0.5, whose
// coefficients are 0.

#include "usd/usd_splats.h"

#include <string.h>

#include "base/core.h"

const sgsi_usd_attribute sgsi_usd_attributes[SGSI_USD_VALUES] = {
    {"positions", "positionsh", 3},
    {"orientations", "orientationsh", 4},
    {"scales", "scalesh", 3},
    {"opacities", "opacitiesh", 1},
    {"radiance:sphericalHarmonicsCoefficients", "radiance:sphericalHarmonicsCoefficientsh", 3},
};

typedef enum fallback_reason { MISSING, TOO_FEW, TOO_MANY, REASONS } fallback_reason;

static size_t splat_count(const sgsi_usd_splats *prim)
{
    return prim->counts[SGSI_USD_POSITIONS] / 3;
}

// Numbers that an attribute of the prim should have.
static size_t expected_count(const sgsi_usd_splats *prim, int k)
{
    const size_t coefficients =
        k == SGSI_USD_SH ? (size_t)sgsi_rest_coefficients(prim->sh_degree) + 1 : 1;
    return splat_count(prim) * coefficients * sgsi_usd_attributes[k].components;
}

static sgs_status check_prim(const char *path, sgsi_usd_splats *prim)
{
    static const char *const faults[] = {
        [SGSI_USD_ANIMATED] = "has time samples; export a single frame",
        [SGSI_USD_INVALID] = "has an operation of an unknown type or without a valid value",
        [SGSI_USD_CROWDED] = "has a prim with more than 32 operations"};
    if (prim->fault)
        return sgsi_fail(
            prim->fault == SGSI_USD_INVALID ? SGS_STATUS_FORMAT : SGS_STATUS_UNSUPPORTED,
            "%s: line %d: the transform of the splats %s", path, prim->line, faults[prim->fault]);
    for (int k = 0; k < SGSI_USD_VALUES; ++k) {
        const sgsi_usd_attribute *attribute = &sgsi_usd_attributes[k];
        if (prim->animated[k] && !prim->counts[k])
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: line %d: '%s' of the splats has time samples; export a single "
                             "frame",
                             path, prim->line, attribute->name);
        if (prim->counts[k] % attribute->components)
            return sgsi_fail(
                SGS_STATUS_FORMAT,
                "%s: line %d: '%s' of the splats has %zu numbers, which is no multiple "
                "of %zu",
                path, prim->line, attribute->name, prim->counts[k], attribute->components);
    }
    if (prim->sh_degree < 0)
        prim->sh_degree = 3; // the fallback of the schema
    return prim->sh_degree <= 3
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: line %d: SH degree %d is not within 0 to 3",
                           path, prim->line, prim->sh_degree);
}

static bool has_reason(const sgsi_usd_splats *prim, int k, fallback_reason reason)
{
    const size_t count = prim->counts[k], expected = expected_count(prim, k);
    return reason == MISSING   ? !count && expected
           : reason == TOO_FEW ? count && count < expected
                               : count > expected && expected;
}

// One warning for each attribute and reason, with the first such prim.
static void warn_fallback(const char *path, const sgsi_usd_splats *prims, size_t count, int k,
                          fallback_reason reason)
{
    static const char *const fallbacks[] = {"", "no rotation", "scale 1", "opacity 1",
                                            "the colour 0.5 without SH"};
    const sgsi_usd_attribute *attribute = &sgsi_usd_attributes[k];
    const sgsi_usd_splats *first = NULL;
    size_t affected = 0;
    char others[64] = "", degree[32] = "";
    for (size_t i = 0; i < count; ++i)
        if (has_reason(&prims[i], k, reason)) {
            first = first ? first : &prims[i];
            ++affected;
        }
    if (!first)
        return;
    if (affected > 1)
        snprintf(others, sizeof others, "; %zu prims in total", affected);
    if (k == SGSI_USD_SH)
        snprintf(degree, sizeof degree, " of SH degree %d", first->sh_degree);
    const size_t values = first->counts[k] / attribute->components, splats = splat_count(first);
    if (reason == MISSING)
        sgsi_warn("%s: line %d: the splats have no '%s': %s is used%s", path, first->line,
                  attribute->name, fallbacks[k], others);
    else if (reason == TOO_FEW)
        sgsi_warn(
            "%s: line %d: '%s' has %zu value(s) for %zu splats%s and is ignored: %s is used%s",
            path, first->line, attribute->name, values, splats, degree, fallbacks[k], others);
    else
        sgsi_warn(
            "%s: line %d: '%s' has %zu value(s) for %zu splats%s; the last ones are ignored%s",
            path, first->line, attribute->name, values, splats, degree, others);
}

sgs_status sgsi_usd_splats_check(const char *path, sgsi_usd_splats *prims, size_t count,
                                 size_t *total, int *sh_degree)
{
    *total = 0;
    *sh_degree = 0;
    for (size_t i = 0; i < count; ++i) {
        const sgs_status status = check_prim(path, &prims[i]);
        if (status)
            return status;
        *total += splat_count(&prims[i]);
    }
    for (int k = SGSI_USD_ORIENTATIONS; *total && k < SGSI_USD_VALUES; ++k)
        for (int reason = 0; reason < REASONS; ++reason)
            warn_fallback(path, prims, count, k, (fallback_reason)reason);
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < SGSI_USD_VALUES; ++k)
            prims[i].absent[k] = prims[i].counts[k] < expected_count(&prims[i], k);
        if (!prims[i].absent[SGSI_USD_SH] && splat_count(&prims[i]) &&
            prims[i].sh_degree > *sh_degree)
            *sh_degree = prims[i].sh_degree;
    }
    return SGS_STATUS_OK;
}

sgs_status sgsi_usd_splats_decode(const sgsi_usd_splats *prim, bool z_up, sgsi_rows *rows)
{
    const size_t coefficients = (size_t)sgsi_rest_coefficients(prim->sh_degree) + 1;
    double world[4][4];
    sgsi_affine affine;
    memcpy(world, prim->world, sizeof world);
    if (z_up)
        sgsi_usd_turn_y_up(world);
    if (splat_count(prim) && !sgsi_usd_affine((const double(*)[4])world, &affine))
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: line %d: the transform of the splats is singular, projective or not "
                         "finite; export them without it",
                         rows->path, prim->line);
    for (size_t i = 0; i < splat_count(prim); ++i) {
        float params[SGS_PARAM_COUNT] = {[SGS_PARAM_ROTATION] = 1.0f};
        memcpy(params + SGS_PARAM_MEAN, prim->values[SGSI_USD_POSITIONS] + 3 * i,
               3 * sizeof(float));
        for (size_t k = 0; k < 3 && !prim->absent[SGSI_USD_SCALES]; ++k)
            params[SGS_PARAM_SCALE + k] =
                sgsi_log_scale((double)prim->values[SGSI_USD_SCALES][3 * i + k]);
        if (!prim->absent[SGSI_USD_ORIENTATIONS])
            memcpy(params + SGS_PARAM_ROTATION, prim->values[SGSI_USD_ORIENTATIONS] + 4 * i,
                   4 * sizeof(float));
        params[SGS_PARAM_OPACITY] = sgsi_logit(
            prim->absent[SGSI_USD_OPACITIES] ? 1.0 : (double)prim->values[SGSI_USD_OPACITIES][i]);
        if (!prim->absent[SGSI_USD_SH])
            memcpy(params + SGS_PARAM_SH_DC, prim->values[SGSI_USD_SH] + 3 * coefficients * i,
                   3 * coefficients * sizeof(float));
        sgsi_affine_apply(&affine, params);
        sgsi_change_axes(SGSI_AXES_RUB, params);
        sgsi_rows_add(rows, params);
    }
    return SGS_STATUS_OK;
}
