#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Options with another value than their default, and what follows from it in a closed form: on a model of 300 primitives that
# is written here, and three photos, without training.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
cd "$temporary"

python3 - <<'END'
import random
import struct

random.seed(1)
names = ["x", "y", "z", "nx", "ny", "nz"] + [f"f_dc_{k}" for k in range(3)] + [f"f_rest_{k}" for k in range(45)] + ["opacity"]
names += [f"scale_{k}" for k in range(3)] + [f"rot_{k}" for k in range(4)]
with open("model.ply", "wb") as file:
    file.write(("ply\nformat binary_little_endian 1.0\nelement vertex 300\n" +
                "".join(f"property float {name}\n" for name in names) + "end_header\n").encode())
    for i in range(300):  # primitive 7 has no rotation
        row = [random.uniform(-1, 1) for _ in range(3)] + [0] * 3 + [random.uniform(-1.5, 1.5) for _ in range(3)]
        row += [random.uniform(-0.2, 0.2) for _ in range(45)] + [random.uniform(-2, 4)]
        row += [random.uniform(-4, -2) for _ in range(3)] + [random.gauss(0, 1) * (i != 7) for _ in range(4)]
        file.write(struct.pack("<62f", *row))
END
mkdir -p few/images masks
cp -r "$room/sparse" few/
cp "$room"/images/000[123].jpg few/images/

# ---- compress: what is decoded ----
packed() { # NAME ARGUMENT...: NAME.ply, and the JSON of compress in NAME.json
    run 0 compress model.ply -o packed --quiet --json "${@:2}"
    cp stdout "$1.json"
    run 0 decompress packed -o "$1.ply" --quiet
}
packed sog --method sog
for group in position dc sh scale rotation opacity; do packed $group --method sog --$group-bits 1; done
packed ghap --method ghap --keep 0.5
packed merged --method ghap --keep 0.5 --eig-min 0.5
meson=(--method mesongs --codebook 16 --vq-steps 5)
packed corner "${meson[@]}" --octree-depth 2
packed centre "${meson[@]}" --octree-depth 2 --cell-center
packed fine --method fcgs-like
packed coarse --method fcgs-like --step-scale 4

# ---- convert: the axes of SPZ ----
run 0 convert model.ply plain.spz --quiet
for axes in rub rdf; do run 0 convert model.ply $axes.spz --spz-axes $axes --quiet; done
check rub_is_the_default cmp plain.spz rub.spz

last_command="compress, decompress and convert"
cat >values.py <<'END'
import gzip
import struct


def read(path):
    data = open(path, "rb").read()
    at = data.index(b"end_header\n") + 11
    columns = [line.split()[2] for line in data[:at].decode().split("\n") if line.startswith("property")]
    return dict(zip(columns, zip(*struct.iter_unpack(f"<{len(columns)}f", data[at:]))))


def values(name, *columns):
    """All different values of these columns, ascending."""
    return sorted({value for column in columns for value in model(name)[column]})


def model(name, models={}):
    if name not in models:
        models[name] = read(name + ".ply")
    return models[name]


def expect(name, condition):
    print(name, "ok" if condition else "failed")


def near(a, b):
    return abs(a - b) < 1e-5


# One bit: three values at most. The other attributes are as without the option.
groups = {"position": "x y z", "dc": "f_dc_0 f_dc_1 f_dc_2", "sh": "f_rest_0 f_rest_14 f_rest_44",
          "scale": "scale_0 scale_1 scale_2", "rotation": "rot_0 rot_1 rot_2 rot_3", "opacity": "opacity"}
for group in groups:
    for name, columns in groups.items():
        for column in columns.split():
            before, after = len(values("sog", column)), len(values(group, column))
            expect(f"{group}_bits_and_{column}", before > 6 and (after <= 3 if name == group else after == before))

scales = ("scale_0", "scale_1", "scale_2")
expect("scales_without_a_bound", values("ghap", *scales)[0] < -3)
expect("the_smallest_variance_bounds_the_scales", all(near(2 * s, -0.69314718) for s in values("merged", *scales)))

for axis in "xyz":
    corners, centres = values("corner", axis), values("centre", axis)
    expect(f"an_octree_has_two_to_the_depth_cells_on_{axis}", len(corners) == len(centres) == 4)
    half = (corners[1] - corners[0]) / 2
    expect(f"centres_are_half_a_cell_further_on_{axis}", all(near(b - a, half) for a, b in zip(corners, centres)))

steps = [values(name, "scale_0")[1] - values(name, "scale_0")[0] for name in ("fine", "coarse")]
expect("the_step_is_multiplied", steps[0] > 0.01 and near(steps[1], 4 * steps[0]))

# Positions of 24 bits, rounded with 0.5 upwards, from byte 16 on; byte 14 has the flags.
rub, rdf = (gzip.decompress(open(name + ".spz", "rb").read()) for name in ("rub", "rdf"))
triples = [[int.from_bytes(data[16 + 3 * k:19 + 3 * k], "little", signed=True) for data in (rub, rdf)] for k in range(900)]
expect("x_is_the_same_with_rdf", all(a == b and a for a, b in triples[0::3]))
expect("y_and_z_are_negated_with_rdf", all(a + b in (0, 1) and abs(a) > 1 for k, (a, b) in enumerate(triples) if k % 3))
expect("the_record_of_the_axes_is_announced", rub[14] == 0 and rdf[14] == 2)
END
python3 values.py >results
while read -r name result; do check "$name" test "$result" = ok; done <results
check all_were_checked test "$(wc -l <results)" -eq $((6 * 17 + 2 + 6 + 1 + 3))

# fewer_blocks_make_a_smaller_file
run 0 compress model.ply -o blocks "${meson[@]}" --octree-depth 2 --blocks 1 --json --quiet
check fewer_blocks_make_a_smaller_file test "$(jq .bytes stdout)" -lt "$(jq .bytes corner.json)"

# scores_are_a_power_of_the_volume: score = sum * volume ^ power. The default is 0.1: the score of 0.2 is as far from it as it is
# from that of 0.
scores=(prune model.ply few --method lightgaussian --downscale 8 --quiet)
run 0 "${scores[@]}" --scores default.csv
for power in 0 0.2; do run 0 "${scores[@]}" --volume-power $power --scores $power.csv; done
paste -d, 0.csv default.csv 0.2.csv >powers.csv
# shellcheck disable=SC2016 # for awk
check scores_are_a_power_of_the_volume awk -F, 'NR > 1 && $2 > 0 { seen++; changed += $2 != $4; error = ($4 / $2) ^ 2 / ($6 / $2) - 1
    if (!(error < 1e-5 && error > -1e-5)) bad++ } END { exit !(seen > 200 && changed > 200 && bad == 0) }' powers.csv
for power in -0.1 10.5 nan x; do
    run 2 "${scores[@]}" --scores none.csv "--volume-power=$power"
    reports "--volume-power: '$power' is not a number from 0 to 10"
    one_line
done

# primitives_without_rotation_are_dropped_on_request
run 0 convert model.ply kept.ply --json
json stdout '.input == 300 and .output == 300'
run 0 convert model.ply dropped.ply --filter-nan --json
json stdout '.input == 300 and .output == 299'

# blocks_have_more_views_with_a_smaller_share_and_with_a_larger_margin: with a share of 0, all 35
: >views
for case in '0 0.2' '1 10' '1 0.2'; do
    read -r share margin <<<"$case"
    rm -rf plan
    run 0 split "$room" -o plan --blocks 2 --share "$share" --margin "$margin" --quiet
    json plan/blocks.json ".share == $share and .margin == $margin"
    jq '[.blocks[].views | length] | add' plan/blocks.json >>views
done
check all_views test "$(head -1 views)" = 70
check fewer_views sort -cnru views

# inverted_masks_are_the_other_half: the mean errors of two halves of an image have the error of the image as their mean
oiiotool --pattern constant:color=0 480x270 1 --fill:color=1 240x270+0+0 -d uint8 -o masks/0001.png
scored() { # NAME ARGUMENT...: PSNR of the first view
    run 0 eval model.ply few --downscale 16 --test-images 0001.jpg --json "${@:2}"
    jq .mean.psnr stdout >"$1.psnr"
}
scored whole --masks none
scored white --masks "$temporary/masks"
scored black --masks "$temporary/masks" --invert-masks
# shellcheck disable=SC2016 # for jq
check halves_make_the_image jq -ne '[inputs | pow(10; -. / 10)] as [$whole, $white, $black]
    | ((($white + $black) / 2 / $whole - 1) | fabs) < 1e-5 and (($white / $black - 1) | fabs) > 0.05' whole.psnr white.psnr black.psnr

finish
