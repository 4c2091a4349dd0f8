#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The whole default suite under the thread sanitizer. SUITE=regex selects tests.
set -euo pipefail
if ! command -v clang >/dev/null; then
    echo "skipped: clang is not installed; tools/setup.sh --long installs it"
    exit 77
fi
cd "$SPAREGS_SOURCE"
export TSAN_OPTIONS="ignore_noninstrumented_modules=1:suppressions=$PWD/tests/project/tsan.supp"

# A planted race is detected; accesses ordered by a join are not reported.
planted=$(mktemp -d)
trap 'rm -rf "$planted"' EXIT
cat >"$planted/race.c" <<'C'
#include <pthread.h>
#include <stddef.h>

static int sum;

static void *add(void *argument)
{
    ++sum;
    return argument;
}

int main(int argc, char **argv)
{
    pthread_t thread;
    (void)argv;
    pthread_create(&thread, NULL, add, NULL);
    if (argc > 1)
        ++sum;
    pthread_join(thread, NULL);
    return ++sum < 0;
}
C
clang -g -fsanitize=thread -pthread "$planted/race.c" -o "$planted/race"
"$planted/race" || { echo "FAIL: a join is taken for a race"; exit 1; }
if "$planted/race" race 2>/dev/null; then echo "FAIL: a race is not seen"; exit 1; fi

cmake --preset tsan >/dev/null
cmake --build build/tsan -j "${JOBS:-$(nproc)}"
ctest --test-dir build/tsan --output-on-failure -R "${SUITE:-.}" -E 'test_package|test_setup' --timeout 1800
