#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# LPIPS of eval against PyTorch on the saved images, with random weights that lpips_weights.py converted from .pth files; and
# .pth files that the script must refuse. Skipped without PyTorch.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
find_torch
convert=$SPAREGS_SOURCE/tools/scripts/lpips_weights.py
reference=$SPAREGS_SOURCE/tests/image/lpips_reference.py

run 0 train "$room" -o "$temporary/model" --downscale 2 --eval --iterations 100 --quiet
for network in vgg alex; do
    "$python" "$reference" random $network "$temporary/$network.pth" "$temporary/${network}_heads.pth"
    "$python" "$convert" "$temporary/$network.pth" "$temporary/${network}_heads.pth" "$temporary/$network.bin" >"$temporary/converted"
    check "${network}_is_recognised" grep -q ": $network, " "$temporary/converted"
    for input in unit signed; do
        run 0 eval "$temporary/model" "$room" --lpips "$temporary/$network.bin" --lpips-input $input --json --save "$temporary/saved"
        cp "$temporary/stdout" "$temporary/eval.json"
        json "$temporary/eval.json" ".lpips_network == \"$network\" and .lpips_input == \"$input\""
        for image in 0001 0017 0033; do
            for suffix in "" _photo; do oiiotool "$temporary/saved/$image$suffix.png" -o "$temporary/$image$suffix.ppm"; done
            expected=$("$python" "$reference" score "$temporary/$network.pth" "$temporary/${network}_heads.pth" \
                $((${#input} == 4)) "$temporary/$image.ppm" "$temporary/${image}_photo.ppm")
            json "$temporary/eval.json" ".images[] | select(.name == \"$image.jpg\") | .lpips / $expected - 1 | . < 5e-6 and . > -5e-6"
        done
    done
done

# the_script_refuses_bad_files
refuses() { # TEXT BACKBONE HEADS
    local status=0
    last_command="lpips_weights.py $2 $3"
    "$python" "$convert" "$2" "$3" "$temporary/refused.bin" >/dev/null 2>"$temporary/stderr" || status=$?
    check refused test $status -ne 0
    check "one_line with $1" test "$(wc -l <"$temporary/stderr")" -eq 1
    refused=1 # counts as a bad input
    reports "$1"
    check nothing_is_written test ! -e "$temporary/refused.bin"
}
refuses "has no tensor 'features.0.weight'" "$temporary/vgg_heads.pth" "$temporary/vgg.pth"
refuses "'lin1.model.1.weight' has the shape (1, 192, 1, 1), expected (1, 128, 1, 1)" "$temporary/vgg.pth" "$temporary/alex_heads.pth"
head -c 1000 "$temporary/vgg.pth" >"$temporary/cut.pth"
refuses "cut.pth: cannot read it" "$temporary/cut.pth" "$temporary/vgg_heads.pth"
refuses "none.pth: cannot read it" "$temporary/none.pth" "$temporary/vgg_heads.pth"
"$python" -c "
import sys, torch
heads = torch.load(sys.argv[1])
heads['lin2.model.1.weight'][0, 7] = float('nan')
torch.save(heads, sys.argv[2])" "$temporary/alex_heads.pth" "$temporary/nan.pth"
refuses "'lin2.model.1.weight' has values that are not finite" "$temporary/alex.pth" "$temporary/nan.pth"

finish
