// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
'use strict';

// Checks of the pages' scripts in node. Each check is a function whose name states the property.

const assert = require('assert/strict');
const {standalonePage} = require('./page_dom.js');

// Rows right, down, front.
const level = {name: 'a', width: 4, height: 3, fx: 4, fy: 4, cx: 2, cy: 1.5, eye: [0, 0, -2], axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]};

function the_standalone_page_orbits_about_the_up_axis_of_the_file() {
  const means = 'frame(new Float32Array([0, 0, 0])); up';
  assert.deepEqual([...standalonePage({count: 1, cameras: [level], up: [0, 0, 2]}).run(means)], [0, 0, 1]);
  assert.deepEqual([...standalonePage({count: 1, cameras: [level], up: [0, 0, 0]}).run(means)].map((x) => x + 0), [0, -1, 0]);
}

const checks = [the_standalone_page_orbits_about_the_up_axis_of_the_file];

let failed = 0;
for (const check of checks) {
  try {
    check();
    console.log('ok ' + check.name);
  } catch (error) {
    ++failed;
    console.log('FAIL ' + check.name + '\n' + error.stack);
  }
}
process.exit(failed ? 1 : 0);
