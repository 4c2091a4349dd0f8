// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Limits the memory of the photos that threads decode at the same time: a photo is decoded at the
// size of its file before it is reduced. One photo is always decoded, however large. Results do not
// depend on the limit. The functions may be called from any thread.

#include <stddef.h>

typedef struct sgsi_decode_limit sgsi_decode_limit;

// NULL if memory is exhausted.
sgsi_decode_limit *sgsi_decode_limit_create(size_t bytes);
void sgsi_decode_limit_destroy(sgsi_decode_limit *limit); // accepts NULL

// Waits until `bytes` more are admitted; call _end with the same number afterwards. A thread must
// not call _begin twice without _end. Both accept NULL, which admits all.
void sgsi_decode_begin(sgsi_decode_limit *limit, size_t bytes);
void sgsi_decode_end(sgsi_decode_limit *limit, size_t bytes);

// Peak of the bytes admitted, for tests.
size_t sgsi_decode_limit_peak(sgsi_decode_limit *limit);
