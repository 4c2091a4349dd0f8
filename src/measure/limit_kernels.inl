// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Two multiply-adds issue per cycle with a latency of four or five, so the peak needs ten chains in
// flight. A group is as many chains as fit in the registers next to the constants. Chains of a
// group run together, groups one after the other. The values come from the caller: the compiler
// would compute equal registers only once.

#if SGSI_ISA == 2
enum { GROUP_CHAINS = 12 };
#elif SGSI_ISA == 1
enum { GROUP_CHAINS = 6 };
#else
enum { GROUP_CHAINS = 3 };
#endif

static void multiply_add(size_t rounds, const float *start, float factor, float term, float *out)
{
    const vf x = vf_set1(factor), y = vf_set1(term);
    vf total = vf_zero();
    for (size_t first = 0; first < SGSI_LIMIT_CHAINS; first += GROUP_CHAINS) {
        vf chain[GROUP_CHAINS];
        for (size_t k = 0; k < GROUP_CHAINS; ++k)
            chain[k] = vf_load(start + 16 * (first + k));
        for (size_t i = 0; i < rounds; ++i)
            for (size_t k = 0; k < GROUP_CHAINS; ++k)
                chain[k] = vf_fma(chain[k], x, y);
        for (size_t k = 0; k < GROUP_CHAINS; ++k)
            total = vf_add(total, chain[k]);
    }
    vf_store(out, total);
}

static void read_all(const float *data, size_t floats, float *out)
{
    vf sums[4] = {vf_zero(), vf_zero(), vf_zero(), vf_zero()};
    for (size_t i = 0; i < floats; i += 128)
        for (size_t k = 0; k < 8; ++k)
            sums[k % 4] = vf_add(sums[k % 4], vf_load(data + i + 16 * k));
    vf_store(out, vf_add(vf_add(sums[0], sums[1]), vf_add(sums[2], sums[3])));
}

static void update_all(float *data, size_t floats)
{
    const vf x = vf_set1(0.999999f);
    for (size_t i = 0; i < floats; i += 128)
        for (size_t k = 0; k < 8; ++k)
            vf_store(data + i + 16 * k, vf_mul(vf_load(data + i + 16 * k), x));
}

const sgsi_limit_kernels SGSI_KERNEL(sgsi_limit_kernels) = {multiply_add, read_all, update_all};
