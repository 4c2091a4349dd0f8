// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Marks the public functions. The library is compiled with hidden visibility; a shared build
// exports what carries SGS_API and nothing else.

#if defined(__GNUC__) || defined(__clang__)
#define SGS_API __attribute__((visibility("default")))
#else
#define SGS_API
#endif
