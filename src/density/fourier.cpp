// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// KissFFT's butterflies of 2, 3, 4 and 5 take O(n log n); a prime factor p takes O(n p). Therefore
// lengths with other factors use Bluestein's algorithm (Bluestein, 1970): with the chirp c_n =
// exp(-i pi n^2 / N), n k = (n^2 + k^2 - (k - n)^2) / 2 gives
//     X_k = c_k sum_n (x_n c_n) conj(c_(k-n)),
// a convolution, computed by transforms whose length M >= 2 N - 1 is a power of two.

#include "density/fourier.h"

#include <cmath>
#include <complex>
#include <cstdint>
#include <kissfft.hh>
#include <memory>
#include <new>
#include <vector>

using complex = std::complex<double>;

struct sgsi_fourier {
    std::size_t length, padded; // padded: M, or the length without a chirp
    kissfft<double> forward;
    std::vector<complex> chirp;  // [length]
    std::vector<complex> filter; // [padded]: transform of conj(chirp), divided by M
};

static bool has_small_factors(std::size_t n)
{
    for (const std::size_t factor : {2, 3, 5})
        while (n % factor == 0)
            n /= factor;
    return n == 1;
}

static void add_chirp(sgsi_fourier &plan)
{
    const std::size_t n = plan.length, m = plan.padded;
    plan.chirp.resize(n);
    std::vector<complex> wrapped(m);
    for (std::size_t i = 0; i < n; ++i) {
        // The square modulo 2 N keeps the angle small.
        const double angle =
            -M_PI * static_cast<double>(std::uint64_t{i} * i % (2 * n)) / static_cast<double>(n);
        plan.chirp[i] = {std::cos(angle), std::sin(angle)};
        wrapped[i] = wrapped[(m - i) % m] = std::conj(plan.chirp[i]) / static_cast<double>(m);
    }
    plan.filter.resize(m);
    plan.forward.transform(wrapped.data(), plan.filter.data());
}

sgsi_fourier *sgsi_fourier_create(int length)
{
    const std::size_t n = static_cast<std::size_t>(length);
    std::size_t padded = n;
    if (!has_small_factors(n))
        for (padded = 1; padded < 2 * n - 1; padded *= 2)
            ;
    try {
        auto plan = std::make_unique<sgsi_fourier>(
            sgsi_fourier{n, padded, kissfft<double>(padded, false), {}, {}});
        if (padded != n)
            add_chirp(*plan);
        return plan.release();
    } catch (const std::bad_alloc &) {
        return nullptr;
    }
}

void sgsi_fourier_destroy(sgsi_fourier *plan)
{
    delete plan;
}

size_t sgsi_fourier_scratch(const sgsi_fourier *plan)
{
    return 4 * plan->padded;
}

void sgsi_fourier_transform(const sgsi_fourier *plan, double *line, double *scratch)
{
    const std::size_t n = plan->length, m = plan->padded;
    complex *const x = reinterpret_cast<complex *>(line);
    complex *const a = reinterpret_cast<complex *>(scratch), *const b = a + m;
    if (n == 1) // KissFFT's general butterfly would write to a buffer that threads share
        return;
    if (m == n) {
        plan->forward.transform(x, a);
        for (std::size_t i = 0; i < n; ++i)
            x[i] = a[i];
        return;
    }
    for (std::size_t i = 0; i < m; ++i)
        a[i] = i < n ? x[i] * plan->chirp[i] : complex{};
    plan->forward.transform(a, b);
    // The inverse is the conjugate of the forward transform of the conjugate; 1 / M is in the
    // filter.
    for (std::size_t i = 0; i < m; ++i)
        a[i] = std::conj(b[i] * plan->filter[i]);
    plan->forward.transform(a, b);
    for (std::size_t i = 0; i < n; ++i)
        x[i] = std::conj(b[i]) * plan->chirp[i];
}
