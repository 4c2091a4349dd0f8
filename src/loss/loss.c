// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The photometric loss of 3DGS (Kerbl et al. 2023, equation 7), L = (1 - lambda) mean|I - G| +
// lambda (1 - mean SSIM) with the SSIM of Wang et al. 2004, and its gradient. Images with an alpha
// channel can add weight mean|(1 - T) - alpha|; others too, with alpha 1.
//
// This file runs the cells of the image (base/image_cells.h) on the threads and adds up their sums;
// loss_kernels.inl contains the mathematics. A cell recomputes a halo of ten pixels on every side,
// so cells are independent; small ones share it with a neighbour in the same call. Their division
// depends on the image size only and the sums are added along their curve, so the result does not
// depend on the number of threads.

#include "loss/loss.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "loss/loss_kernels.h"
#include "simd/kernel_variants.h"
#include "base/threads.h"

struct sgsi_loss_workspace {
    sgsi_loss_scratch *scratch; // one per thread
    size_t scratch_count;
    sgsi_cells cells;     // of the last image
    sgsi_loss_sums *sums; // one per cell
    size_t sums_count;
    float *column_weight, *row_weight;
    size_t column_count, row_count;
    double sigma; // of the window; 0 = none yet
    float window[LOSS_RADIUS + 1];
};

static const sgsi_loss_kernel kernels[SGS_ISA_COUNT] = SGSI_VARIANTS(sgsi_loss_block);

static double window_sum(const double weight[LOSS_RADIUS + 1])
{
    double sum = weight[0];
    for (int k = 1; k <= LOSS_RADIUS; ++k)
        sum += 2.0 * weight[k];
    return sum;
}

// exp(-k^2 / (2 sigma^2)), normalised. The shifted variance of the kernel relies on a sum of 1, but
// rounded to float the eleven weights can miss it by 1e-8. The smallest weight that is large enough
// absorbs such a difference; 1.4e-9, that of sigma 1.5, is left as it is.
static void make_window(double sigma, float window[LOSS_RADIUS + 1])
{
    const double tolerance = 2e-9;
    double weight[LOSS_RADIUS + 1];
    for (int k = 0; k <= LOSS_RADIUS; ++k)
        weight[k] = exp(-k * k / (2.0 * sigma * sigma));
    const double sum = window_sum(weight);
    for (int k = 0; k <= LOSS_RADIUS; ++k) {
        window[k] = (float)(weight[k] / sum);
        weight[k] = (double)window[k];
    }
    const double missing = 1.0 - window_sum(weight);
    if (fabs(missing) <= tolerance)
        return;
    int last = LOSS_RADIUS;
    while (last && weight[last] < 4.0 * fabs(missing))
        --last;
    if (last)
        window[last] += (float)(0.5 * missing);
}

// Makes the window of an input, unless it is the one in use.
static void set_window(sgsi_loss_workspace *workspace, const sgsi_loss_input *input)
{
    const double sigma = input->ssim_sigma > 0.0f ? (double)input->ssim_sigma : SGSI_SSIM_SIGMA;
    if (workspace->sigma == sigma)
        return;
    make_window(sigma, workspace->window);
    workspace->sigma = sigma;
}

sgs_status sgsi_loss_create(sgsi_loss_workspace **workspace)
{
    *workspace = sgsi_calloc(1, sizeof **workspace);
    if (!*workspace)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the loss");
    return SGS_STATUS_OK;
}

void sgsi_loss_destroy(sgsi_loss_workspace *workspace)
{
    if (!workspace)
        return;
    sgsi_free(workspace->scratch);
    sgsi_cells_free(&workspace->cells);
    sgsi_free(workspace->sums);
    sgsi_free(workspace->column_weight);
    sgsi_free(workspace->row_weight);
    sgsi_free(workspace);
}

static bool ensure(void **block, size_t *count, size_t needed, size_t size)
{
    if (needed <= *count)
        return true;
    void *fresh = sgsi_alloc(needed, size);
    if (!fresh)
        return false;
    sgsi_free(*block);
    *block = fresh;
    *count = needed;
    return true;
}

sgs_status sgsi_loss_reserve(sgsi_loss_workspace *workspace, int width, int height)
{
    if (width < 1 || height < 1)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "loss: invalid image size %d x %d", width,
                         height);
    sgsi_loss_workspace *w = workspace;
    if (!sgsi_cells_set(&w->cells, width, height) ||
        !ensure((void **)&w->scratch, &w->scratch_count, (size_t)sgsi_threads(),
                sizeof *w->scratch) ||
        !ensure((void **)&w->sums, &w->sums_count, w->cells.count, sizeof *w->sums) ||
        !ensure((void **)&w->column_weight, &w->column_count, (size_t)width,
                sizeof *w->column_weight) ||
        !ensure((void **)&w->row_weight, &w->row_count, (size_t)height, sizeof *w->row_weight))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the loss of a %d x %d image", width, height);
    return SGS_STATUS_OK;
}

// The share of the window inside [0, size) for every position; exactly 1 where the whole window is
// inside.
static void edge_weights(const float window[LOSS_RADIUS + 1], int size, float *weights)
{
    for (int x = 0; x < size; ++x) {
        if (x >= LOSS_RADIUS && x < size - LOSS_RADIUS) {
            weights[x] = 1.0f;
            continue;
        }
        double sum = 0.0;
        for (int k = -LOSS_RADIUS; k <= LOSS_RADIUS; ++k)
            if (x + k >= 0 && x + k < size)
                sum += (double)window[k < 0 ? -k : k];
        weights[x] = (float)sum;
    }
}

static sgs_status check(const sgsi_loss_input *input, const sgsi_loss_output *output)
{
    const sgs_photo *target = input->target;
    bool complete = input->transmittance && output->d_transmittance && target &&
                    (target->pixels || target->halves);
    for (int c = 0; c < 3; ++c)
        complete = complete && input->color[c] && output->d_color[c];
    if (!complete)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "loss: a required plane is NULL");
    if (target->width != input->width || target->height != input->height || target->channels < 3 ||
        target->channels > 4)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "loss: %d x %d image does not match the %d x %d target with %d channels",
                         input->width, input->height, target->width, target->height,
                         target->channels);
    if (input->stride % 16 || input->stride < (size_t)input->width)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "loss: stride of %zu floats is less than the width %d or not a multiple "
                         "of 16",
                         input->stride, input->width);
    return SGS_STATUS_OK;
}

typedef struct cell_loop {
    sgsi_loss_job job;
    sgsi_loss_kernel kernel;
    sgsi_loss_workspace *workspace;
    size_t first, last;
} cell_loop;

static bool is_wanted(const cell_loop *loop, size_t cell)
{
    return cell >= loop->first && cell < loop->last;
}

// Cells are visited in raster order, which is faster than the curve. Small ones are computed in
// pairs of an even column and the next one: a row of 64 pixels and its halo would fill vectors
// badly.
static void run_cell(void *context, size_t raster, int thread)
{
    const cell_loop *loop = context;
    sgsi_loss_workspace *w = loop->workspace;
    const sgsi_cells *cells = &w->cells;
    const int x = (int)raster % cells->cells_x;
    const bool is_small = 2 * cells->side <= SGSI_CELL_SIDE;
    const size_t cell = cells->position[raster];
    if (!is_wanted(loop, cell) ||
        (is_small && x % 2 && is_wanted(loop, cells->position[raster - 1])))
        return; // of another piece, or computed with its left neighbour
    sgsi_loss_item item = {
        .count = 1, .cell = {sgsi_cell_at(cells, cell)}, .sums = {&w->sums[cell]}};
    if (is_small && x % 2 == 0 && x + 1 < cells->cells_x &&
        is_wanted(loop, cells->position[raster + 1])) {
        const size_t right = cells->position[raster + 1];
        item.cell[1] = sgsi_cell_at(cells, right);
        item.sums[1] = &w->sums[right];
        item.count = 2;
    }
    loop->kernel(&loop->job, &item, &w->scratch[thread]);
}

sgs_status sgsi_loss_cells(sgsi_loss_workspace *workspace, const sgsi_loss_input *input,
                           size_t first, size_t last, sgsi_loss_output *output,
                           sgsi_loss_sums **sums)
{
    sgs_status status = sgsi_loss_reserve(workspace, input->width, input->height);
    if (status == SGS_STATUS_OK)
        status = check(input, output);
    if (status != SGS_STATUS_OK)
        return status;
    const double values = 3.0 * input->width * input->height, lambda = (double)input->ssim_weight;
    cell_loop loop = {
        .job = {.input = input,
                .output = output,
                .column_weight = workspace->column_weight,
                .row_weight = workspace->row_weight,
                .l1_scale = (float)((1.0 - lambda) / values),
                .ssim_scale = (float)(2.0 * lambda / values),
                .ceiling = input->target->is_hdr ? 1e9f : 1.0f,
                .alpha_scale = input->target->channels == 4 || input->opaque
                                   ? (float)(3.0 * (double)input->alpha_weight / values)
                                   : 0.0f},
        .kernel = kernels[sgs_isa_get()],
        .workspace = workspace,
        .first = first,
        .last = last,
    };
    set_window(workspace, input);
    memcpy(loop.job.window, workspace->window, sizeof workspace->window);
    edge_weights(workspace->window, input->width, workspace->column_weight);
    edge_weights(workspace->window, input->height, workspace->row_weight);
    sgsi_parallel_for(workspace->cells.count, 1, run_cell, &loop);
    *sums = workspace->sums;
    return SGS_STATUS_OK;
}

void sgsi_loss_total(const sgsi_loss_workspace *workspace, const sgsi_loss_input *input,
                     sgsi_loss_output *output)
{
    const double values = 3.0 * input->width * input->height, lambda = (double)input->ssim_weight;
    sgsi_loss_sums total = {0};
    for (size_t cell = 0; cell < workspace->cells.count; ++cell) {
        total.l1 += workspace->sums[cell].l1;
        total.square += workspace->sums[cell].square;
        total.dissimilarity += workspace->sums[cell].dissimilarity;
        total.alpha += workspace->sums[cell].alpha;
    }
    output->l1 = total.l1 / values;
    output->mse =
        total.square / (input->target->valid_mask ? 3.0 * (double)input->target->kept : values);
    output->ssim = 1.0 - total.dissimilarity / values;
    output->alpha = 3.0 * total.alpha / values;
    output->loss = (1.0 - lambda) * output->l1 + lambda * (1.0 - output->ssim) +
                   (double)input->alpha_weight * output->alpha;
}

sgs_status sgsi_loss_evaluate(sgsi_loss_workspace *workspace, const sgsi_loss_input *input,
                              sgsi_loss_output *output)
{
    sgs_status status = sgsi_loss_reserve(workspace, input->width, input->height);
    sgsi_loss_sums *sums;
    if (!status)
        status = sgsi_loss_cells(workspace, input, 0, workspace->cells.count, output, &sums);
    if (!status)
        sgsi_loss_total(workspace, input, output);
    return status;
}
