#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# examples_work: fit_image reaches 35 dB and writes its model; render_ply renders that model, and fails with one line if it
# cannot.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
cd "$temporary"
fail() { echo "FAIL: $1"; exit 1; }

"$SPAREGS_BUILD/tests/fit_image" picture.ppm model.ply | tee fit.log
psnr=$(sed -n 's/^200 Gaussians after .*PSNR \([0-9.]*\) dB$/\1/p' fit.log)
awk -v psnr="${psnr:-0}" 'BEGIN { exit !(psnr >= 35) }' || fail "fit_image ends at '$psnr' dB"
[ "$(head -c 14 picture.ppm | tr '\n' ' ')" = "P6 128 80 255 " ] || fail "picture.ppm is no PPM of 128x80 pixels"
[ "$(wc -c <picture.ppm)" -eq $((14 + 3 * 128 * 80)) ] || fail "picture.ppm has $(wc -c <picture.ppm) bytes"
grep -aq '^element vertex 200$' model.ply || fail "model.ply has not 200 primitives"

"$SPAREGS_BUILD/tests/render_ply" model.ply picture.pfm | tee render.log
[ "$(head -c 16 picture.pfm | tr '\n' ' ')" = "PF 320 240 -1.0 " ] || fail "picture.pfm is no PFM of 320x240 pixels"
[ "$(wc -c <picture.pfm)" -eq $((16 + 12 * 320 * 240)) ] || fail "picture.pfm has $(wc -c <picture.pfm) bytes"
alpha=$(sed -n 's/^200 Gaussians, mean alpha //p' render.log)
awk -v alpha="${alpha:-0}" 'BEGIN { exit !(alpha > 0.3 && alpha < 1) }' || fail "render_ply covers '$alpha' of the image"

status=0
"$SPAREGS_BUILD/tests/render_ply" missing.ply other.pfm 2>error.log || status=$?
[ "$status" -eq 1 ] && [ "$(wc -l <error.log)" -eq 1 ] && grep -q missing.ply error.log || { cat error.log; fail "a missing model: status $status"; }
[ ! -e other.pfm ] || fail "a picture of a missing model was written"
