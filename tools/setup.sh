#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Installs the packages for building, testing and the demo on Debian and Ubuntu; elsewhere, and without root or sudo, it
# only prints the list.
# Returns immediately if all packages are installed. This is the only list of packages.
#     tools/setup.sh [--long]        also packages for the long tests, tools/scripts/lint.sh and tools/scripts/coverage.sh
set -euo pipefail

packages=(
    git gcc g++ make cmake pkg-config # to build
    libembree-dev                     # ray tracing: 3.13 on Debian 12, 4.x on Debian 13 and Ubuntu 24.04
    libopenimageio-dev libopenexr-dev # images
    libjansson-dev libxxhash-dev      # JSON, hashes
    libdeflate-dev                    # ZIP of EXR and SOG, gzip of SPZ
    libwebp-dev libzstd-dev           # textures of SOG, SPZ 4
    libjxl-dev                        # images of compressed models
    libkissfft-dev                    # spectra
    libcivetweb-dev libturbojpeg0-dev # server and pictures of the viewer
    libopenmpi-dev openmpi-bin        # ranks on several machines; optional
    libcmocka-dev                     # tests
    openimageio-tools openexr jq      # tests of the written files
    curl python3                      # tests of the viewer
)
if [ "${1:-}" = --long ]; then
    packages+=(
        clang libclang-rt-dev            # sanitizers, fuzzing
        clang-format clang-tidy cppcheck # tools/scripts/lint.sh
        gcovr                            # tools/scripts/coverage.sh
        colmap                           # reconstruct
        libmpich-dev mpich               # ranks by another MPI library
        slurm-wlm munge                  # the job script of tools/manual/cluster.md
        chromium                         # the pages of `report` and `view`
        python3-torch                    # reference values of LPIPS and RAP
        clang-16                         # another compiler, on Debian 12
    )
fi

missing=()
for package in "${packages[@]}"; do
    if [ "$(dpkg-query -W -f='${db:Status-Abbrev}' "$package" 2>/dev/null | cut -c1-2)" != ii ]; then
        missing+=("$package")
    fi
done
[ ${#missing[@]} -gt 0 ] || exit 0

# Elsewhere, CMake names what is missing.
if ! command -v apt-get >/dev/null; then
    echo "setup: not Debian or Ubuntu; if the build fails, install the equivalents of:" >&2
    printf '    %s\n' "${packages[@]}" >&2
    exit 0
fi

root=()
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        echo "setup: missing packages: ${missing[*]}; sudo not found; if the build fails, install them as root" >&2
        exit 0
    fi
    root=(sudo)
fi
echo "setup: installing ${missing[*]}"
"${root[@]}" apt-get update -qq
available=()
for package in "${missing[@]}"; do # Ubuntu has neither chromium nor clang-16 as packages
    if apt-cache show "$package" >/dev/null 2>&1; then
        available+=("$package")
    else
        echo "setup: $package is not available here" >&2
    fi
done
"${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${available[@]}"
