#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""LPIPS by PyTorch in double precision, for tests.

usage: lpips_reference.py small                                the values in test_lpips.c
       lpips_reference.py random vgg|alex BACKBONE HEADS       .pth files of random weights
       lpips_reference.py score BACKBONE HEADS UNIT A.ppm B.ppm   distance; UNIT: 1 = [0, 1], 0 = [-1, 1]
"""

import sys

import numpy
import torch
import torch.nn.functional as functional

# Of each convolution: index in torchvision's features, out, in, kernel, stride, padding, pooling before, tap after.
NETWORKS = {
    "vgg": (2, [(0, 64, 3, 3, 1, 1, 0, 0), (2, 64, 64, 3, 1, 1, 0, 1), (5, 128, 64, 3, 1, 1, 1, 0),
                (7, 128, 128, 3, 1, 1, 0, 1), (10, 256, 128, 3, 1, 1, 1, 0), (12, 256, 256, 3, 1, 1, 0, 0),
                (14, 256, 256, 3, 1, 1, 0, 1), (17, 512, 256, 3, 1, 1, 1, 0), (19, 512, 512, 3, 1, 1, 0, 0),
                (21, 512, 512, 3, 1, 1, 0, 1), (24, 512, 512, 3, 1, 1, 1, 0), (26, 512, 512, 3, 1, 1, 0, 0),
                (28, 512, 512, 3, 1, 1, 0, 1)]),
    "alex": (3, [(0, 64, 3, 11, 4, 2, 0, 1), (3, 192, 64, 5, 1, 2, 1, 1), (6, 384, 192, 3, 1, 1, 1, 1),
                 (8, 256, 384, 3, 1, 1, 0, 1), (10, 256, 256, 3, 1, 1, 0, 1)]),
}


def features(name, weights, image):
    pool, convolutions = NETWORKS[name]
    taps = []
    for (_, _, _, _, stride, padding, pooled, tapped), (weight, bias) in zip(convolutions, weights):
        if pooled:
            image = functional.max_pool2d(image, pool, 2)
        image = functional.relu(functional.conv2d(image, weight, bias, stride=stride, padding=padding))
        if tapped:
            taps.append(image)
    return taps


def distance(name, weights, heads, unit, a, b):
    mean = torch.tensor([-0.030, -0.088, -0.188], dtype=torch.float64).view(1, 3, 1, 1)
    deviation = torch.tensor([0.458, 0.448, 0.450], dtype=torch.float64).view(1, 3, 1, 1)
    taps = []
    for image in (a, b):
        image = torch.from_numpy(image.astype(numpy.float64) / 255)[None]
        image = ((image if unit else 2 * image - 1) - mean) / deviation
        taps.append(features(name, weights, image))
    total = 0.0
    for f, g, head in zip(taps[0], taps[1], heads):
        f, g = [x / (x.pow(2).sum(1, keepdim=True).sqrt() + 1e-10) for x in (f, g)]
        total += float(((f - g) ** 2 * head).sum(1).mean())
    return total


class Generator:
    """The linear congruential generator of test_lpips.c."""

    def __init__(self):
        self.state = numpy.uint32(1)

    def uniform(self, count):
        factors = numpy.cumprod(numpy.full(count, 1664525, numpy.uint32), dtype=numpy.uint32)
        powers = numpy.concatenate(([numpy.uint32(1)], factors[:-1]))
        states = factors * self.state + numpy.uint32(1013904223) * numpy.cumsum(powers, dtype=numpy.uint32)
        self.state = states[-1]
        return (states >> numpy.uint32(8)).astype(numpy.float64) / 16777216.0


def generated(name):
    random, weights, heads = Generator(), [], []
    rows = NETWORKS[name][1]
    for _, out, into, kernel, *_ in rows:
        scale = (6.0 / (into * kernel * kernel)) ** 0.5
        weight = ((2 * random.uniform(out * into * kernel * kernel) - 1) * scale).astype(numpy.float32)
        bias = ((2 * random.uniform(out) - 1) * 0.1).astype(numpy.float32)
        weights.append((torch.from_numpy(weight).double().view(out, into, kernel, kernel), torch.from_numpy(bias).double()))
    for row in rows:
        if row[7]:
            heads.append(torch.from_numpy(random.uniform(row[1]).astype(numpy.float32)).double().view(1, -1, 1, 1))
    return weights, heads


def picture(width, height, changed):
    image = numpy.zeros((3, height, width), numpy.uint8)
    for c in range(3):
        for y in range(height):
            for x in range(width):
                value = (x * (3 + c) + y * (5 - c) + (x // 8 + y // 8) % 2 * 60 + x * y // (16 + c)) % 256
                image[c, y, x] = value * (8 - c) // 10 if changed else value
    return image


def small():
    for name in NETWORKS:
        weights, heads = generated(name)
        for width, height in ((50, 37), (33, 64)):
            for unit in (True, False):
                value = distance(name, weights, heads, unit, picture(width, height, False), picture(width, height, True))
                print(f"{name} {width}x{height} {'unit' if unit else 'signed'}: {value:.10f}")


def random(name, backbone, heads):
    torch.manual_seed(7)
    state = {}
    for index, out, into, kernel, *_ in NETWORKS[name][1]:
        state[f"features.{index}.weight"] = torch.randn(out, into, kernel, kernel) * (2 / (into * kernel * kernel)) ** 0.5
        state[f"features.{index}.bias"] = torch.randn(out) * 0.1
    state["classifier.0.weight"] = torch.zeros(2, 2)
    torch.save(state, backbone)
    taps = [row[1] for row in NETWORKS[name][1] if row[7]]
    torch.save({f"lin{k}.model.1.weight": torch.rand(1, count, 1, 1) for k, count in enumerate(taps)}, heads)


def read_ppm(path):
    with open(path, "rb") as stream:
        fields, data = [], stream.read()
    at = 0
    while len(fields) < 4:
        end = at
        while data[end:end + 1].strip():
            end += 1
        if end > at:
            fields.append(data[at:end])
        at = end + 1
    width, height = int(fields[1]), int(fields[2])
    return numpy.frombuffer(data, numpy.uint8, 3 * width * height, at).reshape(height, width, 3).transpose(2, 0, 1).copy()


def score(backbone, heads, unit, a, b):
    backbone, heads = torch.load(backbone), torch.load(heads)
    name = "vgg" if "features.28.weight" in backbone else "alex"
    weights = [(backbone[f"features.{row[0]}.weight"].double(), backbone[f"features.{row[0]}.bias"].double())
               for row in NETWORKS[name][1]]
    heads = [heads[f"lin{k}.model.1.weight"].double() for k in range(5)]
    print(f"{distance(name, weights, heads, unit == '1', read_ppm(a), read_ppm(b)):.10f}")


if __name__ == "__main__":
    {"small": small, "random": random, "score": score}[sys.argv[1]](*sys.argv[2:])
