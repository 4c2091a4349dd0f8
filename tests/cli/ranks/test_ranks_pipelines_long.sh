#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Every pipeline with SPARE-GS on the ranks of Open MPI (shared memory and TCP) and of MPICH gives the model of one process:
# with exposure, HDR photos, masks and batches. What is missing is skipped with a note.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$(dirname "$0")/../cli_support.sh"
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1

# shellcheck disable=SC2119 # no argument
if is_sanitized; then
    echo "skipped: the MPI libraries are not built with a sanitizer"
    exit 77
fi
launchers=()
if command -v mpirun.openmpi >/dev/null && [ -e "$SPAREGS_BUILD/ranks-openmpi.so" ]; then
    launchers+=("mpirun.openmpi --oversubscribe --bind-to none" "mpirun.openmpi --oversubscribe --bind-to none --mca btl tcp,self")
else
    echo "skipped: Open MPI is missing (install libopenmpi-dev and openmpi-bin)"
fi
if command -v mpirun.mpich >/dev/null && [ -e "$SPAREGS_BUILD/ranks-mpich.so" ]; then
    launchers+=("mpirun.mpich")
else
    echo "skipped: MPICH is missing (install libmpich-dev and mpich)"
fi
if [ "${#launchers[@]}" = 0 ]; then
    echo "skipped: no launcher"
    exit 77
fi

# The photos as linear EXR files, four times as bright, and a mask for each.
hdr=$temporary/hdr
mkdir -p "$hdr/images" "$hdr/masks"
cp -r "$room/sparse" "$hdr/"
for photo in "$room"/images/*.jpg; do
    name=$(basename "${photo%.jpg}")
    oiiotool "$photo" --resize 200x112 --colorconvert sRGB linear --mulc 4 -d half -o "$hdr/images/$name.exr"
    oiiotool --pattern constant:color=1 200x112 1 --box:color=0:fill=1 90,40,130,70 -d uint8 -o "$hdr/masks/$name.png"
done

# Scene and options of each pipeline.
options_of() {
    case $1 in
        3dgs) echo "$room --downscale 4 --exposure" ;;
        mip) echo "$room --downscale 4 --filter mip" ;;
        taming) echo "$hdr --masks $hdr/masks --white 4" ;;
        dash) echo "$room --downscale 2" ;;
        fastgs) echo "$hdr --train-space linear --white 4" ;;
        mcmc) echo "$room --downscale 4 --batch 3" ;;
    esac
}

for pipeline in 3dgs mip taming dash fastgs mcmc; do
    read -ra options <<<"$(options_of $pipeline)"
    options+=(--pipeline $pipeline --spare on --iterations 250 --threads 1 --quiet --checkpoint-every 0 --overwrite)
    run 0 train "${options[@]}" -o "$temporary/one"
    hash=$(jq -r .model_hash "$temporary/one/summary.json")
    count=2
    for launcher in "${launchers[@]}"; do
        last_command="$launcher -n $count sparegs train ${options[*]}"
        # shellcheck disable=SC2086 # several words
        check trains timeout 600 $launcher -n $count "$program" train "${options[@]}" -o "$temporary/ranks"
        json "$temporary/ranks/summary.json" ".ranks == $count"
        check "same_model: $pipeline" test "$(jq -r .model_hash "$temporary/ranks/summary.json")" = "$hash"
        count=$((count + 1))
    done
    echo "$hash $pipeline"
done
finish
