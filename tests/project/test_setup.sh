#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# setup_without_apt_lists_the_packages: without dpkg and apt-get, tools/setup.sh prints the packages and succeeds, so that
# demo.sh and test.sh build with the libraries that are there. With apt-get it installs what is missing and available.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
for tool in bash cut id; do ln -s "$(command -v $tool)" "$temporary/$tool"; done

status=0
PATH=$temporary bash "$SPAREGS_SOURCE/tools/setup.sh" >"$temporary/out" 2>"$temporary/err" || status=$?
[ "$status" -eq 0 ] || { echo "FAIL: status $status"; cat "$temporary/err"; exit 1; }
for package in cmake libembree-dev libopenimageio-dev libjansson-dev; do
    grep -q "^ *$package$" "$temporary/err" || { echo "FAIL: $package is not in the list"; cat "$temporary/err"; exit 1; }
done
# the_test_of_the_pages_is_not_only_a_long_one
grep -q '^ *nodejs$' "$temporary/err" || { echo "FAIL: nodejs is not in the list"; cat "$temporary/err"; exit 1; }
# setup_for_the_long_tests_lists_more
PATH=$temporary bash "$SPAREGS_SOURCE/tools/setup.sh" --long 2>"$temporary/err"
for package in cmake clang cppcheck clang-tidy gcovr colmap; do
    grep -q "^ *$package$" "$temporary/err" || { echo "FAIL: --long does not list $package"; cat "$temporary/err"; exit 1; }
done

# Stand-ins: dpkg-query knows all packages but those of $MISSING, apt-cache all but those of $ABSENT; apt-get records.
cat >"$temporary/dpkg-query" <<'END'
#!/bin/bash
[[ " $MISSING " == *" ${!#} "* ]] || echo "ii "
END
cat >"$temporary/apt-cache" <<'END'
#!/bin/bash
[[ " $ABSENT " != *" ${!#} "* ]]
END
cat >"$temporary/apt-get" <<'END'
#!/bin/bash
if [ "$1" = indextargets ]; then echo "$LISTS"; else echo "$*" >>"${0%/*}/calls"; fi
END
printf '#!/bin/bash\n"$@"\n' >"$temporary/sudo"
chmod +x "$temporary"/{dpkg-query,apt-cache,apt-get,sudo}
ln -s "$(command -v env)" "$temporary/env"
# setup STATUS ARGUMENT...: with these programs.
setup() {
    local expected=$1 status=0
    : >"$temporary/calls"
    PATH=$temporary bash "$SPAREGS_SOURCE/tools/setup.sh" "${@:2}" >"$temporary/out" 2>"$temporary/err" || status=$?
    [ "$status" -eq "$expected" ] || { echo "FAIL: status $status instead of $expected"; cat "$temporary/err"; exit 1; }
}
holds() { grep -q -- "$2" "$temporary/$1" || { echo "FAIL: $1 has no '$2'"; cat "$temporary/$1"; exit 1; }; }
nothing() { [ ! -s "$temporary/calls" ] || { echo "FAIL: apt-get was called"; cat "$temporary/calls"; exit 1; }; }
export MISSING="" ABSENT="" LISTS=lists
setup 0
nothing
# missing_packages_are_installed
MISSING="jq clang-16" setup 0 --long
holds calls '^update'
holds calls '^install .* jq clang-16$'
# a_required_package_that_is_not_available_is_an_error
MISSING="jq libembree-dev" ABSENT=libembree-dev setup 1
holds err '^setup: required packages are not available: libembree-dev; '
if grep -q install "$temporary/calls"; then echo "FAIL: other packages were installed"; exit 1; fi
# an_optional_one_is_left_out (without an update if the lists of packages are there)
MISSING="jq clang-16" ABSENT=clang-16 setup 0 --long
holds err '^setup: not available here: clang-16$'
holds calls '^install .* jq$'
MISSING=clang-16 ABSENT=clang-16 setup 0 --long
holds err '^setup: not available here: clang-16$'
nothing
MISSING=clang-16 ABSENT=clang-16 LISTS="" setup 0 --long
holds calls '^update'

for script in "$SPAREGS_SOURCE"/tools/*.sh "$SPAREGS_SOURCE/.ci/run"; do
    [ -x "$script" ] || { echo "FAIL: $script is not executable"; exit 1; }
    bash -n "$script"
done
