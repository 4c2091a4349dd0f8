#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""Converts the published weights of LPIPS to one file for `sparegs eval --lpips`. Needs PyTorch.

usage: lpips_weights.py BACKBONE.pth HEADS.pth OUT

BACKBONE.pth: VGG16 or AlexNet of torchvision, trained on ImageNet (vgg16-397923af.pth,
alexnet-owt-7be5be79.pth). HEADS.pth: vgg.pth or alex.pth of LPIPS, version 0.1
(lpips/weights/v0.1 of richzhang/PerceptualSimilarity). The layout of OUT is described in
src/image/lpips_file.c.
"""

import struct
import sys
import zlib

# Network: number, convolutions as (index in torchvision's features, out, in, kernel), channels of the heads.
NETWORKS = {
    "vgg": (0, [(0, 64, 3, 3), (2, 64, 64, 3), (5, 128, 64, 3), (7, 128, 128, 3), (10, 256, 128, 3), (12, 256, 256, 3),
                (14, 256, 256, 3), (17, 512, 256, 3), (19, 512, 512, 3), (21, 512, 512, 3), (24, 512, 512, 3),
                (26, 512, 512, 3), (28, 512, 512, 3)], [64, 128, 256, 512, 512]),
    "alex": (1, [(0, 64, 3, 11), (3, 192, 64, 5), (6, 384, 192, 3), (8, 256, 384, 3), (10, 256, 256, 3)],
             [64, 192, 384, 256, 256]),
}


def fail(text):
    sys.exit(f"lpips_weights.py: {text}")


def load(path):
    import torch
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # of pickle, zipfile or torch
        fail(f"{path}: cannot read it as a PyTorch file: {str(error).splitlines()[0]}")
    if not isinstance(state, dict):
        fail(f"{path}: does not contain named tensors")
    return state


def tensor(state, path, name, shape):
    import torch
    if name not in state:
        fail(f"{path}: has no tensor '{name}'; give the backbone first, then the heads")
    found = state[name]
    if tuple(found.shape) != shape:
        fail(f"{path}: '{name}' has the shape {tuple(found.shape)}, expected {shape}")
    if not bool(torch.isfinite(found).all()):
        fail(f"{path}: '{name}' has values that are not finite")
    return found.detach().to(torch.float32).contiguous().numpy().astype("<f4")


def record(values):
    shape = (list(values.shape) + [1, 1, 1])[:4]
    return struct.pack("<4I", *shape) + values.tobytes()


def convert(backbone_path, heads_path, out_path):
    backbone, heads = load(backbone_path), load(heads_path)
    name = "vgg" if "features.28.weight" in backbone else "alex"
    number, convolutions, channels = NETWORKS[name]
    records = []
    for index, out, into, kernel in convolutions:
        records.append(record(tensor(backbone, backbone_path, f"features.{index}.weight", (out, into, kernel, kernel))))
        records.append(record(tensor(backbone, backbone_path, f"features.{index}.bias", (out,))))
    for tap, count in enumerate(channels):
        records.append(record(tensor(heads, heads_path, f"lin{tap}.model.1.weight", (1, count, 1, 1))))
    body = b"".join(records)
    with open(out_path, "wb") as stream:
        stream.write(b"SGSLPIPS" + struct.pack("<4I", 1, number, len(records), zlib.crc32(body)) + body)
    print(f"{out_path}: {name}, {len(records)} tensors")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    convert(*sys.argv[1:])
