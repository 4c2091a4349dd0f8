// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Weights of LPIPS from a file that tools/scripts/lpips_weights.py writes. Little endian:
//
//   8 bytes "SGSLPIPS"; uint32 version, 1; uint32 network, 0 = VGG16, 1 = AlexNet; uint32 number of
//   tensors; uint32 CRC-32 of everything after these 24 bytes
//   per tensor: four uint32, its shape; then its floats
//
// Tensors: per convolution the weights (out, in, kernel, kernel) in the order of PyTorch and the
// bias (out, 1, 1, 1); then the five heads (1, channels, 1, 1). Every shape is checked, so files
// with another order, another network or missing parts are refused.

#include <inttypes.h>
#include <libdeflate.h>
#include <math.h>
#include <string.h>

#include "base/core.h"
#include "image/lpips.h"

enum { VERSION = 1, HEADER = 24, SHAPE = 16, NETWORKS = 2 };

static const lpips_network networks[NETWORKS] = {
    {"vgg",
     13,
     2,
     16,
     {{3, 64, 3, 1, 1, false, false},
      {64, 64, 3, 1, 1, false, true},
      {64, 128, 3, 1, 1, true, false},
      {128, 128, 3, 1, 1, false, true},
      {128, 256, 3, 1, 1, true, false},
      {256, 256, 3, 1, 1, false, false},
      {256, 256, 3, 1, 1, false, true},
      {256, 512, 3, 1, 1, true, false},
      {512, 512, 3, 1, 1, false, false},
      {512, 512, 3, 1, 1, false, true},
      {512, 512, 3, 1, 1, true, false},
      {512, 512, 3, 1, 1, false, false},
      {512, 512, 3, 1, 1, false, true}}},
    {"alex",
     5,
     3,
     31,
     {{3, 64, 11, 4, 2, false, true},
      {64, 192, 5, 1, 2, true, true},
      {192, 384, 3, 1, 1, true, true},
      {384, 256, 3, 1, 1, false, true},
      {256, 256, 3, 1, 1, false, true}}},
};

typedef struct reader {
    const char *path;
    const uint8_t *bytes;
    size_t size, at;
    uint32_t tensor;
} reader;

static uint32_t read_u32(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 |
           (uint32_t)bytes[3] << 24;
}

static size_t tap_count(const lpips_convolution *c)
{
    return (size_t)c->in * (size_t)c->kernel * (size_t)c->kernel;
}

static size_t float_count(const lpips_network *network)
{
    size_t count = 0;
    for (int i = 0; i < network->count; ++i) {
        const lpips_convolution *c = &network->convolutions[i];
        count += (size_t)c->out * (tap_count(c) + 1 + (c->tapped ? 1 : 0));
    }
    return count;
}

// Checks the shape of the next tensor and sets *values to its first float.
static sgs_status read_shape(reader *r, const uint32_t shape[4], const uint8_t **values)
{
    uint32_t found[4];
    for (size_t k = 0; k < 4; ++k)
        found[k] = read_u32(r->bytes + r->at + 4 * k);
    if (memcmp(found, shape, sizeof found))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte %zu: tensor %" PRIu32 " has the shape %" PRIu32 "x%" PRIu32
                         "x%" PRIu32 "x%" PRIu32 ", expected %" PRIu32 "x%" PRIu32 "x%" PRIu32
                         "x%" PRIu32 "; write the file again with lpips_weights.py",
                         r->path, r->at, r->tensor, found[0], found[1], found[2], found[3],
                         shape[0], shape[1], shape[2], shape[3]);
    *values = r->bytes + r->at + SHAPE;
    r->at += SHAPE + 4 * (size_t)shape[0] * shape[1] * shape[2] * shape[3];
    return SGS_STATUS_OK;
}

// Copies a tensor of rows x columns; the element at (r, c) goes to out[index of group_order].
static sgs_status read_tensor(reader *r, const uint32_t shape[4], bool grouped, bool positive,
                              float *out)
{
    const uint8_t *bytes;
    const size_t start = r->at + SHAPE;
    const sgs_status status = read_shape(r, shape, &bytes);
    if (status)
        return status;
    const size_t columns = (size_t)shape[1] * shape[2] * shape[3], count = shape[0] * columns;
    for (size_t i = 0; i < count; ++i) {
        const uint32_t bits = read_u32(bytes + 4 * i);
        float value;
        memcpy(&value, &bits, sizeof value);
        if (!isfinite(value) || (positive && value < 0))
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: byte %zu: value %zu of tensor %" PRIu32 " is %s; use weights of "
                             "the published networks",
                             r->path, start + 4 * i, i, r->tensor,
                             isfinite(value) ? "negative" : "not finite");
        const size_t row = i / columns, column = i % columns;
        out[grouped ? (row / LPIPS_GROUP * columns + column) * LPIPS_GROUP + row % LPIPS_GROUP
                    : i] = value;
    }
    ++r->tensor;
    return SGS_STATUS_OK;
}

static sgs_status read_tensors(reader *r, sgs_lpips *lpips)
{
    const lpips_network *network = lpips->network;
    float *at = lpips->memory;
    for (int i = 0; i < network->count; ++i) {
        const lpips_convolution *c = &network->convolutions[i];
        const uint32_t out = (uint32_t)c->out, kernel = (uint32_t)c->kernel;
        const uint32_t weights[4] = {out, (uint32_t)c->in, kernel, kernel},
                       bias[4] = {out, 1, 1, 1};
        sgs_status status = read_tensor(r, weights, true, false, at);
        lpips->weights[i] = at;
        at += (size_t)c->out * tap_count(c);
        if (!status)
            status = read_tensor(r, bias, false, false, at);
        lpips->bias[i] = at;
        at += c->out;
        if (status)
            return status;
    }
    for (int i = 0, tap = 0; i < network->count; ++i) {
        const lpips_convolution *c = &network->convolutions[i];
        const uint32_t head[4] = {1, (uint32_t)c->out, 1, 1};
        if (!c->tapped)
            continue;
        const sgs_status status = read_tensor(r, head, false, true, at);
        if (status)
            return status;
        lpips->heads[tap++] = at;
        at += c->out;
    }
    return SGS_STATUS_OK;
}

// Checks the header and the size of the file. Sets *network.
static sgs_status read_header(reader *r, const lpips_network **network)
{
    if (r->size < HEADER || memcmp(r->bytes, "SGSLPIPS", 8))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: not a file of LPIPS weights; create one from the published .pth "
                         "files with lpips_weights.py",
                         r->path);
    const uint32_t version = read_u32(r->bytes + 8), id = read_u32(r->bytes + 12),
                   tensors = read_u32(r->bytes + 16);
    if (version != VERSION || id >= NETWORKS)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: version %" PRIu32 ", network %" PRIu32 "; supported: version %d, "
                         "networks 0 (vgg) and 1 (alex)",
                         r->path, version, id, VERSION);
    *network = &networks[id];
    const size_t count = 2 * (size_t)networks[id].count + LPIPS_TAPS,
                 size = HEADER + count * SHAPE + 4 * float_count(&networks[id]);
    if (tensors != count || r->size != size)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %zu bytes and %" PRIu32 " tensors; weights of %s have %zu bytes and "
                         "%zu tensors; %s",
                         r->path, r->size, tensors, networks[id].name, size, count,
                         r->size < size ? "the file is truncated" : "write it again");
    if (libdeflate_crc32(0, r->bytes + HEADER, r->size - HEADER) != read_u32(r->bytes + 20))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: the checksum differs; the file is damaged",
                         r->path);
    r->at = HEADER;
    return SGS_STATUS_OK;
}

// *out is released with sgs_lpips_destroy, after a failure too.
static sgs_status create(const char *path, const lpips_network *network, sgs_lpips **out)
{
    *out = sgsi_calloc(1, sizeof **out);
    if (*out) {
        (*out)->network = network;
        (*out)->memory = sgsi_alloc(float_count(network), sizeof(float));
    }
    if (*out && (*out)->memory)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for the weights", path);
}

sgs_status sgs_lpips_read(const char *path, sgs_lpips **out)
{
    *out = NULL;
    uint8_t *bytes = NULL;
    reader r = {.path = path};
    const lpips_network *network = &networks[0];
    sgs_status status = sgsi_file_read(path, (size_t)1 << 28, &bytes, &r.size);
    if (status)
        return status;
    r.bytes = bytes;
    sgs_lpips *lpips = NULL;
    status = read_header(&r, &network);
    if (!status)
        status = create(path, network, &lpips);
    if (!status)
        status = read_tensors(&r, lpips);
    sgsi_free(bytes);
    if (status)
        sgs_lpips_destroy(lpips);
    else
        *out = lpips;
    return status;
}

void sgs_lpips_destroy(sgs_lpips *lpips)
{
    if (!lpips)
        return;
    sgsi_free(lpips->memory);
    sgsi_free(lpips);
}

const char *sgs_lpips_network(const sgs_lpips *lpips)
{
    return lpips->network->name;
}

int sgs_lpips_min_size(const sgs_lpips *lpips)
{
    return lpips->network->smallest;
}
