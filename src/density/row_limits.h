// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Limits on what one structural update changes, applied to the decisions of the pipeline and of
// SPARE-GS. Both return OUT_OF_MEMORY if the rows cannot be ranked.

#include "density/density.h"

// Removes at most this share of the rows, those of least opacity first; the rest keep their row.
// Rows that are not finite, and the clones and children that the pipeline removes, are always
// removed and count as well.
sgs_status sgsi_limit_removal(sgsi_density_columns *columns, double share);

// Keeps the densifications of highest priority, so that at most `cap` rows remain. Rows of low
// opacity are removed for them, up to a tenth of the cap per update, so that growth continues at
// the cap.
sgs_status sgsi_limit_growth(sgsi_density_columns *columns, const sgsi_statistics *statistics,
                             size_t cap);
