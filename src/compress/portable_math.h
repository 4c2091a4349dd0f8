// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Functions of decoders that give the same bits on every machine: the C library's exp and sin may
// differ between versions. Double precision, + - * and comparisons only, in a fixed order.

// e^x - 1 for x in [0, 700]; beyond, the value at the nearest end. Relative error below 1e-14.
double sgsi_portable_expm1(double x);

// Sine and cosine of x in [-1000, 1000] radians; absolute error below 1e-13.
void sgsi_portable_sincos(double x, double *sine, double *cosine);
