// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Adam on gradients accumulated over several iterations, separately for the SH bands above 0
// ("rest") and all other parameters ("main"). A row steps if any iteration since its group's last
// step saw it.

typedef struct accumulate_group {
    const sgsi_optimize *input;
    size_t base; // first float of the block in the model layout
    vm rows;     // rows with a valid gradient in this iteration
    bool steps;
    adam16 adam; // adam.rows: rows seen since the last step
} accumulate_group;

static inline accumulate_group open_group(const sgsi_optimize *input, size_t block, vm rows,
                                          bool rest)
{
    uint16_t *seen = &input->accumulated_rows[2 * block + rest];
    *seen |= (uint16_t)vm_bits(rows);
    accumulate_group group = {.input = input,
                              .base = block * SGS_PARAM_COUNT * 16,
                              .rows = rows,
                              .steps = rest ? input->step_rest : input->step_main};
    group.adam = (adam16){vf_set1(input->beta1),
                          vf_set1(input->beta2),
                          vf_set1(1.0f - input->beta1),
                          vf_set1(1.0f - input->beta2),
                          vf_set1(rest ? input->rest_correction2 : input->correction2),
                          vf_set1(input->epsilon),
                          rest ? input->rest_correction1 : input->correction1,
                          vm_from_bits(*seen)};
    if (group.steps)
        *seen = 0;
    return group;
}

static inline void accumulate(const accumulate_group *group, int k, vf gradient, float rate)
{
    const size_t at = group->base + 16 * (size_t)k;
    const vf sum =
        vf_add(vf_load(group->input->accumulated_grad + at), vf_keep(group->rows, gradient));
    vf_store(group->input->accumulated_grad + at, group->steps ? vf_zero() : sum);
    if (group->steps)
        adam_step(&group->adam, group->input->params + at, group->input->m + at,
                  group->input->v + at, vf_mul(sum, vf_set1(group->input->gradient_scale)), rate);
}

static inline void step_accumulated(const sgsi_optimize *input, size_t block, vm rows,
                                    const gradient16 *d)
{
    const accumulate_group rest = open_group(input, block, rows, true),
                           main = open_group(input, block, rows, false);
    for (int k = 0; k < 3; ++k)
        accumulate(&main, SGS_PARAM_MEAN + k, d->mean[k], input->lr_mean);
    for (int k = 0; k < 4; ++k)
        accumulate(&main, SGS_PARAM_ROTATION + k, d->rotation[k], input->lr_rotation);
    for (int k = 0; k < 3; ++k)
        accumulate(&main, SGS_PARAM_SCALE + k, d->scale[k], input->lr_scale);
    accumulate(&main, SGS_PARAM_OPACITY, d->opacity, input->lr_opacity);
    for (int c = 0; c < 3; ++c)
        accumulate(&main, SGS_PARAM_SH_DC + c, vf_mul(vf_set1((float)SGSI_SH_C0), d->color[c]),
                   input->lr_dc);
    vf basis[15];
    const int count = sh_basis(d->direction, input->view.sh_degree, basis);
    for (int k = 0; k < count; ++k)
        for (int c = 0; c < 3; ++c)
            accumulate(&rest, SGS_PARAM_SH_REST + 3 * k + c, vf_mul(basis[k], d->color[c]),
                       input->lr_rest);
}
