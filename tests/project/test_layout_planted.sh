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

# plant FILE LINE EXPECTED: appends the line to the file; the layout test must print EXPECTED. All faults are planted
# before it runs, because each of its runs starts many processes.
expected=()
plant() {
    echo "$2" >>"$1"
    expected+=("$3")
}
plant src/image/image.c '#include "train/trainer_state.h"' "src/image/image.c may not include train/trainer_state.h"
plant src/image/image_oiio.h '#include "image/photo.h"' "circle between files: .*src/image/image_oiio.h"
plant src/loss/loss.h '#include "loss/exposure.h"' "circle between files: .*src/loss/loss.h"
plant tools/run/run_folder.c '#include "commands/commands.h"' "tools/run/run_folder.c may not include commands/commands.h"
plant tools/cli/output.c '#include "base/core.h"' "tools/cli/output.c may not include base/core.h"
plant bvh/bvh.c '#include "spare/spare.h"' "bvh/bvh.c may not include spare/spare.h"
plant spare/spare.c '#include "base/core.h"' "spare/spare.c may not include base/core.h"
plant src/trace/trace.h '#include <embree3/rtcore.h>' "src/trace/trace.h may not include <embree3/rtcore.h>"
plant include/sparegs/camera.h '#include "base/core.h"' "include/sparegs/camera.h may not include base/core.h"
plant include/sparegs/gaussians.h '#include <unistd.h>' "include/sparegs/gaussians.h may not include <unistd.h>"
plant src/trace/trace.h '#include "trace/no_such_file.h"' "includes trace/no_such_file.h, which does not exist"
plant src/README.md 'See `train/no_such_file.c`.' "src/README.md names train/no_such_file.c, which does not exist"
plant src/README.md 'See `train/trainer.c:no_such_function`.' "src/README.md names no_such_function in train/trainer.c"
plant src/base/core.h '// TODO' "unfinished work"
plant src/base/core.h "// /"home/name "a path of one machine"
plant src/model/gaussians.c 'static const char text[] = "use --flag";' "a message of the library names a flag"
sed -i 's:^| `loss/`\(.*\)| image |:| `loss/`\1| image rays |:' src/README.md
expected+=("src/README.md lacks a row of loss/ that allows: image")
sed -i 's:^| `cli/`\(.*\)| |$:| `cli/`\1| run |:' src/README.md
expected+=("src/README.md lacks a row of cli/ that allows: nothing more")
sed -i '/SPDX-License/d' src/rays/rays.h
expected+=("src/rays/rays.h names no licence")
seq 800 | sed 's:^:// :' >>src/rays/rays.h
expected+=("src/rays/rays.h has [0-9]* lines")
touch src/stray.c
expected+=("src/stray.c is not in a folder")
mkdir src/attic && cp src/base/core.h src/attic/core.h
expected+=("src/attic is not in the table" "file names are unique in the repository: core.h")
rm -r src/cluster
expected+=("src/cluster has no file")
echo 'int x;' >tests/stray.c
expected+=("tests/stray.c is not in a folder of the tables")
mkdir tests/attic
expected+=("tests/attic mirrors no folder")

if holds; then
    echo "FAIL: no planted fault is seen"
    failures=1
fi
for message in "${expected[@]}"; do
    grep -q -- "$message" "$temporary/out" || {
        echo "FAIL: not seen: $message"
        failures=$((failures + 1))
    }
done
[ "$failures" -eq 0 ] && echo "all ${#expected[@]} planted faults are seen"
