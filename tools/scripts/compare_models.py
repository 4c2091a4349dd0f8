#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""Compares two PLY models: compare_models.py A.ply B.ply [--any-order] [--tolerance KIND=VALUE]...

Prints the largest difference of positions, log scales, opacities (0 to 1), rotations (components of unit quaternions),
colours and SH, and fails if one exceeds its tolerance, or if the counts differ. Without --any-order the rows must
correspond. Reads little-endian float PLY files with any order of properties."""

import math
import re
import struct
import sys

KINDS = {"position": 2e-5, "scale": 2e-5, "opacity": 1e-5, "rotation": 2e-5, "dc": 2e-5, "sh": 2e-5}


def read(path):
    with open(path, "rb") as file:
        data = file.read()
    end = data.index(b"end_header\n") + 11
    header = data[:end].decode("latin-1")
    count = int(re.search(r"element vertex (\d+)", header).group(1))
    names = re.findall(r"property float (\w+)", header)
    rows = list(struct.iter_unpack("<%df" % len(names), data[end:end + 4 * len(names) * count]))
    index = {name: k for k, name in enumerate(names)}
    rest = sum(name.startswith("f_rest_") for name in names)
    return rows, index, rest


def values(row, index, rest):
    """The comparable values of a row, by kind."""
    take = lambda prefix, n: [row[index[prefix + str(k)]] for k in range(n)]
    rotation = take("rot_", 4)
    norm = math.sqrt(sum(q * q for q in rotation)) or 1.0
    logit = row[index["opacity"]]
    opacity = 1.0 / (1.0 + math.exp(-max(-60.0, min(60.0, logit))))
    return {
        "position": [row[index[c]] for c in "xyz"],
        "scale": take("scale_", 3),
        "opacity": [opacity],
        "rotation": [q / norm for q in rotation],
        "dc": take("f_dc_", 3),
        "sh": take("f_rest_", rest),
    }


def nearest_rotation(p, q):
    """Half turns about its own axes and the sign of the quaternion do not change an ellipsoid."""
    w, x, y, z = q
    same = [q, [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]]
    dot = lambda r: sum(a * b for a, b in zip(p, r))
    best = max(same, key=lambda r: abs(dot(r)))
    return [-r for r in best] if dot(best) < 0 else best


def main():
    arguments = sys.argv[1:]
    any_order = "--any-order" in arguments
    tolerances = dict(KINDS)
    paths = []
    while arguments:
        word = arguments.pop(0)
        if word == "--tolerance":
            kind, value = arguments.pop(0).split("=")
            if kind not in tolerances:
                sys.exit("unknown kind '%s'" % kind)
            tolerances[kind] = float(value)
        elif word != "--any-order":
            paths.append(word)
    (a, index_a, rest_a), (b, index_b, rest_b) = read(paths[0]), read(paths[1])
    if len(a) != len(b) or rest_a != rest_b:
        sys.exit("%d primitives with %d SH values, and %d with %d" % (len(a), rest_a, len(b), rest_b))
    if any_order:
        a.sort(key=lambda row: row[index_a["x"]])
        b.sort(key=lambda row: row[index_b["x"]])
    worst = dict.fromkeys(KINDS, 0.0)
    for row_a, row_b in zip(a, b):
        one, two = values(row_a, index_a, rest_a), values(row_b, index_b, rest_b)
        two["rotation"] = nearest_rotation(one["rotation"], two["rotation"])
        for kind in KINDS:
            for p, q in zip(one[kind], two[kind]):
                scale = max(1.0, abs(p)) if kind == "position" else 1.0
                difference = abs(p - q) / scale if p != q else 0.0
                worst[kind] = max(worst[kind], difference if difference == difference else math.inf)
    wrong = [kind for kind in KINDS if not worst[kind] <= tolerances[kind]]
    print("%d primitives; %s%s" % (len(a), ", ".join("%s %.1e" % pair for pair in worst.items()),
                                   "; too large: " + " ".join(wrong) if wrong else ""))
    sys.exit(1 if wrong else 0)


main()
