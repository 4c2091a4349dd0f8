// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The beginning of an OpenColorIO configuration whose scene_linear is ACEScg; colour spaces may be
// appended.
#define OCIO_OF_ACESCG                                                                             \
    "ocio_profile_version: 2\n"                                                                    \
    "roles: {aces_interchange: AP0, scene_linear: ACEScg, default: ACEScg}\n"                      \
    "file_rules: [!<Rule> {name: Default, colorspace: default}]\n"                                 \
    "displays: {d: [!<View> {name: v, colorspace: AP0}]}\n"                                        \
    "colorspaces:\n"                                                                               \
    "  - !<ColorSpace> {name: AP0}\n"                                                              \
    "  - !<ColorSpace>\n"                                                                          \
    "    name: ACEScg\n"                                                                           \
    "    to_scene_reference: !<MatrixTransform> {matrix: [0.695452241, 0.140678696,"               \
    " 0.163869062, 0, 0.044794563, 0.859671118, 0.095534318, 0, -0.005525883, 0.00402521,"         \
    " 1.001500672, 0, 0, 0, 0, 1]}\n"
