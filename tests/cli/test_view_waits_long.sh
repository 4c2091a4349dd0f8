#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The tests of the viewer with the checks that wait for its time limits: incomplete frames, idle and stalled connections, a
# pause without a page.
set -eu
export SPAREGS_WAIT=1
bash "$SPAREGS_SOURCE/tests/cli/test_cli_view.sh"
bash "$SPAREGS_SOURCE/tests/cli/test_cli_view_train.sh"
