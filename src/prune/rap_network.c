// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The network of RAP (Yang et al., "RAP: Fast Feedforward Rendering-Free Attribute-Guided Primitive
// Importance Score Prediction for Efficient 3D Gaussian Splatting", CVPR 2026): 15 -> 32 -> 32 ->
// 16 -> 2 with ReLU between the layers and softmax at the end; the score is the first output. Its
// weights are not part of this library; they are read from the file of its authors.
//
// The file is written by torch.save: a zip archive without compression, one entry PREFIX/data/K per
// tensor, little-endian floats, K = 0 to 7: weights [out][in] and biases of the four layers. Only
// the archive is read, not the Python objects in it: sizes and checksums identify the network.

#include <libdeflate.h>
#include <math.h>
#include <string.h>

#include "base/core.h"
#include "sparegs/prune.h"

enum {
    LAYERS = 4,
    WIDEST = 32,
    TENSORS = 2 * LAYERS,
    END_BYTES = 22,   // end of the central directory, without comment
    ENTRY_BYTES = 46, // entry of the central directory, without name
    LOCAL_BYTES = 30, // header of an entry's data
    MAX_BYTES = 1 << 26,
};

static const int widths[LAYERS + 1] = {SGS_RAP_FEATURES, 32, 32, 16, 2};

struct sgs_rap_network {
    float weights[LAYERS][WIDEST][WIDEST]; // [layer][out][in]
    float biases[LAYERS][WIDEST];
};

typedef struct archive {
    const char *path;
    const uint8_t *bytes;
    size_t size;
} archive;

static uint32_t get16(const uint8_t *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8;
}

static uint32_t get32(const uint8_t *p)
{
    return get16(p) | get16(p + 2) << 16;
}

static sgs_status fail_archive(const archive *a, const char *what)
{
    return sgsi_fail(SGS_STATUS_FORMAT,
                     "%s: %s; expected the network file of RAP's authors (net_f15.pth)", a->path,
                     what);
}

// The index of a tensor, K of a name that ends in "/data/K"; -1 for other entries.
static int tensor_of(const uint8_t *name, size_t length)
{
    static const char folder[] = "/data/";
    const size_t tail = sizeof folder - 1;
    if (length < tail + 1 || memcmp(name + length - tail - 1, folder, tail) != 0)
        return -1;
    const int k = name[length - 1] - '0';
    return k >= 0 && k < TENSORS ? k : -1;
}

static size_t tensor_bytes(int k)
{
    const int out = widths[k / 2 + 1], in = widths[k / 2];
    return (size_t)out * (k % 2 ? 1 : (size_t)in) * sizeof(float);
}

// Copies the tensor of one entry of the central directory.
static sgs_status read_tensor(const archive *a, const uint8_t *entry, int k,
                              sgs_rap_network *network)
{
    const size_t bytes = tensor_bytes(k), header = get32(entry + 42);
    if (get16(entry + 10) != 0)
        return fail_archive(a, "an entry of the archive is compressed");
    if (get32(entry + 20) != bytes || get32(entry + 24) != bytes)
        return fail_archive(a, "a tensor does not have the size in this network");
    if (header + LOCAL_BYTES > a->size || get32(a->bytes + header) != 0x04034B50u)
        return fail_archive(a, "the archive is damaged");
    const size_t at =
        header + LOCAL_BYTES + get16(a->bytes + header + 26) + get16(a->bytes + header + 28);
    if (at > a->size || a->size - at < bytes)
        return fail_archive(a, "the archive is truncated");
    if (libdeflate_crc32(0, a->bytes + at, bytes) != get32(entry + 16))
        return fail_archive(a, "the checksum of a tensor is wrong");
    const int in = k % 2 ? 1 : widths[k / 2];
    for (size_t i = 0; i < bytes / sizeof(float); ++i) {
        const uint32_t bits = get32(a->bytes + at + 4 * i);
        float value;
        memcpy(&value, &bits, sizeof value);
        if (!isfinite(value))
            return fail_archive(a, "a weight is not finite");
        if (k % 2)
            network->biases[k / 2][i] = value;
        else
            network->weights[k / 2][i / (size_t)in][i % (size_t)in] = value;
    }
    return SGS_STATUS_OK;
}

// The end record of the central directory; NULL if there is none. A comment may follow it.
static const uint8_t *find_end(const archive *a)
{
    for (size_t back = END_BYTES; back <= a->size && back <= END_BYTES + 65535u; ++back) {
        const uint8_t *end = a->bytes + a->size - back;
        if (get32(end) == 0x06054B50u && get16(end + 20) + END_BYTES == back)
            return end;
    }
    return NULL;
}

static sgs_status read_archive(const archive *a, sgs_rap_network *network)
{
    const uint8_t *end = find_end(a);
    if (!end)
        return fail_archive(a, "not a zip archive");
    bool found[TENSORS] = {false};
    size_t at = get32(end + 16);
    const size_t limit = (size_t)(end - a->bytes);
    for (uint32_t left = get16(end + 10); left > 0; --left) {
        if (at > limit || limit - at < ENTRY_BYTES || get32(a->bytes + at) != 0x02014B50u)
            return fail_archive(a, "the directory of the archive is damaged");
        const uint8_t *entry = a->bytes + at;
        const size_t name = get16(entry + 28);
        const size_t bytes = ENTRY_BYTES + name + get16(entry + 30) + get16(entry + 32);
        if (limit - at < bytes)
            return fail_archive(a, "the directory of the archive is damaged");
        at += bytes;
        const int k = tensor_of(entry + ENTRY_BYTES, name);
        if (k < 0)
            continue;
        if (found[k])
            return fail_archive(a, "a tensor occurs twice");
        const sgs_status status = read_tensor(a, entry, k, network);
        if (status)
            return status;
        found[k] = true;
    }
    for (int k = 0; k < TENSORS; ++k)
        if (!found[k])
            return fail_archive(a, "a tensor is missing");
    return SGS_STATUS_OK;
}

sgs_status sgs_rap_read(const char *path, sgs_rap_network **network)
{
    *network = NULL;
    uint8_t *bytes;
    archive a = {.path = path};
    sgs_status status = sgsi_file_read(path, MAX_BYTES, &bytes, &a.size);
    if (status)
        return status;
    a.bytes = bytes;
    sgs_rap_network *made = sgsi_calloc(1, sizeof *made);
    status =
        made ? read_archive(&a, made)
             : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for the network", path);
    sgsi_free(bytes);
    if (status) {
        sgsi_free(made);
        return status;
    }
    *network = made;
    return SGS_STATUS_OK;
}

void sgs_rap_destroy(sgs_rap_network *network)
{
    sgsi_free(network);
}

double sgs_rap_score(const sgs_rap_network *network, const float features[SGS_RAP_FEATURES])
{
    double values[WIDEST] = {0}, next[WIDEST] = {0};
    for (int i = 0; i < SGS_RAP_FEATURES; ++i)
        values[i] = (double)features[i];
    for (int layer = 0; layer < LAYERS; ++layer) {
        for (int out = 0; out < widths[layer + 1]; ++out) {
            double sum = (double)network->biases[layer][out];
            for (int in = 0; in < widths[layer]; ++in)
                sum += (double)network->weights[layer][out][in] * values[in];
            next[out] = layer + 1 < LAYERS && sum < 0 ? 0 : sum;
        }
        memcpy(values, next, sizeof values);
    }
    return 1 / (1 + exp(values[1] - values[0])); // softmax of two
}
