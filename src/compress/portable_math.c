// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Argument reduction with the constant split in two parts, then Taylor polynomials by Horner's
// scheme: degree 14 on [-ln 2 / 2, ln 2 / 2], degrees 16 and 17 on [-pi/4, pi/4].

#include "compress/portable_math.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

// Parts of ln 2 and pi/2: the first has trailing zeros, so that its product with n is exact.
static const double LN2_HIGH = 6.93147180369123816490e-01, LN2_LOW = 1.90821492927058770002e-10;
static const double PI_2_HIGH = 1.57079632673412561417e+00, PI_2_LOW = 6.07710050650619224932e-11;

double sgsi_portable_expm1(double x)
{
    x = x > 0 ? (x < 700 ? x : 700) : 0;
    const double n = floor(x * 1.4426950408889634 + 0.5);
    const double r = (x - n * LN2_HIGH) - n * LN2_LOW;
    double series = 1; // (e^r - 1) / r
    for (int k = 14; k > 1; --k)
        series = 1 + series * r / k;
    const double rest = r * series;
    if (n == 0)
        return rest;
    const uint64_t bits = (uint64_t)(1023 + (int)n) << 52;
    double power;
    memcpy(&power, &bits, sizeof power);
    return (power - 1) + power * rest;
}

void sgsi_portable_sincos(double x, double *sine, double *cosine)
{
    x = x > -1000 ? (x < 1000 ? x : 1000) : -1000;
    const double n = floor(x * 0.63661977236758134 + 0.5);
    const double r = (x - n * PI_2_HIGH) - n * PI_2_LOW, square = r * r;
    double s = 1, c = 1;
    for (int k = 17; k > 1; k -= 2)
        s = 1 - s * square / (k * (k - 1));
    for (int k = 16; k > 0; k -= 2)
        c = 1 - c * square / (k * (k - 1));
    s *= r;
    switch ((int)n & 3) {
    case 0:
        *sine = s, *cosine = c;
        break;
    case 1:
        *sine = c, *cosine = -s;
        break;
    case 2:
        *sine = -s, *cosine = -c;
        break;
    default:
        *sine = -c, *cosine = s;
    }
}
