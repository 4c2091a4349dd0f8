#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Installs what building, testing and the demo need, on Debian and Ubuntu; elsewhere prints the list and stops.
# Does nothing, quickly, when everything is there. This is the only place where the packages are listed.
#     tools/setup.sh [--long]        with what the long tests, tools/scripts/lint.sh and tools/scripts/coverage.sh need besides
set -euo pipefail

packages=(
    git gcc g++ make cmake pkg-config # to build
    libembree-dev                     # ray tracing: 3.13 on Debian 12, 4.x on Debian 13 and Ubuntu 24.04
    libopenimageio-dev libopenexr-dev # images
    libjansson-dev libxxhash-dev      # JSON, hashes
    libdeflate-dev                    # ZIP of EXR
    libkissfft-dev                    # spectra
    libcmocka-dev                     # tests
    openimageio-tools openexr jq      # tests of the written files
)
if [ "${1:-}" = --long ]; then
    packages+=(
        clang libclang-rt-dev            # sanitizers, fuzzing
        clang-format clang-tidy cppcheck # tools/scripts/lint.sh
        gcovr                            # tools/scripts/coverage.sh
        colmap                           # reconstruct
        chromium                         # the page of `report`
    )
    if apt-cache show clang-16 >/dev/null 2>&1; then
        packages+=(clang-16) # another compiler, on Debian 12
    fi
fi

missing=()
for package in "${packages[@]}"; do
    if [ "$(dpkg-query -W -f='${db:Status-Abbrev}' "$package" 2>/dev/null | cut -c1-2)" != ii ]; then
        missing+=("$package")
    fi
done
[ ${#missing[@]} -gt 0 ] || exit 0

if ! command -v apt-get >/dev/null; then
    echo "setup: this is neither Debian nor Ubuntu; please install the equivalents of:" >&2
    printf '    %s\n' "${packages[@]}" >&2
    exit 1
fi

root=()
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        echo "setup: missing: ${missing[*]}; install them as root (there is no sudo here)" >&2
        exit 1
    fi
    root=(sudo)
fi
echo "setup: installing ${missing[*]}"
"${root[@]}" apt-get update -qq
"${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
