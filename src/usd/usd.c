// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Writes OpenUSD text (.usda): one ParticleField3DGaussianSplat of the usdVol schema
// (OpenUSD 26.03) and the cameras. Scales and opacities are linear, SH raw and primitive-major. The
// sorting hint is rayHitDistance: the order of the hits of each ray, as this program renders. The
// names of colour spaces are those of GfColorSpaceNames: OpenUSD resolves no others, such as
// srgb_rec709_display, which some exporters write.
//
// USD is y-up, the model x right, y down, z front: y and z change their signs, in the data and not
// by a transform, because renderers may not rotate SH with a prim.

#include "usd/usd_model.h"

#include <jansson.h>
#include <string.h>

#include "base/core.h"
#include "base/plain_numbers.h"
#include "sparegs/output_file.h"
#include "storage/model_rows.h"

static const size_t WARN_COUNT = 2000000;
static const double APERTURE = 36.0; // mm; only ratios matter

typedef enum usd_array {
    USD_POSITIONS,
    USD_ORIENTATIONS,
    USD_SCALES,
    USD_OPACITIES,
    USD_SH
} usd_array;

static void write_vector(FILE *stream, const float *values)
{
    fprintf(stream, "(%.9g, %.9g, %.9g)", (double)values[0], (double)values[1], (double)values[2]);
}

static void write_item(FILE *stream, usd_array array, const sgsi_splat *splat, int coefficients)
{
    switch (array) {
    case USD_POSITIONS:
        write_vector(stream, splat->mean);
        break;
    case USD_ORIENTATIONS:
        fprintf(stream, "(%.9g, %.9g, %.9g, %.9g)", (double)(float)splat->rotation[0],
                (double)(float)splat->rotation[1], (double)(float)splat->rotation[2],
                (double)(float)splat->rotation[3]);
        break;
    case USD_SCALES: {
        const float scales[3] = {(float)exp((double)splat->log_scale[0]),
                                 (float)exp((double)splat->log_scale[1]),
                                 (float)exp((double)splat->log_scale[2])};
        write_vector(stream, scales);
        break;
    }
    case USD_OPACITIES:
        fprintf(stream, "%.9g", (double)(float)splat->opacity);
        break;
    case USD_SH:
        write_vector(stream, splat->dc);
        for (int k = 0; k < coefficients; ++k) {
            fputs(", ", stream);
            write_vector(stream, splat->rest + 3 * k);
        }
        break;
    }
}

static void write_array(FILE *stream, const sgs_gaussians *model, usd_array array,
                        const char *declaration, const char *metadata)
{
    const int coefficients = sgsi_rest_coefficients(model->sh_degree);
    fprintf(stream, "        %s = [", declaration);
    for (size_t i = 0; i < model->count; ++i) {
        sgsi_splat splat = sgsi_splat_get(model, i);
        sgsi_splat_change_axes(SGSI_AXES_RUB, &splat);
        fputs(i ? ",\n            " : "\n            ", stream);
        write_item(stream, array, &splat, coefficients);
    }
    fprintf(stream, "\n        ]%s\n", metadata);
}

// Box of the primitives at three standard deviations.
static void write_extent(FILE *stream, const sgs_gaussians *model)
{
    double low[3] = {0}, high[3] = {0};
    for (size_t i = 0; i < model->count; ++i) {
        sgsi_splat splat = sgsi_splat_get(model, i);
        sgsi_splat_change_axes(SGSI_AXES_RUB, &splat);
        double deviation[3];
        sgsi_splat_deviation(&splat, deviation);
        for (int j = 0; j < 3; ++j) {
            const double reach = 3.0 * deviation[j], center = (double)splat.mean[j];
            low[j] = i ? fmin(low[j], center - reach) : center - reach;
            high[j] = i ? fmax(high[j], center + reach) : center + reach;
        }
    }
    fprintf(stream, "        float3[] extent = [(%.9g, %.9g, %.9g), (%.9g, %.9g, %.9g)]\n", low[0],
            low[1], low[2], high[0], high[1], high[2]);
}

// A text in double quotes. Layers are UTF-8: in other texts '?' replaces the bytes outside of
// ASCII.
static void write_string(FILE *stream, const char *text)
{
    json_t *valid = json_string(text); // NULL if it is not UTF-8
    fputc('"', stream);
    for (; *text; ++text) {
        const unsigned char byte = (unsigned char)*text;
        if (byte == '"' || byte == '\\')
            fputc('\\', stream);
        fputc(byte < 32 || (byte >= 0x80 && !valid) ? '?' : byte, stream);
    }
    fputc('"', stream);
    json_decref(valid);
}

// A camera looks along -z with y up: the rows of its matrix are its axes in the world, then its
// centre.
static void write_camera(FILE *stream, const sgs_model_camera *camera, size_t number)
{
    const double *r = camera->rotation, *t = camera->translation;
    const double focal = camera->fx * APERTURE / camera->width,
                 height = camera->height * focal / camera->fy,
                 aspect = sgs_pixel_aspect(camera->fx, camera->fy, camera->width, camera->height);
    double center[3];
    for (int k = 0; k < 3; ++k)
        center[k] = -(r[k] * t[0] + r[3 + k] * t[1] + r[6 + k] * t[2]);
    fprintf(stream,
            "        def Camera \"camera_%zu\" (\n            customData = {\n"
            "                string image = ",
            number);
    write_string(stream, camera->name);
    fprintf(stream,
            "\n            }\n        )\n        {\n"
            "            float2 clippingRange = (0.01, 1000000)\n"
            "            float focalLength = %.9g\n"
            "            float fStop = 0\n"
            "            float horizontalAperture = %.9g\n"
            "            float horizontalApertureOffset = %.9g\n"
            "            token projection = \"perspective\"\n"
            "            float verticalAperture = %.9g\n"
            "            float verticalApertureOffset = %.9g\n",
            focal, APERTURE, (0.5 * camera->width - camera->cx) * APERTURE / camera->width, height,
            (camera->cy - 0.5 * camera->height) * focal / camera->fy);
    if (aspect != 1.0) // as in sgs_usd_cameras_read
        fprintf(stream, "            custom float sparegs:pixelAspectRatio = %.9g\n", aspect);
    fprintf(stream,
            "            matrix4d xformOp:transform = ( (%.17g, %.17g, %.17g, 0), (%.17g, %.17g, "
            "%.17g, 0), (%.17g, %.17g, %.17g, 0), (%.17g, %.17g, %.17g, 1) )\n"
            "            uniform token[] xformOpOrder = [\"xformOp:transform\"]\n        }\n\n",
            r[0], -r[1], -r[2], -r[3], r[4], r[5], -r[6], r[7], r[8], center[0], -center[1],
            -center[2]);
}

static void write_layer(FILE *stream, const sgs_gaussians *model,
                        const sgs_model_write_options *options)
{
    char metadata[96];
    fputs("#usda 1.0\n(\n    defaultPrim = \"World\"\n    metersPerUnit = 1\n    upAxis = "
          "\"Y\"\n)\n\n"
          "def Xform \"World\"\n{\n"
          "    def ParticleField3DGaussianSplat \"Splats\" (\n"
          "        prepend apiSchemas = [\"ColorSpaceAPI\"]\n    )\n    {\n",
          stream);
    fprintf(stream, "        uniform token colorSpace:name = \"%s\"\n",
            options->colors.space == SGS_SPACE_LINEAR ? "lin_rec709_scene" : "srgb_rec709_scene");
    if (options->colors.white_point > 0.0)
        fprintf(stream, "        custom uniform double sparegs:whitePoint = %.9g\n",
                options->colors.white_point);
    write_extent(stream, model);
    write_array(stream, model, USD_POSITIONS, "point3f[] positions", "");
    write_array(stream, model, USD_ORIENTATIONS, "quatf[] orientations", "");
    write_array(stream, model, USD_SCALES, "float3[] scales", "");
    write_array(stream, model, USD_OPACITIES, "float[] opacities", "");
    fprintf(stream, "        uniform int radiance:sphericalHarmonicsDegree = %d\n",
            model->sh_degree);
    snprintf(metadata, sizeof metadata,
             " (\n            elementSize = %d\n            interpolation = \"vertex\"\n        )",
             1 + sgsi_rest_coefficients(model->sh_degree));
    write_array(stream, model, USD_SH, "float3[] radiance:sphericalHarmonicsCoefficients",
                metadata);
    fputs("        uniform token projectionModeHint = \"perspective\"\n"
          "        uniform token sortingModeHint = \"rayHitDistance\"\n    }\n",
          stream);
    if (options->camera_count) {
        fputs("\n    def Scope \"Cameras\"\n    {\n", stream);
        for (size_t k = 0; k < options->camera_count; ++k)
            write_camera(stream, &options->cameras[k], k);
        fputs("    }\n", stream);
    }
    fputs("}\n", stream);
}

sgs_status sgsi_usd_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written)
{
    sgs_output_file file;
    const sgs_status status = sgs_output_file_open(&file, path);
    if (status)
        return status;
    if (model->count > WARN_COUNT)
        sgsi_warn("%s: text takes about 0.9 kB per primitive; %zu primitives load slowly", path,
                  model->count);
    const sgsi_plain_numbers numbers = sgsi_plain_numbers_begin();
    write_layer(file.stream, model, options);
    sgsi_plain_numbers_end(&numbers);
    written->bytes = (uint64_t)ftell(file.stream);
    return sgs_output_file_commit(&file);
}
