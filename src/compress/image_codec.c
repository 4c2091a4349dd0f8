// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// JPEG XL: modular mode without loss, 8 or 16 bits. WebP: lossless RGB; an image of 16 bits is
// stored as its low bytes above its high bytes. OpenEXR: image_codec_exr.c.

#include "compress/image_codec.h"

#include <jxl/decode.h>
#include <jxl/encode.h>
#include <stdlib.h>
#include <string.h>
#include <webp/decode.h>
#include <webp/encode.h>

#include "compress/image_codec_exr.h"

enum { JXL_EFFORT = 7, MAX_SIDE = 65535, WEBP_MAX_SIDE = 16383 / 2 };

bool sgsi_image_fits(sgs_image_codec codec, size_t side)
{
    return side <= (codec == SGS_IMAGE_CODEC_WEBP ? WEBP_MAX_SIDE : MAX_SIDE);
}

// The values as bytes, for images that are not wide. Released with free().
static uint8_t *narrowed(const sgsi_image16 *image)
{
    const size_t count = (size_t)image->width * (size_t)image->height * (size_t)image->channels;
    uint8_t *out = malloc(count);
    for (size_t i = 0; out && i < count; ++i)
        out[i] = (uint8_t)image->pixels[i];
    return out;
}

// ---- JPEG XL ----

static JxlPixelFormat jxl_format(const sgsi_image16 *image)
{
    return (JxlPixelFormat){.num_channels = (uint32_t)image->channels,
                            .data_type = image->wide ? JXL_TYPE_UINT16 : JXL_TYPE_UINT8,
                            .endianness = JXL_LITTLE_ENDIAN};
}

// The encoder's output, in a buffer that grows.
static sgs_status jxl_collect(JxlEncoder *encoder, uint8_t **bytes, size_t *size)
{
    size_t room = 65536, used = 0;
    *bytes = malloc(room);
    for (;;) {
        if (!*bytes)
            return SGS_STATUS_OUT_OF_MEMORY;
        uint8_t *next = *bytes + used;
        size_t left = room - used;
        const JxlEncoderStatus status = JxlEncoderProcessOutput(encoder, &next, &left);
        used = (size_t)(next - *bytes);
        if (status == JXL_ENC_SUCCESS) {
            *size = used;
            return SGS_STATUS_OK;
        }
        if (status != JXL_ENC_NEED_MORE_OUTPUT)
            return SGS_STATUS_INTERNAL;
        room *= 2;
        uint8_t *grown = realloc(*bytes, room);
        if (!grown)
            return SGS_STATUS_OUT_OF_MEMORY;
        *bytes = grown;
    }
}

static sgs_status jxl_encode(const sgsi_image16 *image, uint8_t **bytes, size_t *size)
{
    const JxlPixelFormat format = jxl_format(image);
    JxlEncoder *encoder = JxlEncoderCreate(NULL);
    uint8_t *narrow = image->wide ? NULL : narrowed(image);
    const void *pixels = image->wide ? (const void *)image->pixels : narrow;
    if (!encoder || !pixels) {
        if (encoder)
            JxlEncoderDestroy(encoder);
        free(narrow);
        return SGS_STATUS_OUT_OF_MEMORY;
    }
    JxlBasicInfo info;
    JxlEncoderInitBasicInfo(&info);
    info.xsize = (uint32_t)image->width;
    info.ysize = (uint32_t)image->height;
    info.bits_per_sample = image->wide ? 16 : 8;
    info.num_color_channels = (uint32_t)image->channels;
    info.uses_original_profile = JXL_TRUE;
    JxlColorEncoding color;
    JxlColorEncodingSetToSRGB(&color, image->channels == 1);
    const size_t pixel_bytes = (size_t)image->width * (size_t)image->height *
                               (size_t)image->channels * (image->wide ? 2 : 1);
    bool done = JxlEncoderSetBasicInfo(encoder, &info) == JXL_ENC_SUCCESS &&
                JxlEncoderSetColorEncoding(encoder, &color) == JXL_ENC_SUCCESS;
    JxlEncoderFrameSettings *settings = done ? JxlEncoderFrameSettingsCreate(encoder, NULL) : NULL;
    done = settings && JxlEncoderSetFrameLossless(settings, JXL_TRUE) == JXL_ENC_SUCCESS &&
           JxlEncoderFrameSettingsSetOption(settings, JXL_ENC_FRAME_SETTING_EFFORT, JXL_EFFORT) ==
               JXL_ENC_SUCCESS &&
           JxlEncoderAddImageFrame(settings, &format, pixels, pixel_bytes) == JXL_ENC_SUCCESS;
    if (done)
        JxlEncoderCloseInput(encoder);
    const sgs_status status = done ? jxl_collect(encoder, bytes, size) : SGS_STATUS_INTERNAL;
    JxlEncoderDestroy(encoder);
    free(narrow);
    return status;
}

static bool jxl_matches(const JxlDecoder *decoder, const sgsi_image16 *image)
{
    JxlBasicInfo info;
    return JxlDecoderGetBasicInfo(decoder, &info) == JXL_DEC_SUCCESS &&
           info.xsize == (uint32_t)image->width && info.ysize == (uint32_t)image->height &&
           info.num_color_channels == (uint32_t)image->channels && !info.alpha_bits &&
           info.num_extra_channels == 0 && !info.have_animation && !info.have_preview &&
           info.exponent_bits_per_sample == 0 && info.orientation == JXL_ORIENT_IDENTITY &&
           info.bits_per_sample == (image->wide ? 16u : 8u) && info.uses_original_profile;
}

// Reads up to the end of the first frame.
static bool jxl_read(JxlDecoder *decoder, const sgsi_image16 *image, void *out, size_t out_bytes)
{
    const JxlPixelFormat format = jxl_format(image);
    bool has_buffer = false;
    for (;;) {
        size_t needed;
        switch (JxlDecoderProcessInput(decoder)) {
        case JXL_DEC_BASIC_INFO:
            if (!jxl_matches(decoder, image))
                return false;
            break;
        case JXL_DEC_NEED_IMAGE_OUT_BUFFER:
            if (JxlDecoderImageOutBufferSize(decoder, &format, &needed) != JXL_DEC_SUCCESS ||
                needed != out_bytes ||
                JxlDecoderSetImageOutBuffer(decoder, &format, out, needed) != JXL_DEC_SUCCESS)
                return false;
            has_buffer = true;
            break;
        case JXL_DEC_FULL_IMAGE:
            return has_buffer;
        default:
            return false;
        }
    }
}

static bool jxl_decode(const uint8_t *bytes, size_t size, const sgsi_image16 *image)
{
    const size_t count = (size_t)image->width * (size_t)image->height * (size_t)image->channels;
    uint8_t *narrow = image->wide ? NULL : malloc(count);
    JxlDecoder *decoder = JxlDecoderCreate(NULL);
    bool done = decoder && (image->wide || narrow) &&
                JxlDecoderSubscribeEvents(decoder, JXL_DEC_BASIC_INFO | JXL_DEC_FULL_IMAGE) ==
                    JXL_DEC_SUCCESS &&
                JxlDecoderSetInput(decoder, bytes, size) == JXL_DEC_SUCCESS;
    if (done) {
        JxlDecoderCloseInput(decoder);
        done = image->wide ? jxl_read(decoder, image, image->pixels, 2 * count)
                           : jxl_read(decoder, image, narrow, count);
    }
    for (size_t i = 0; done && narrow && i < count; ++i)
        image->pixels[i] = narrow[i];
    if (decoder)
        JxlDecoderDestroy(decoder);
    free(narrow);
    return done;
}

// ---- WebP ----

// Moves the pixels to or from RGB bytes: rows of low bytes, then rows of high bytes.
static void webp_exchange(const sgsi_image16 *image, uint8_t *rgb, bool write)
{
    const size_t pixels = (size_t)image->width * (size_t)image->height,
                 channels = (size_t)image->channels;
    for (size_t part = 0; part < (image->wide ? 2u : 1u); ++part)
        for (size_t i = 0; i < pixels; ++i)
            for (size_t c = 0; c < channels; ++c) {
                uint8_t *byte = rgb + (part * pixels + i) * 3 + c;
                uint16_t *value = image->pixels + i * channels + c;
                if (write)
                    *byte = (uint8_t)(*value >> 8 * part);
                else
                    *value = (uint16_t)((part ? *value : 0) | *byte << 8 * part);
            }
}

static sgs_status webp_encode(const sgsi_image16 *image, uint8_t **bytes, size_t *size)
{
    const int rows = image->wide ? 2 * image->height : image->height;
    uint8_t *rgb = calloc((size_t)image->width * (size_t)rows, 3);
    WebPConfig config;
    WebPPicture picture;
    WebPMemoryWriter writer;
    if (!rgb || !WebPConfigInit(&config) || !WebPConfigLosslessPreset(&config, 6) ||
        !WebPPictureInit(&picture)) {
        const bool has_memory = rgb != NULL;
        free(rgb);
        return has_memory ? SGS_STATUS_INTERNAL : SGS_STATUS_OUT_OF_MEMORY;
    }
    webp_exchange(image, rgb, true);
    WebPMemoryWriterInit(&writer);
    picture.use_argb = 1;
    picture.width = image->width;
    picture.height = rows;
    picture.writer = WebPMemoryWrite;
    picture.custom_ptr = &writer;
    const bool done =
        WebPPictureImportRGB(&picture, rgb, 3 * image->width) && WebPEncode(&config, &picture);
    const bool memory = done || (picture.error_code != VP8_ENC_ERROR_OUT_OF_MEMORY &&
                                 picture.error_code != VP8_ENC_ERROR_BITSTREAM_OUT_OF_MEMORY);
    WebPPictureFree(&picture);
    free(rgb);
    if (done) {
        *bytes = malloc(writer.size);
        *size = writer.size;
        if (*bytes)
            memcpy(*bytes, writer.mem, writer.size);
    }
    WebPMemoryWriterClear(&writer);
    if (!memory || (done && !*bytes))
        return SGS_STATUS_OUT_OF_MEMORY;
    return done ? SGS_STATUS_OK : SGS_STATUS_INTERNAL;
}

static bool webp_decode(const uint8_t *bytes, size_t size, const sgsi_image16 *image)
{
    const int rows = image->wide ? 2 * image->height : image->height;
    WebPBitstreamFeatures features;
    if (WebPGetFeatures(bytes, size, &features) != VP8_STATUS_OK ||
        features.width != image->width || features.height != rows || features.format != 2)
        return false;
    const size_t room = (size_t)image->width * (size_t)rows * 3;
    uint8_t *rgb = malloc(room);
    const bool done = rgb && WebPDecodeRGBInto(bytes, size, rgb, room, 3 * image->width);
    if (done)
        webp_exchange(image, rgb, false);
    free(rgb);
    return done;
}

sgs_status sgsi_image_encode(sgs_image_codec codec, const sgsi_image16 *image, uint8_t **bytes,
                             size_t *size)
{
    *bytes = NULL;
    switch (codec) {
    case SGS_IMAGE_CODEC_JXL:
        return jxl_encode(image, bytes, size);
    case SGS_IMAGE_CODEC_WEBP:
        return webp_encode(image, bytes, size);
    case SGS_IMAGE_CODEC_EXR:
        return sgsi_exr_image_encode(image, bytes, size);
    }
    return SGS_STATUS_INTERNAL;
}

bool sgsi_image_decode(sgs_image_codec codec, const uint8_t *bytes, size_t size,
                       const sgsi_image16 *image)
{
    switch (codec) {
    case SGS_IMAGE_CODEC_JXL:
        return jxl_decode(bytes, size, image);
    case SGS_IMAGE_CODEC_WEBP:
        return webp_decode(bytes, size, image);
    case SGS_IMAGE_CODEC_EXR:
        return sgsi_exr_image_decode(bytes, size, image);
    }
    return false;
}
