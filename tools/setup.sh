#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Installs the packages for building, testing and the demo on Debian and Ubuntu; elsewhere, and without root or sudo, it
# only prints the list. Fails if a required package is not available; optional ones are left out.
# Returns immediately if all available packages are installed. This is the only list of packages.
#     tools/setup.sh [--long]        also packages for the long tests, tools/scripts/lint.sh and tools/scripts/coverage.sh
set -euo pipefail

required=(
    git gcc g++ make cmake pkg-config # to build
    libembree-dev                     # ray tracing: 3.13 on Debian 12, 4.x on Debian 13 and Ubuntu 24.04
    libopenimageio-dev libopenexr-dev # images
    libjansson-dev libxxhash-dev      # JSON, hashes
    libdeflate-dev                    # ZIP of EXR and SOG, gzip of SPZ
    libwebp-dev libzstd-dev           # textures of SOG, SPZ 4
    libjxl-dev                        # images of compressed models
    libkissfft-dev                    # spectra
    libcivetweb-dev libturbojpeg0-dev # server and pictures of the viewer
    libcmocka-dev                     # tests
    openimageio-tools openexr jq      # tests of the written files
    curl python3                      # tests of the viewer
)
optional=(
    libopenmpi-dev openmpi-bin # ranks on several machines
    nodejs                     # test of the scripts of the pages
)
if [ "${1:-}" = --long ]; then
    optional+=(
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

packages=("${required[@]}" "${optional[@]}")

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

# Sorts the missing packages: `available`, `lacking` (required), and `left_out` (optional; Ubuntu has neither chromium nor
# clang-16 as packages).
sort_missing() {
    available=() lacking=() left_out=()
    for package in "${missing[@]}"; do
        if apt-cache show "$package" >/dev/null 2>&1; then
            available+=("$package")
        elif [[ " ${required[*]} " == *" $package "* ]]; then
            lacking+=("$package")
        else
            left_out+=("$package")
        fi
    done
}
report_left_out() {
    if [ ${#left_out[@]} -gt 0 ]; then echo "setup: not available here: ${left_out[*]}" >&2; fi
}
sort_missing
if [ ${#available[@]} -eq 0 ] && [ ${#lacking[@]} -eq 0 ] && [ -n "$(apt-get indextargets 2>/dev/null)" ]; then
    report_left_out # by the package lists of an earlier update
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
sort_missing
report_left_out
if [ ${#lacking[@]} -gt 0 ]; then
    echo "setup: required packages are not available: ${lacking[*]}; add a package source that has them (Ubuntu: universe)" >&2
    exit 1
fi
[ ${#available[@]} -gt 0 ] || exit 0
"${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${available[@]}"
