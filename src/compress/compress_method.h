// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What a compression method provides, and the services that all methods share. Rows are primitives
// with the parameters of SGS_PARAM_, opacity as logit.

#include "compress/container.h"
#include "sparegs/compress.h"

enum { SGSI_SOG_MAX_BITS = 15 }; // of a value of sog: 2^15 + 1 levels in 16 bits

typedef struct sgsi_compress_job {
    const sgs_compress_options *options; // complete: every field has its value
    sgs_render_options render;
    size_t count;
    int sh_degree;
    float *rows;      // [count][SGS_PARAM_COUNT]; the encoder may change them
    sgsi_packer *out; // its header holds method, version, input and sh_degree
} sgsi_compress_job;

typedef struct sgsi_compress_method {
    const char *name;
    uint32_t version; // of the layout that it writes
    uint32_t oldest;  // that it reads; 0: version
    // Fills in options that are 0. NULL: nothing to fill in.
    void (*defaults)(sgs_compress_options *options);
    // Sets out->header.count (and sh_degree if it changes) and adds the sections.
    sgs_status (*encode)(sgsi_compress_job *job);
    // Takes all sections, then creates the model with sgsi_decoded_create and fills it.
    sgs_status (*decode)(sgsi_container *in, sgs_gaussians **model);
} sgsi_compress_method;

extern const sgsi_compress_method sgsi_method_ghap, sgsi_method_sog, sgsi_method_lightgaussian,
    sgsi_method_mesongs, sgsi_method_fcgs_like;

// Calls the progress function of the caller. CANCELLED if it asks to stop.
sgs_status sgsi_compress_progress(const sgsi_compress_job *job, const char *stage, size_t done,
                                  size_t total);

// Warns if positions in 2^bits cells per axis from low to high are coarser than many primitives:
// one far primitive makes the cells of all large.
void sgsi_warn_about_cells(const sgsi_compress_job *job, const float low[3], const float high[3],
                           int bits);
// The same for rows with positions sign(x) ln(1 + |x|), which are stored with this step.
void sgsi_warn_about_log_cells(const sgsi_compress_job *job, double step);

// A model with header.count primitives, rows unset but finite. Call it after sgsi_container_finish:
// the sections prove that the primitives exist.
sgs_status sgsi_decoded_create(const sgsi_container *in, sgs_gaussians **model);

// Number of SH coefficients above band 0 of a degree, per channel: 0, 3, 8, 15.
static inline int sgsi_sh_rest_count(int sh_degree)
{
    return (sh_degree + 1) * (sh_degree + 1) - 1;
}

// The sections that store parameters as floats: one section, planar, [param_count][count].
void sgsi_pack_floats(sgsi_packer *out, const char *name, const float *rows, size_t count,
                      int param, int param_count, bool deflate);
sgs_status sgsi_unpack_floats(sgsi_container *in, const char *name, size_t count, int param_count,
                              const uint8_t **planes);
// Copies a section of sgsi_unpack_floats into a model.
void sgsi_planes_apply(const uint8_t *planes, int param, int param_count, sgs_gaussians *model);
