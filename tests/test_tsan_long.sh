#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The whole default suite under the thread sanitizer with clang's OpenMP runtime, whose barriers its Archer tool explains to the
# sanitizer. SUITE=regex takes a part of it.
set -euo pipefail
if ! command -v clang >/dev/null || ! ldconfig -p | grep libomp >/dev/null; then
    echo "clang with its OpenMP runtime is not installed; tools/setup.sh --long installs it"
    exit 77
fi
cd "$SPAREGS_SOURCE"
export TSAN_OPTIONS="ignore_noninstrumented_modules=1:suppressions=$PWD/tests/tsan.supp"

# A planted race is seen, what a barrier orders is not taken for one.
planted=$(mktemp -d)
trap 'rm -rf "$planted"' EXIT
cat >"$planted/race.c" <<'C'
int main(int argc, char **argv)
{
    int sum[2] = {0}, race = 0;
    (void)argv;
#pragma omp parallel num_threads(2)
    {
#pragma omp for
        for (int i = 0; i < 2; ++i)
            sum[i] = i;
        if (argc > 1)
            race += sum[0] + sum[1];
#pragma omp for
        for (int i = 0; i < 2; ++i)
            sum[1 - i] += i;
    }
    return race < 0;
}
C
clang -g -fsanitize=thread -fopenmp "$planted/race.c" -o "$planted/race"
"$planted/race" || { echo "FAIL: a barrier is taken for a race"; exit 1; }
if "$planted/race" race 2>/dev/null; then echo "FAIL: a race is not seen"; exit 1; fi

cmake --preset tsan >/dev/null
cmake --build build/tsan -j "${JOBS:-$(nproc)}"
ctest --test-dir build/tsan --output-on-failure -R "${SUITE:-.}" -E 'test_package|test_setup' --timeout 1800
