#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""RAP's features and score in double precision with PyTorch, and a weight file as torch.save writes it.

    rap_reference.py random WEIGHTS.pth                       a network with random weights
    rap_reference.py compare MODEL.ply WEIGHTS.pth FEATURES.csv SCORES.csv PRUNED.ply RATIO
                                                              fails if a value or the kept rows differ
"""

import math
import sys

import numpy as np
import torch

NEIGHBOURS, DIRECTIONS = 128, 60


def make_network():
    layers = []
    for inputs, outputs in ((15, 32), (32, 32), (32, 16), (16, 2)):
        layers += [torch.nn.Linear(inputs, outputs), torch.nn.ReLU()]
    return torch.nn.Sequential(*layers[:-1])


def read_ply(path):
    with open(path, "rb") as file:
        names, count = [], 0
        while True:
            words = file.readline().decode().split()
            if words[0] == "element":
                count = int(words[2])
            elif words[0] == "property":
                names.append(words[2])
            elif words[0] == "end_header":
                break
        return names, np.fromfile(file, "<f4", count * len(names)).reshape(count, len(names))


def sh_basis(x, y, z):
    a, b, c, d = 0.4886025119029199, 1.0925484305920792, 0.5900435899266435, 0.4570457994644658
    return torch.stack([
        torch.full_like(x, 0.28209479177387814), -a * y, a * z, -a * x,
        b * x * y, -b * y * z, 0.31539156525252005 * (2 * z * z - x * x - y * y), -b * x * z, b / 2 * (x * x - y * y),
        -c * y * (3 * x * x - y * y), 2.890611442640554 * x * y * z, -d * y * (4 * z * z - x * x - y * y),
        0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y), -d * x * (4 * z * z - x * x - y * y),
        1.445305721320277 * z * (x * x - y * y), -c * x * (x * x - 3 * y * y)])


# Standard deviation of the colour over a Fibonacci sphere. The array [16][3] is read as [3][16], as in the released code.
def anisotropy(dc, rest):
    harmonics = torch.cat([dc[:, None, :], rest.reshape(-1, 3, 15).transpose(1, 2)], 1).reshape(-1, 3, 16)
    u = torch.arange(DIRECTIONS, dtype=torch.float64) + 0.5
    phi, theta = torch.acos(1 - 2 * u / DIRECTIONS), math.pi * (1 + math.sqrt(5)) * u
    basis = sh_basis(torch.sin(phi) * torch.cos(theta), torch.sin(phi) * torch.sin(theta), torch.cos(phi))
    color = (torch.einsum("ncb,bd->ncd", harmonics, basis) + 0.5).clamp(0, 1)
    return ((color - color.mean(2, keepdim=True)) ** 2).mean((1, 2)).sqrt().clamp_min(1e-12)


def nearest(xyz):
    distances, indices = [], []
    for first in range(0, len(xyz), 1000):
        rows = torch.cdist(xyz[first:first + 1000], xyz, compute_mode="donot_use_mm_for_euclid_dist")
        rows[torch.arange(len(rows)), torch.arange(first, first + len(rows))] = math.inf
        least = rows.topk(NEIGHBOURS, largest=False)
        distances.append(least.values)
        indices.append(least.indices)
    return torch.cat(distances), torch.cat(indices)


def features_of(names, rows):
    def columns(*wanted):
        return torch.tensor(rows[:, [names.index(name) for name in wanted]], dtype=torch.float64)

    distances, near = nearest(columns("x", "y", "z"))
    scales = torch.exp(columns("scale_0", "scale_1", "scale_2")).sort(dim=1).values
    opacity = torch.sigmoid(columns("opacity"))[:, 0]
    dc = columns("f_dc_0", "f_dc_1", "f_dc_2")
    color = (0.28209479177387814 * dc + 0.5).clamp(0, 1)

    def local(f):
        return (f - f[near].mean(1)) / (f[near].std(1, unbiased=False) + 1e-8)

    def whole(f):
        return (f.log() - f.log().mean()) / f.log().std()

    table = []
    for f in (distances.mean(1), anisotropy(dc, columns(*[f"f_rest_{k}" for k in range(45)]))):
        table += [local(f), whole(f)]
    table += [local(scales[:, k]) for k in range(3)] + [whole(scales[:, k]) for k in range(3)]
    for f in (scales.prod(1), opacity):
        table += [local(f), whole(f)]
    table.append(sum(local(color[:, k]) for k in range(3)) / 3)
    table = torch.stack(table, 1)
    low, high = torch.quantile(table, torch.tensor([0.01, 0.99], dtype=torch.float64), dim=0)
    return (table.clamp(low, high) - low) / (high - low)


def compare(model, weights, features_csv, scores_csv, pruned, ratio):
    names, rows = read_ply(model)
    network = make_network()
    network.load_state_dict(torch.load(weights))
    expected = features_of(names, rows)
    with torch.no_grad():
        scores = torch.softmax(network.double()(expected), 1)[:, 0].numpy()
    features = np.loadtxt(features_csv, delimiter=",", skiprows=1)[:, 1:]
    written = np.loadtxt(scores_csv, delimiter=",", skiprows=1)[:, 1]
    errors = np.abs(features - expected.numpy()).max(), np.abs(written - scores).max()
    kept = np.sort(np.argsort(written, kind="stable")[int(len(rows) * float(ratio)):])
    same = np.array_equal(read_ply(pruned)[1], rows[kept])
    print(f"{len(rows)} primitives: features differ by {errors[0]:.1e}, scores in {scores.min():.3f} to "
          f"{scores.max():.3f} by {errors[1]:.1e}; kept rows {'agree' if same else 'differ'}")
    return errors[0] <= 2e-5 and errors[1] <= 1e-4 and np.ptp(scores) > 0.1 and same


if sys.argv[1] == "random":
    torch.manual_seed(3)
    network = make_network()
    for parameter in network.parameters():
        parameter.data *= 3
    torch.save(network.state_dict(), sys.argv[2])
elif sys.argv[1] != "compare" or not compare(*sys.argv[2:]):
    sys.exit(1)
