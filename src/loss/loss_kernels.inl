// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The loss of one block of pixels and its gradient, written once for sixteen lanes. The including
// file defines SGSI_ISA and includes simd.h before this one.
//
// Per channel, with I the clamped image, G the target, w the 11 x 11 Gaussian window (zero outside
// the image, not renormalised), E[.] the convolution with w:
//
//   S = (2 m1 m2 + C1)(2 s12 + C2) / ((m1^2 + m2^2 + C1)(s1^2 + s2^2 + C2)),
//   m = E[.], s^2 = E[.^2] - m^2, s12 = E[IG] - m1 m2.
//
// Evaluated as written, this loses half of the digits of a float: E[I^2] - m^2 cancels, and near
// the end of training, when I is close to G, so do the numerator against the denominator and the
// three terms of the gradient against each other. The same function in terms of the difference e =
// I - G avoids this. With D = m1^2 + m2^2 + C1, F = s1^2 + s2^2 + C2, V = var(e) = E[e^2] - E[e]^2:
//
//   numerator / denominator = (D - E[e]^2)/D * (F - V)/F
//   =>  S = (1 - u)(1 - v),  u = E[e]^2 / D,  v = V / F,
//   1 - S = u (1 - v) + v,
//
// and only F still contains E[I^2] - m^2. There the values are shifted by 1/2, which quarters the
// squares. A shift preserves the variance only where the weights inside the image sum to W = 1; at
// the borders, with I' = I - 1/2 inside and zero outside, m = E[I'] + W/2 and
//
//   E[I^2] - m^2 = E[I'^2] - E[I']^2 + (1 - W)(E[I'] + W/4).
//
// Derivatives of S with respect to m1, E[e^2] and E[I^2] + E[G^2] as independent variables (E[e]
// moves with m1):
//
//   dS/dE[e^2]          = -b,  b = (1 - u) / F
//   dS/d(E[I^2]+E[G^2]) =  c,  c = (1 - u) v / F
//   dS/dm1              =  2a, a = (1 - u) E[e] / F - (1 - v) (E[e] / D)(1 - E[e] m1 / D) - m1 c
//
// and through the (symmetric) window dS/dI = 2 (conv(a) - e conv(b) + I conv(c)). Shifting m1 in a
// and I in the last term by the same 1/2 changes nothing, because conv is linear, and keeps both
// small: this is what the code computes.
//
// An invalid pixel is 1/2 in both images: all four source values are 0 there, as outside of the
// image, but it belongs to W. It influences no window and receives no gradient.
//
// Order of computation: four rows at a time down the block. Source rows (I', e, I'^2 + G'^2, e^2)
// -> vertical pass -> horizontal pass and the algebra above -> horizontal pass over a, b, c ->
// vertical pass -> gradient. All data is in rings of 16 rows, about 100 KB per thread. Neighbouring
// blocks recompute the halos, so that no intermediate plane is written to memory.

#include "image/half.h"
#include "loss/loss_kernels.h"

enum {
    GROUP = 4,
    TAPS = 2 * LOSS_RADIUS + 1,
    WINDOW_ROWS = GROUP + TAPS - 1,
    RING_MASK = LOSS_RING - 1
};

// One channel of one block.
typedef struct channel_block {
    const sgsi_loss_job *job;
    sgsi_loss_scratch *scratch;
    int channel;
    int x, y, width, height; // output rectangle
    int source_vectors, map_vectors, output_vectors;
    int cells, split; // output vectors of the first cell
    vf l1[LOSS_ITEM_CELLS], square[LOSS_ITEM_CELLS],
        dissimilarity[LOSS_ITEM_CELLS]; // running sums
} channel_block;

static inline vf load_bytes(const uint8_t *bytes, int count)
{
    if (count >= 16)
        return vf_load_u8(bytes);
    uint8_t padded[16] = {0};
    for (int i = 0; i < count; ++i)
        padded[i] = bytes[i];
    return vf_load_u8(padded);
}

// Image before the clamp: colour over the background.
static inline vf composite(const sgsi_loss_input *input, int channel, size_t at)
{
    return vf_fma(vf_load_u(input->transmittance + at), vf_set1(input->background[channel]),
                  vf_load_u(input->color[channel] + at));
}

// Half-float numbers; same result as sgsi_half_to_float.
static inline vf load_halves(const uint16_t *halves, int count)
{
    float values[16] __attribute__((aligned(64)));
    for (int i = 0; i < 16; ++i)
        values[i] = sgsi_half_to_float(i < count ? halves[i] : 0);
    return vf_load(values);
}

// Values of a target plane from element `at` on, of which `count` exist.
static inline vf load_values(const sgs_photo *target, size_t at, int count)
{
    return target->pixels ? vf_div(load_bytes(target->pixels + at, count), vf_set1(255.0f))
                          : load_halves(target->halves + at, count);
}

// Target values at 16 pixels, of which `count` exist; straight alpha over the background.
static inline vf load_target(const sgsi_loss_input *input, int channel, size_t at, int count)
{
    const sgs_photo *target = input->target;
    const size_t plane = (size_t)target->width * (size_t)target->height;
    const vf value = load_values(target, plane * (size_t)channel + at, count);
    if (target->channels < 4)
        return value;
    const vf alpha = load_values(target, plane * 3 + at, count);
    const vf background = vf_set1(input->background[channel]);
    return vf_fma(alpha, vf_sub(value, background), background);
}

// Mask of the pixels x + 0...15 of row y that exist and are valid; x is a multiple of 16, `count`
// of them exist.
static inline vm counted(const sgsi_loss_input *input, int x, int y, int count)
{
    const unsigned exist = count >= 16 ? 0xFFFFu : (1u << count) - 1;
    const uint16_t *valid_mask = input->target->valid_mask;
    return vm_from_bits(
        valid_mask ? exist & valid_mask[(size_t)y * sgs_mask_words(input->width) + (size_t)x / 16]
                   : exist);
}

// Source row number `row` of the block (0 is 10 above its first output row) into the rings.
static void load_row(const channel_block *block, int row)
{
    const sgsi_loss_input *input = block->job->input;
    const int y = block->y - 2 * LOSS_RADIUS + row;
    float *const shifted = block->scratch->source[0][row & RING_MASK];
    float *const error = block->scratch->source[1][row & RING_MASK];
    float *const power = block->scratch->source[2][row & RING_MASK];
    float *const error2 = block->scratch->source[3][row & RING_MASK];
    const vf half = vf_set1(0.5f), ceiling = vf_set1(block->job->ceiling);
    for (int k = 0; k < block->source_vectors; ++k) {
        const int x = block->x - LOSS_MARGIN + 16 * k;
        const int count = input->width - x;
        vf i = vf_zero(), e = vf_zero(), q = vf_zero();
        if (y >= 0 && y < input->height && x >= 0 && count > 0) {
            const size_t at = (size_t)y * input->stride + (size_t)x;
            const size_t pixel = (size_t)y * (size_t)input->width + (size_t)x;
            const vf value = vf_clamp(composite(input, block->channel, at), vf_zero(), ceiling);
            // Neighbouring rows are on other pages, which hardware does not prefetch.
            __builtin_prefetch(input->color[block->channel] + at + GROUP * input->stride);
            __builtin_prefetch(input->transmittance + at + GROUP * input->stride);
            const vf target = load_target(input, block->channel, pixel, count);
            const vm real = counted(input, x, y, count); // invalid pixels: i = e = 0
            const vf g = vf_sub(target, half);
            i = vf_keep(real, vf_sub(value, half));
            e = vf_keep(real, vf_sub(value, target));
            q = vf_keep(real, vf_fma(i, i, vf_mul(g, g)));
        }
        vf_store(shifted + 16 * k, i);
        vf_store(error + 16 * k, e);
        vf_store(power + 16 * k, q);
        vf_store(error2 + 16 * k, vf_mul(e, e));
    }
}

// Applies the window vertically to 14 ring rows starting at `first`, for four neighbouring output
// rows of one column of vectors.
static inline void convolve_down(const float *ring, size_t pitch, int first,
                                 const vf window[LOSS_RADIUS + 1], vf out[GROUP])
{
#pragma GCC unroll 16
    for (int row = 0; row < WINDOW_ROWS; ++row) {
        const vf value = vf_load(ring + (size_t)((first + row) & RING_MASK) * pitch);
#pragma GCC unroll 4
        for (int r = 0; r < GROUP; ++r) {
            const int tap = row - r;
            if (tap == 0)
                out[r] = vf_mul(value, window[LOSS_RADIUS]);
            else if (tap > 0 && tap < TAPS)
                out[r] =
                    vf_fma(value, window[tap < LOSS_RADIUS ? LOSS_RADIUS - tap : tap - LOSS_RADIUS],
                           out[r]);
        }
    }
}

// Applies the window along a row; `line` points at the leftmost tap of the first lane.
static inline vf convolve_along(const float *line, const vf window[LOSS_RADIUS + 1])
{
    vf sum = vf_mul(vf_load_u(line + LOSS_RADIUS), window[0]);
#pragma GCC unroll 5
    for (int k = 1; k <= LOSS_RADIUS; ++k)
        sum = vf_fma(vf_add(vf_load_u(line + LOSS_RADIUS - k), vf_load_u(line + LOSS_RADIUS + k)),
                     window[k], sum);
    return sum;
}

static inline void load_window(const sgsi_loss_job *job, vf window[LOSS_RADIUS + 1])
{
    for (int k = 0; k <= LOSS_RADIUS; ++k)
        window[k] = vf_set1(job->window[k]);
}

// Vertical pass over the source rings: moments of the four map rows that start at map row `first`.
static void moments_down(const channel_block *block, int first)
{
    sgsi_loss_scratch *s = block->scratch;
    vf window[LOSS_RADIUS + 1];
    load_window(block->job, window);
    for (int plane = 0; plane < 4; ++plane)
        for (int k = 0; k < block->source_vectors; ++k) {
            vf out[GROUP];
            convolve_down(&s->source[plane][0][16 * k], LOSS_SOURCE_PITCH, first, window, out);
            for (int r = 0; r < GROUP; ++r)
                vf_store(&s->moment[plane][r][16 * k], out[r]);
        }
}

// 1 - S and the derivatives a, b, c from the moments of 16 pixels; `weight` is W.
static inline vf similarity(vf shifted, vf error, vf power, vf error2, vf weight, vf *a, vf *b,
                            vf *c)
{
    const vf one = vf_set1(1.0f), half = vf_set1(0.5f);
    const vf missing = vf_sub(one, weight);
    const vf target = vf_sub(shifted, error);
    const vf m1 = vf_fma(half, weight, shifted);
    const vf m2 = vf_sub(m1, error);
    const vf border = vf_mul(missing, vf_fma(half, weight, vf_add(shifted, target)));
    const vf d = vf_fma(m1, m1, vf_fma(m2, m2, vf_set1(1e-4f)));
    const vf variances = vf_fnma(shifted, shifted, vf_fnma(target, target, power));
    // The variance v0 of the error is at least 0, and F at least C2 + v0 / 2. Far above white, the
    // rounding of the moments exceeds C2 = 9e-4 on flat areas.
    const vf v0 = vf_max(vf_fnma(error, error, error2), vf_set1(-1e-6f));
    const vf f = vf_max(vf_add(vf_add(variances, border), vf_set1(9e-4f)),
                        vf_fma(v0, half, vf_set1(8.9e-4f)));
    const vf inverse = vf_div(one, vf_mul(d, f));
    const vf inverse_d = vf_mul(inverse, f), inverse_f = vf_mul(inverse, d);
    const vf slope = vf_mul(error, inverse_d);
    const vf u = vf_mul(error, slope), v = vf_mul(v0, inverse_f);
    const vf rest_u = vf_sub(one, u), rest_v = vf_sub(one, v);
    *b = vf_mul(rest_u, inverse_f);
    *c = vf_mul(*b, v);
    const vf contrast = vf_mul(error, *b);
    const vf luminance = vf_mul(vf_mul(rest_v, slope), vf_fnma(slope, m1, one));
    const vf m1_shifted = vf_fnma(half, missing, shifted);
    *a = vf_fnma(m1_shifted, *c, vf_sub(contrast, luminance));
    return vf_fma(u, rest_v, v);
}

// Map row `row` (0 is 5 above the first output row; r of its group of four): the horizontal pass
// over the moments, the algebra, and the horizontal pass over the derivatives.
static void map_row(channel_block *block, int row, int r)
{
    sgsi_loss_scratch *s = block->scratch;
    const int y = block->y - LOSS_RADIUS + row;
    vf window[LOSS_RADIUS + 1];
    if (y < 0 || y >= block->job->input->height) {
        for (int plane = 0; plane < 3; ++plane)
            for (int k = 0; k < block->output_vectors; ++k)
                vf_store(&s->smooth[plane][row & RING_MASK][16 * k], vf_zero());
        return;
    }
    load_window(block->job, window);
    const vf row_weight = vf_set1(block->job->row_weight[y]);
    const int own_row = row >= LOSS_RADIUS && row < LOSS_RADIUS + block->height;
    for (int k = 0; k < block->map_vectors; ++k) {
        const int left =
            LOSS_MARGIN - 2 * LOSS_RADIUS + 16 * k; // leftmost tap of map column -5 + 16 k
        vf moment[4], a, b, c;
        for (int plane = 0; plane < 4; ++plane)
            moment[plane] = convolve_along(&s->moment[plane][r][left], window);
        const vf weight = vf_mul(row_weight, vf_load(s->edge + 16 * k));
        const vf lost = similarity(moment[0], moment[1], moment[2], moment[3], weight, &a, &b, &c);
        const vm inside = vm_from_bits(s->inside[k]);
        vf_store(&s->map[0][16 * k], vf_keep(inside, a));
        vf_store(&s->map[1][16 * k], vf_keep(inside, b));
        vf_store(&s->map[2][16 * k], vf_keep(inside, c));
        // Map vectors begin five columns to the left of output vectors: one of them may overlap
        // both cells.
        if (own_row && k <= block->split)
            block->dissimilarity[0] =
                vf_add(block->dissimilarity[0], vf_keep(vm_from_bits(s->own[0][k]), lost));
        if (own_row && k >= block->split && block->cells > 1)
            block->dissimilarity[1] =
                vf_add(block->dissimilarity[1], vf_keep(vm_from_bits(s->own[1][k]), lost));
    }
    for (int plane = 0; plane < 3; ++plane)
        for (int k = 0; k < block->output_vectors; ++k)
            vf_store(&s->smooth[plane][row & RING_MASK][16 * k],
                     convolve_along(&s->map[plane][16 * k], window));
}

// Adds the contribution of this channel to dL/dT; the first channel overwrites.
static inline void store_gradient(const channel_block *block, size_t at, vf gradient)
{
    sgsi_loss_output *output = block->job->output;
    const vf background = vf_set1(block->job->input->background[block->channel]);
    vf_store_u(output->d_color[block->channel] + at, gradient);
    if (block->channel)
        gradient = vf_fma(background, gradient, vf_load_u(output->d_transmittance + at));
    else
        gradient = vf_mul(background, gradient);
    vf_store_u(output->d_transmittance + at, gradient);
}

// Vertical pass over the derivatives and the gradient of the output rows [first, first + 4) of the
// block.
static void gradient_rows(channel_block *block, int first)
{
    const sgsi_loss_job *job = block->job;
    const sgsi_loss_input *input = job->input;
    sgsi_loss_scratch *s = block->scratch;
    const vf zero = vf_zero(), ceiling = vf_set1(job->ceiling);
    const vf l1_scale = vf_set1(job->l1_scale), ssim_scale = vf_set1(job->ssim_scale);
    vf window[LOSS_RADIUS + 1];
    load_window(job, window);
    for (int k = 0; k < block->output_vectors; ++k) {
        vf a[GROUP], b[GROUP], c[GROUP];
        convolve_down(&s->smooth[0][0][16 * k], LOSS_BLOCK_WIDTH, first, window, a);
        convolve_down(&s->smooth[1][0][16 * k], LOSS_BLOCK_WIDTH, first, window, b);
        convolve_down(&s->smooth[2][0][16 * k], LOSS_BLOCK_WIDTH, first, window, c);
        const int count = block->width - 16 * k, cell = k >= block->split;
        vf l1 = block->l1[cell], square = block->square[cell];
        for (int r = 0; r < GROUP && first + r < block->height; ++r) {
            const vm real = counted(input, block->x + 16 * k, block->y + first + r, count);
            const int slot = (first + r + 2 * LOSS_RADIUS) & RING_MASK;
            const size_t at =
                (size_t)(block->y + first + r) * input->stride + (size_t)(block->x + 16 * k);
            const vf i = vf_load(&s->source[0][slot][LOSS_MARGIN + 16 * k]);
            const vf e = vf_load(&s->source[1][slot][LOSS_MARGIN + 16 * k]);
            const vf e2 = vf_load(&s->source[3][slot][LOSS_MARGIN + 16 * k]);
            const vf sign =
                vf_sub(vf_keep(vf_gt(e, zero), l1_scale), vf_keep(vf_lt(e, zero), l1_scale));
            const vf ssim = vf_fma(i, c[r], vf_fnma(e, b[r], a[r]));
            const vf value = composite(input, block->channel, at);
            const vm free = vm_and(real, vm_and(vf_ge(value, zero), vf_le(value, ceiling)));
            store_gradient(block, at, vf_keep(free, vf_fnma(ssim_scale, ssim, sign)));
            l1 = vf_add(l1, vf_abs(e));
            square = vf_add(square, e2);
        }
        block->l1[cell] = l1;
        block->square[cell] = square;
    }
}

// Lane masks and edge weights of the map columns, the same for all rows and channels.
static void prepare_columns(const channel_block *block)
{
    const sgsi_loss_job *job = block->job;
    for (int k = 0; k < block->map_vectors; ++k) {
        unsigned inside = 0, own[LOSS_ITEM_CELLS] = {0};
        for (int lane = 0; lane < 16; ++lane) {
            const int column = 16 * k + lane - LOSS_RADIUS, x = block->x + column;
            const int exists = x >= 0 && x < job->input->width;
            inside |= (unsigned)exists << lane;
            own[column >= 16 * block->split] |= (unsigned)(column >= 0 && column < block->width)
                                                << lane;
            block->scratch->edge[16 * k + lane] = exists ? job->column_weight[x] : 0.0f;
        }
        block->scratch->inside[k] = inside;
        for (int cell = 0; cell < LOSS_ITEM_CELLS; ++cell)
            block->scratch->own[cell][k] = own[cell];
    }
}

// Clears the columns between width and stride, which belong to the last block of a row.
static void clear_padding(const channel_block *block)
{
    const sgsi_loss_job *job = block->job;
    const size_t stride = job->input->stride;
    const int begin = block->x + 16 * block->output_vectors;
    if (block->x + block->width < job->input->width)
        return;
    for (int y = block->y; y < block->y + block->height; ++y)
        for (size_t x = (size_t)begin; x < stride; x += 16) {
            const size_t at = (size_t)y * stride + x;
            vf_store_u(job->output->d_color[block->channel] + at, vf_zero());
            vf_store_u(job->output->d_transmittance + at, vf_zero());
        }
}

// The alpha term of a cell: |(1 - T) - alpha| and its derivative with respect to T.
static void run_alpha(const sgsi_loss_job *job, sgsi_cell_rect cell, sgsi_loss_sums *sums)
{
    const sgsi_loss_input *input = job->input;
    const size_t plane = (size_t)input->width * (size_t)input->height;
    const vf zero = vf_zero(), one = vf_set1(1.0f), scale = vf_set1(job->alpha_scale);
    const float *transmittance =
        input->alpha_transmittance ? input->alpha_transmittance : input->transmittance;
    float *d_transmittance = job->output->d_transmittance;
    for (int y = cell.y; y < cell.y + cell.height; ++y) {
        vf total = zero;
        for (int x = cell.x; x < cell.x + cell.width; x += 16) {
            const int count = cell.x + cell.width - x;
            const size_t at = (size_t)y * input->stride + (size_t)x,
                         pixel = (size_t)y * (size_t)input->width + (size_t)x;
            const vf alpha = input->target->channels == 4
                                 ? load_values(input->target, 3 * plane + pixel, count)
                                 : one;
            const vf opacity = vf_sub(one, vf_load_u(transmittance + at));
            const vf e = vf_keep(counted(input, x, y, count), vf_sub(opacity, alpha));
            const vf slope = vf_sub(vf_keep(vf_lt(e, zero), scale), vf_keep(vf_gt(e, zero), scale));
            vf_store_u(d_transmittance + at, vf_add(vf_load_u(d_transmittance + at), slope));
            total = vf_add(total, vf_abs(e));
        }
        sums->alpha += (double)vf_sum(total);
    }
}

static void run_channel(channel_block *block, const sgsi_loss_item *item)
{
    const int groups = (block->height + GROUP - 1) / GROUP;
    for (int row = 0; row < 2 * LOSS_RADIUS; ++row)
        load_row(block, row);
    // Gradient group g needs 14 map rows, so map groups run three ahead of it.
    for (int group = 0; group < groups + 3; ++group) {
        for (int r = 0; r < GROUP; ++r)
            load_row(block, GROUP * group + 2 * LOSS_RADIUS + r);
        moments_down(block, GROUP * group);
        for (int cell = 0; cell < LOSS_ITEM_CELLS; ++cell)
            block->l1[cell] = block->square[cell] = block->dissimilarity[cell] = vf_zero();
        for (int r = 0; r < GROUP; ++r)
            map_row(block, GROUP * group + r, r);
        if (group >= 3)
            gradient_rows(block, GROUP * (group - 3));
        for (int cell = 0; cell < item->count; ++cell) {
            item->sums[cell]->l1 += (double)vf_sum(block->l1[cell]);
            item->sums[cell]->square += (double)vf_sum(block->square[cell]);
            item->sums[cell]->dissimilarity += (double)vf_sum(block->dissimilarity[cell]);
        }
    }
    clear_padding(block);
}

void SGSI_KERNEL(sgsi_loss_block)(const sgsi_loss_job *job, const sgsi_loss_item *item,
                                  sgsi_loss_scratch *scratch)
{
    channel_block block = {.job = job,
                           .scratch = scratch,
                           .x = item->cell[0].x,
                           .y = item->cell[0].y,
                           .width = item->cell[0].width,
                           .height = item->cell[0].height,
                           .cells = item->count,
                           .split = (item->cell[0].width + 15) / 16};
    if (item->count > 1)
        block.width += item->cell[1].width;
    block.output_vectors = (block.width + 15) / 16;
    block.map_vectors = block.output_vectors + 1;
    block.source_vectors = block.output_vectors + 2;
    for (int cell = 0; cell < item->count; ++cell)
        *item->sums[cell] = (sgsi_loss_sums){0};
    prepare_columns(&block);
    for (block.channel = 0; block.channel < 3; ++block.channel)
        run_channel(&block, item);
    for (int cell = 0; cell < item->count && job->alpha_scale > 0.0f; ++cell)
        run_alpha(job, item->cell[cell], item->sums[cell]);
}
