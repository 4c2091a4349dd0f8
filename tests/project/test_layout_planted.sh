#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# layout_test_can_fail: test_layout.sh detects each fault planted in a copy of the sources.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
cd "$SPAREGS_SOURCE"
mkdir "$temporary/tree"
cp -r include src bvh spare tools tests CMakeLists.txt README.md CHANGELOG.md "$temporary/tree"
rm -rf "$temporary/tree/tests/data"
cd "$temporary/tree"

failures=0
holds() { SPAREGS_SOURCE=$PWD bash "$PWD/tests/project/test_layout.sh" >"$temporary/out" 2>&1; }
holds || { cat "$temporary/out"; echo "FAIL: the layout test fails without a planted fault"; exit 1; }

# seen WHAT: asserts that the layout test fails.
seen() {
    if holds; then
        echo "FAIL: not seen: $1"
        failures=$((failures + 1))
    fi
}
# plant_line FILE LINE: appends the line, asserts a failure, restores the file.
plant_line() {
    cp "$1" "$temporary/kept"
    echo "$2" >>"$1"
    seen "$2 in $1"
    cp "$temporary/kept" "$1"
}
plant_line src/image/image.c '#include "train/trainer_state.h"'
plant_line src/image/image_oiio.h '#include "image/photo.h"'
plant_line src/loss/loss.h '#include "loss/exposure.h"'
plant_line tools/run/run_folder.c '#include "commands/commands.h"'
plant_line tools/cli/output.c '#include "base/core.h"'
plant_line bvh/bvh.c '#include "spare/spare.h"'
plant_line spare/spare.c '#include "base/core.h"'
plant_line src/trace/trace.h '#include <embree3/rtcore.h>'
plant_line include/sparegs/camera.h '#include "base/core.h"'
plant_line src/README.md 'See `train/no_such_file.c`.'
plant_line src/README.md 'See `train/trainer.c:no_such_function`.'
cp src/README.md "$temporary/kept"
sed -i 's:^| `loss/`\(.*\)| image |:| `loss/`\1| image rays |:' src/README.md && seen "an arrow in src/README.md that the test does not allow"
cp "$temporary/kept" src/README.md
cp src/rays/rays.h "$temporary/kept"
sed -i '/SPDX-License/d' src/rays/rays.h && seen "a file that names no licence"
cp "$temporary/kept" src/rays/rays.h
seq 800 | sed 's:^:// :' >>src/rays/rays.h && seen "a file of more than 800 lines"
cp "$temporary/kept" src/rays/rays.h
touch src/stray.c && seen "src/stray.c" && rm src/stray.c
rm -f src/stray.c
mkdir src/attic && cp src/rays/rays.h src/attic/attic.h && seen "a folder that no table has"
rm -rf src/attic
mv src/rays "$temporary/rays" && seen "a folder without files"
mv "$temporary/rays" src/rays
echo 'int x;' >tests/stray.c && seen "tests/stray.c"
rm tests/stray.c
[ "$failures" -eq 0 ] && echo "all planted faults are seen"
