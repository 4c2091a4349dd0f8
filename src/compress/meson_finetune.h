// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Fine-tuning of MesonGS through its quantiser.

#include "compress/compress_method.h"
#include "compress/meson_codec.h"

// Trains values and codebook for `iterations` steps on the training views of the job's scene and
// leaves the state with the best PSNR over them, quantised.
sgs_status sgsi_meson_finetune(const sgsi_compress_job *job, sgsi_meson *meson, int iterations);

// Learning rate of value `value` < SGSI_MESON_VALUES of a cell in a scene of this extent.
double sgsi_meson_rate(size_t value, double extent);
