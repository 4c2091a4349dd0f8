// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Limits on what one structural update changes, applied to the decisions of the pipeline and of
// SPARE-GS. Those with a status return OUT_OF_MEMORY if the rows cannot be ranked.

#include "density/density.h"

// Removes at most the share options->removal_max of the rows (0: no limit), those of least opacity
// first; the others stay. Rows that are not finite are always removed, and count. A pipeline whose
// growth depends on the removed rows calls it before; a second call changes nothing.
sgs_status sgsi_limit_removal(const sgsi_density_options *options, sgsi_density_columns *columns);

// Keeps the densifications of highest priority, so that at most options->max_count rows remain
// (0: no limit). Rows of low opacity are replaced by them, up to a tenth of the maximum per update
// and besides the rows removed before, so that growth continues at the cap. Not after an opacity
// reset (options->opacity_is_reset), when all rows have a low opacity.
sgs_status sgsi_limit_growth(const sgsi_density_options *options, sgsi_density_columns *columns,
                             const sgsi_statistics *statistics);

// True if options->max_count has no room for all rows that grow, whatever sgsi_limit_growth
// replaces.
bool sgsi_growth_exceeds_cap(const sgsi_density_options *options,
                             const sgsi_density_columns *columns);
