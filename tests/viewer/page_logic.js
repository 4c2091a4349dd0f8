// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
'use strict';

// Checks of the pages' scripts in node. Each check is a function whose name states the property.

const assert = require('assert/strict');
const {reportPage, standalonePage, viewerPage} = require('./page_dom.js');

// Rows right, down, front.
const level = {name: 'a', width: 4, height: 3, fx: 4, fy: 4, cx: 2, cy: 1.5, eye: [0, 0, -2], axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]};

function the_standalone_page_orbits_about_the_up_axis_of_the_file() {
  const means = 'frame(new Float32Array([0, 0, 0])); up';
  assert.deepEqual([...standalonePage({count: 1, cameras: [level], up: [0, 0, 2]}).run(means)], [0, 0, 1]);
  assert.deepEqual([...standalonePage({count: 1, cameras: [level], up: [0, 0, 0]}).run(means)].map((x) => x + 0), [0, -1, 0]);
}

// ---- Orbits ----

// The rows right, up, back of a camera that looks down by `tilt` at azimuth 0 and is rolled by `roll` degrees; up is -y.
function rolled(roll, tilt = 20) {
  const [c, s] = [Math.cos(tilt * Math.PI / 180), Math.sin(tilt * Math.PI / 180)];
  const right = [1, 0, 0], up = [0, -c, s], back = [0, -s, -c]; // right x up = back
  const [a, b] = [Math.cos(roll * Math.PI / 180), Math.sin(roll * Math.PI / 180)];
  const mix = (x, y, p, q) => x.map((value, k) => p * value + q * y[k]);
  return {right: mix(right, up, a, b), up: mix(up, right, a, -b), back};
}

function matrixOf({right: r, up: u, back: b}) {
  return [0, 1, 2].flatMap((k) => [r[k], u[k], b[k], 3 * b[k]]).concat([0, 0, 0, 1]);
}

// Azimuth and elevation of the camera as seen from its target, in radians.
function angles(back) {
  return [Math.atan2(back[0], -back[2]), Math.asin(-back[1])];
}

// The change of both by a drag.
function viewerDrag(roll, call, tilt) {
  const page = viewerPage();
  page.run(`setMatrix([${matrixOf(rolled(roll, tilt))}]); camera.target = [0, 0, 0]`);
  const before = angles(page.run('camera.back'));
  page.run(call);
  return angles(page.run('camera.back')).map((angle, k) => angle - before[k]);
}

function standaloneDrag(roll, call) {
  const {right, up, back} = rolled(roll), page = standalonePage({up: [0, -1, 0]});
  const axes = [right, up.map((x) => -x), back.map((x) => -x)];
  page.sandbox.taken = {...level, axes, eye: back.map((x) => 3 * x)};
  page.run('views.push(taken); goTo(0); target = [0, 0, 0]');
  page.run(call);
  const after = angles(page.run('camera.axes[2]').map((x) => -x)), before = angles(back);
  return after.map((angle, k) => angle - before[k]);
}

const near = (a, b, within) => assert.ok(Math.abs(a - b) <= within, `${a} is not within ${within} of ${b}`);

function drags_of_photos_in_portrait_change_azimuth_and_elevation() {
  for (const drag of [viewerDrag, standaloneDrag]) {
    const across = drag(0, 'orbit(0.1, 0)')[0], along = drag(0, 'orbit(0, 0.1)')[1];
    near(Math.abs(across), 0.1, 1e-9);
    near(Math.abs(along), 0.1, 1e-9);
    for (const roll of [-120, -92, -90, -88, -60, 60, 75, 88, 90, 92, 120]) {
      const [azimuth, elevation] = drag(roll, 'orbit(0, 0.1)');
      near(elevation, along, 1e-9);
      near(azimuth, 0, 1e-9);
      near(drag(roll, 'orbit(0.1, 0)')[0], across, 1e-9);
    }
    for (const roll of [-170, 180]) near(drag(roll, 'orbit(0.1, 0)')[0], -across, 1e-9); // as seen
    near(drag(180, 'orbit(0, 0.1)')[1], -along, 1e-9);
  }
  near(viewerDrag(90, 'look(0, 0.1)')[0], 0, 1e-9);
  near(Math.abs(viewerDrag(90, 'look(0, 0.1)')[1]), 0.1, 1e-9);
}

function a_long_drag_keeps_its_direction() {
  for (const roll of [40, 50, 88, 92, 130, 140]) {
    const page = viewerPage();
    page.run(`setMatrix([${matrixOf(rolled(roll))}]); camera.target = [0, 0, 0]`);
    let first = 0;
    for (let k = 0; k < 200; ++k) {
      const before = angles(page.run('camera.back'))[0];
      page.run(`orbit(0.02, ${k % 40 < 20 ? 0.02 : -0.02})`);
      const change = Math.sin(angles(page.run('camera.back'))[0] - before);
      first = first || Math.sign(change);
      assert.equal(Math.sign(change), first, `roll ${roll}, step ${k}`);
    }
  }
}

function drags_of_photos_taken_straight_down_turn_and_tilt() {
  for (const roll of [0, 90, 180, 270]) {
    const page = viewerPage();
    page.run(`setMatrix([${matrixOf(rolled(roll, 88))}]); camera.target = [0, 0, 0]; orbit(0, 0.5)`);
    const start = rolled(roll, 88);
    near(page.run('camera.right').reduce((sum, value, k) => sum + value * start.right[k], 0), 1, 1e-9); // about its own right axis
  }
}

function level_horizon_puts_the_up_axis_up() {
  for (const roll of [0, 40, 88, 92, 135, 180, -100]) {
    const page = viewerPage();
    page.run(`setMatrix([${matrixOf(rolled(roll))}]); levelHorizon()`);
    assert.ok(page.run('dot(worldUp, camera.up)') > 0.5, `roll ${roll}`);
    near(page.run('dot(worldUp, camera.right)'), 0, 1e-12);
  }
}

// ---- The page of `report` ----

function reportData(change) {
  const run = (seed) => ({scene: 'room', pipeline: '3dgs', variant: 'on', seed, gaussians: 100 + seed, seconds: {forward: 2, loss: 1},
    test: {psnr: 20 + seed, ssim: 0.9, flip: 0.1, sharpness: 1, lpips: null}, words: ['word ' + seed], train: [[10, 0, 0, 50], [20, 0, 0, 100]],
    post: [{kind: 'prune', step: 'a', point: 1, bytes: 1e6, test: {psnr: 19}}],
    regions: [{iteration: 10, grid: 4, cells: [[5, 0, 10, 11, 0.1, 1.2]]}]});
  const data = {title: 'Title', runs: [run(0), run(1)], tables: [{title: 'A table', note: 'n', columns: ['x'], rows: [['a cell']]}],
    pictures: [{label: 'l', drawn: 'data:a', photo: 'data:b', identical: false, psnr: 21.5, flip: 0.25, sharpness: 0.75}]};
  change(data, data.runs[0], data.pictures[0]);
  return data;
}

const sections = ['counts', 'quality', 'rates', 'seconds', 'regionMap', 'compare', 'tables', 'log'];

function missing_values_leave_the_report_complete() {
  const complete = reportPage(reportData(() => {}));
  assert.match(complete.element('compare').allText, /21\.50 dB, FLIP 0\.2500, sharpness 0\.750/);
  const changes = [
    (data, run) => { delete run.seconds; }, (data, run) => { run.seconds = null; }, (data, run) => { run.seconds.loss = null; },
    (data, run) => { run.test = null; }, (data, run) => { run.test.psnr = null; }, (data, run) => { delete run.gaussians; },
    (data, run) => { run.train[0][3] = null; }, (data, run) => { run.train = []; }, (data, run) => { delete run.train; },
    (data, run) => { run.post[0].test = null; }, (data, run) => { delete run.post; }, (data, run) => { delete run.regions; },
    (data, run) => { delete run.words; }, (data, run, picture) => { picture.flip = null; }, (data, run, picture) => { picture.sharpness = null; },
    (data, run, picture) => { picture.psnr = null; }, (data, run, picture) => { delete picture.psnr; },
  ];
  for (const change of changes) {
    const page = reportPage(reportData(change));
    assert.match(page.element('tables').allText, /A table.*a cell/, String(change));
    for (const id of sections) {
      assert.doesNotMatch(page.element(id).allText, /NaN|cannot be drawn/, `${id}: ${change}`);
      assert.ok(id === 'log' || page.element(id).children.length > 0, `${id}: ${change}`);
    }
  }
}

function only_identical_pictures_have_an_infinite_psnr() {
  const words = (change) => reportPage(reportData((data, run, picture) => change(picture))).element('compare').allText;
  assert.match(words((picture) => Object.assign(picture, {psnr: null, identical: true})), /identical, infinite PSNR/);
  assert.match(words((picture) => Object.assign(picture, {psnr: null})), /PSNR undefined/);
}

function a_section_that_fails_leaves_a_line_and_the_others() {
  const page = reportPage(reportData((data, run) => { run.regions[0].cells = null; }));
  assert.match(page.element('regionMap').allText, /This section cannot be drawn: /);
  assert.match(page.element('compare').allText, /21\.50 dB/);
  assert.match(page.element('tables').allText, /a cell/);
}

// ---- Addresses ----

function addresses_follow_the_path_of_the_page() {
  for (const [address, stream, photo] of [
    ['http://127.0.0.1:8080/?token=abcdefgh', 'ws://127.0.0.1:8080/stream', '/photo/3?model=1'],
    ['https://view.example/a/b/?token=abcdefgh', 'wss://view.example/a/b/stream', '/a/b/photo/3?model=1']]) {
    const page = viewerPage({}, address);
    assert.equal(page.sockets[0].url, stream);
    assert.equal(page.run("photoAddress('photo', 3)"), photo);
    page.run('checkToken()');
    assert.deepEqual(page.requests, [new URL(address).pathname]);
  }
}

// ---- Camera path ----

function the_orbit_centre_lies_in_front_of_the_cameras_of_a_path() {
  const page = viewerPage();
  const inFront = (distance) => {
    const expected = page.run(`add(camera.position, camera.back, -${distance})`);
    page.run('camera.target').forEach((value, k) => near(value, expected[k], 1e-9));
  };
  page.run(`setMatrix([${matrixOf(rolled(0))}]); camera.target = [0, 0, 0]; orbit(0, 0)`); // at distance 3
  page.element('keyAdd').dispatch('click');
  page.run('orbit(1, 0.2); zoomTo([0, 0, 0], 2)');
  page.element('keyAdd').dispatch('click');
  const [first, second] = page.element('keys').children.map((row) => row.children[0]);
  page.run('camera.target = [9, 9, 9]');
  first.dispatch('click');
  inFront(3);
  near(page.run('norm(add(camera.target, camera.position, -1))'), 3, 1e-9);
  second.dispatch('click');
  inFront(6);
  page.element('pathSeconds').value = '1';
  page.element('play').dispatch('click');
  page.pass(250); // the start
  page.pass(); // a quarter
  near(page.run('norm(add(camera.target, camera.position, -1))'), 3.75, 1e-9);
  inFront(3.75);
}

// ---- Keys ----

function fly_keys_are_places_on_the_keyboard_and_act_outside_of_form_fields() {
  // What a press of half a second changes.
  const flown = (key, code, focus, panel = null) => {
    const page = viewerPage(), document = page.sandbox.document;
    document.activeElement = focus ? Object.assign(page.element('focused'), {tagName: focus, closest: (name) => (name === '#panel' ? panel : null)}) : document.body;
    const before = page.run('camera.position.slice()');
    const pressed = document.dispatch('keydown', {key, code});
    for (let k = 0; k < 6; ++k) { page.pass(100); }
    document.dispatch('keyup', {key, code});
    page.pass(100);
    const step = page.run('camera.position').map((value, k) => value - before[k]);
    page.pass(100);
    page.pass(100);
    page.run('camera.position').forEach((value, k) => near(value - before[k], step[k], 1e-12)); // it ends
    return {forward: -page.run('camera.back').reduce((sum, value, k) => sum + value * step[k], 0), prevented: Boolean(pressed.prevented)};
  };
  const plain = flown('w', 'KeyW', null);
  assert.ok(plain.forward > 0.1 && plain.prevented);
  for (const [key, code, focus] of [['z', 'KeyW', 'CANVAS'], ['Z', 'KeyW', 'BUTTON'], ['ц', 'KeyW', null]])
    near(flown(key, code, focus).forward, plain.forward, 1e-9);
  for (const [key, code, focus] of [['w', 'KeyZ', null], ['w', 'KeyW', 'INPUT'], ['w', 'KeyW', 'SELECT'], ['w', 'KeyW', 'TEXTAREA']]) {
    const {forward, prevented} = flown(key, code, focus);
    assert.ok(forward === 0 && !prevented, `${key} ${code} ${focus}`);
  }
  assert.equal(flown('Enter', 'Enter', 'BUTTON').prevented, false);
  assert.equal(flown('ArrowLeft', 'ArrowLeft', 'INPUT').prevented, false);
  assert.equal(flown('ArrowLeft', 'ArrowLeft', 'CANVAS').prevented, true);
  assert.equal(flown('Home', 'Home', 'CANVAS').prevented, true);
  for (const key of ['ArrowDown', 'Home']) assert.equal(flown(key, key, 'BUTTON', {}).prevented, false); // scrolls the panel
  near(flown('w', 'KeyW', 'BUTTON', {}).forward, plain.forward, 1e-9);
}

function a_form_field_or_another_window_ends_the_flight() {
  const still = (stop) => {
    const page = viewerPage(), document = page.sandbox.document;
    document.dispatch('keydown', {key: 'w', code: 'KeyW'});
    for (let k = 0; k < 4; ++k) page.pass(100);
    stop(page, document);
    page.pass(100);
    const before = page.run('camera.position.slice()');
    for (let k = 0; k < 4; ++k) page.pass(100);
    assert.deepEqual(page.run('camera.position.slice()'), before);
  };
  still((page) => page.sandbox.window.dispatch('blur'));
  still((page, document) => {
    document.activeElement = Object.assign(page.element('focused'), {tagName: 'INPUT'});
    document.dispatch('focusin');
  });
}

// ---- Saved images ----

function only_exact_images_are_saved() {
  // A page whose last request has the given picture. saved(): the number of files; say(): the message.
  const start = (hello = {}) => {
    const page = viewerPage(hello);
    const shows = (lossless, serial = page.run('viewer.serial')) => page.run(`showPicture({serial: ${serial}, lossless: ${lossless}, width: 640, height: 360,
      full_width: 640, full_height: 360, seconds: 1, gaussians: 1, aov: 'rgba'}, {close() {}})`);
    const saved = () => page.clicked.filter((link) => link.download === 'model.ply.png').length;
    return {page, shows, saved, press: () => page.element('screenshot').dispatch('click'), say: () => page.element('message').textContent};
  };
  let {page, shows, saved, press, say} = start();
  shows(true);
  press();
  assert.equal(saved(), 1);

  ({page, shows, saved, press, say} = start()); // a preview, as JPEG: saved once the exact one is there
  shows(false);
  press();
  assert.equal(saved(), 0);
  assert.match(say(), /not exact yet/);
  shows(false);
  assert.equal(saved(), 0);
  page.run('requestPicture(false)');
  page.pass();
  shows(true, page.run('viewer.serial') - 1); // of an earlier request
  assert.equal(saved(), 0);
  shows(true);
  assert.equal(saved(), 1);
  shows(true);
  assert.equal(saved(), 1);
  assert.equal(say(), '');

  ({page, shows, saved, press, say} = start()); // exact, but of the camera before
  shows(true);
  page.run('orbit(0.1, 0)');
  page.pass();
  press();
  assert.equal(saved(), 0);
  page.run('orbit(0.1, 0)'); // the view changes
  page.pass();
  shows(true);
  assert.equal(saved(), 0);
  assert.match(say(), /changed/);
  shows(true);
  assert.equal(saved(), 0);

  ({page, shows, saved, press, say} = start({training: true}));
  shows(false);
  press();
  assert.match(say(), /paused/);

  // The largest one that --max-memory permits is saved at its own size, and the page says so.
  ({page, shows, saved, press, say} = start({training: true}));
  page.run(`showPicture({serial: viewer.serial, lossless: true, limited: true, width: 320, height: 180,
    full_width: 640, full_height: 360, seconds: 1, gaussians: 1, aov: 'rgba'}, {close() {}})`);
  press();
  assert.equal(saved(), 1);
  assert.deepEqual([page.element('picture').width, page.element('picture').height], [320, 180]);
  assert.match(say(), /320 × 180.*--max-memory/);
  shows(true); // then another size permits the whole picture
  assert.deepEqual([page.element('picture').width, page.element('picture').height], [640, 360]);
}

// ---- Regions ----

function a_region_is_over_or_under_its_quota() {
  const region = (count) => {
    const page = viewerPage();
    page.sandbox.message = {type: 'region', voxel: 7, updates: [{iteration: 10, count, quota: 20, center: [0, 0, 0]}]};
    page.run('listeners.region.forEach((call) => call(message))');
    return page.element('regionText').textContent;
  };
  assert.match(region(21), /21 primitives, quota 20: over quota$/);
  assert.match(region(19), /19 primitives, quota 20: under quota$/);
}

// ---- Clicks ----

function a_double_click_asks_for_no_ray_and_a_click_for_one() {
  const page = viewerPage(), picture = page.element('picture'), at = {pointerId: 1, clientX: 100, clientY: 80, button: 0, buttons: 1};
  const click = () => { picture.dispatch('pointerdown', at); picture.dispatch('pointerup', at); };
  const rays = () => page.sent.filter((message) => message.type === 'ray').length;
  click();
  page.pass(100);
  click();
  picture.dispatch('dblclick', at);
  page.pass(1000);
  page.pass(1000);
  assert.equal(rays(), 0);
  click();
  page.pass(1000);
  assert.equal(rays(), 1);
  click();
  page.run('orbit(0.1, 0)'); // the pixel is no longer that of the click
  page.pass(1000);
  page.pass(1000);
  assert.equal(rays(), 1);
}

// ---- The run ----

function a_finished_training_is_not_controlled() {
  const page = viewerPage({training: true, run: true}), sent = () => page.sent.filter((message) => message.type === 'run').map((message) => message.action);
  const tell = (finished) => {
    page.sandbox.message = {type: 'progress', iteration: 9, total: 9, loss: 0, psnr: 0, gaussians: 1, rate: 1, rss: 1, paused: false, finished, phases: {}};
    page.run('listeners.progress.forEach((call) => call(message))');
  };
  tell(false);
  page.sandbox.window.confirm = () => true;
  page.element('stop').dispatch('click');
  page.element('pause').dispatch('click');
  assert.deepEqual(sent(), ['stop', 'pause']);
  page.sandbox.window.confirm = () => { tell(true); return true; }; // it ends while the page asks
  page.element('stop').dispatch('click');
  page.element('pause').dispatch('click');
  assert.deepEqual(sent(), ['stop', 'pause']);
}

function the_page_says_that_an_exr_file_is_being_saved() {
  const page = viewerPage(), say = () => page.element('message').textContent;
  page.element('exr').dispatch('click');
  assert.equal(page.sent.at(-1).type, 'exr');
  assert.equal(say(), 'Saving…');
  page.run("listeners.saved.forEach((call) => call({type: 'saved', path: 'a/view_0001.exr'}))");
  assert.equal(say(), 'Saved a/view_0001.exr');
  page.sockets[0].readyState = 3;
  page.element('exr').dispatch('click'); // not requested without a connection
  assert.equal(say(), 'Saved a/view_0001.exr');
}

// ---- Places ----

function a_page_without_a_place_tries_again() {
  const page = viewerPage(), notice = () => page.element('notice').hidden ? '' : page.element('notice').textContent;
  page.sockets[0].onmessage({data: '{"type":"full"}'});
  assert.equal(notice(), 'Eight pages are already open. Close one to continue here.');
  page.sockets[0].onclose();
  page.pass(9000);
  assert.equal(page.sockets.length, 1);
  page.pass(2000);
  assert.equal(page.sockets.length, 2); // after 10 s
  page.sockets[1].onopen();
  assert.match(notice(), /^Eight pages/); // it does not know yet
  page.sockets[1].onmessage({data: '{"type":"full"}'});
  page.sockets[1].onclose();
  page.pass(11000);
  assert.equal(page.sockets.length, 3);
  page.sockets[2].onopen();
  page.sockets[2].onmessage({data: '{"type":"history","train":{},"spare":{}}'});
  assert.equal(notice(), '');
  page.sockets[2].onclose(); // the program ends
  assert.match(notice(), /Reconnecting in 1 s \(attempt 1\)/);
  page.pass(1000);
  page.sockets[3].onopen();
  page.sockets[3].onclose(); // no thread for a place: later and later
  assert.match(notice(), /Reconnecting in 2 s \(attempt 2\)/);
}

async function a_page_with_an_old_token_says_so() {
  const page = viewerPage();
  page.sandbox.fetch = async () => ({status: 401});
  await page.run('checkToken()');
  assert.equal(page.element('notice').textContent, 'The token has changed. Open the URL printed by sparegs.');
}

// ---- Ranges ----

// Fills fields and runs their handlers. Returns the last camera message.
function fill(page, values) {
  for (const [id, value] of Object.entries(values)) page.element(id)[typeof value === 'boolean' ? 'checked' : 'value'] = value;
  for (const id of Object.keys(values)) page.element(id).dispatch('change');
  page.pass();
  return page.sent.filter((message) => message.type === 'camera').at(-1);
}

function a_logarithmic_range_that_is_not_positive_is_reported_and_not_sent() {
  const page = viewerPage(), text = () => page.element('rangeText').textContent;
  let sent = fill(page, {aov: 'depth', rangeLow: '0', rangeHigh: '5'});
  assert.deepEqual([...sent.range], [0, 5]);
  assert.equal(text(), '');
  sent = fill(page, {log: true});
  assert.ok(sent.log && !('range' in sent));
  assert.equal(text(), 'A logarithmic range must be positive.');
  assert.equal(page.element('rangeLow')['aria-invalid'], 'true');
  sent = fill(page, {rangeLow: '0.5'});
  assert.deepEqual([...sent.range], [0.5, 5]);
  assert.equal(text(), '');
}

function crop_values_out_of_range_are_marked_and_not_sent() {
  for (const [id, value, name] of [['cropOpacity', '2', 'opacity'], ['cropOpacity', '-1', 'opacity'], ['cropSize', '-1', 'size'], ['cropSize', '1e40', 'size'],
    ['cropRegion', '4294967296', 'region'], ['cropRegion', '-1', 'region'], ['cropSlack', '1e300', 'slack']]) {
    const page = viewerPage({aovs: [{name: 'rgba'}, {name: 'slack'}]});
    const plain = fill(page, {cropPreview: 'mark'}).crop;
    const {crop} = fill(page, {[id]: value});
    assert.deepEqual({...crop}, {...plain}, id); // as an empty field
    assert.equal(page.element(id)['aria-invalid'], 'true');
    page.run("showPicture({serial: viewer.serial, lossless: true, width: 640, height: 360, full_width: 640, full_height: 360, seconds: 1, gaussians: 9, removed: 3, aov: 'rgba'}, {close() {}})");
    assert.match(page.element('cropText').textContent, /3 of 9 primitives are removed.*out of range/);
    page.element('cropSave').dispatch('click');
    assert.ok(!page.sent.some((message) => message.type === 'crop'));
    assert.match(page.element('message').textContent, /out of range/);
    assert.ok(name in fill(page, {[id]: '1'}).crop);
    assert.equal(page.element(id)['aria-invalid'], 'false');
    page.element('cropSave').dispatch('click');
    assert.ok(page.sent.some((message) => message.type === 'crop'));
  }
  const page = viewerPage(); // a sphere without a radius, and a box without a limit
  const {crop} = fill(page, {cropPreview: 'mark', sphereOn: true, boxOn: true, sphere_radius: '-1', box_x: '-1e31'});
  assert.ok(!('sphere' in crop) && crop.box[0] === null && crop.box[1] !== null);
}

function only_cropped_pictures_count_removed_primitives() {
  const page = viewerPage();
  fill(page, {cropPreview: 'hide', cropOpacity: '0.5'});
  page.run("showPicture({serial: viewer.serial, lossless: true, width: 640, height: 360, full_width: 640, full_height: 360, seconds: 1, gaussians: 9, aov: 'primitive'}, {close() {}})");
  assert.equal(page.element('cropText').textContent, 'This AOV shows the whole model');
}

// ---- Lenses and photos ----

const photoView = (name) => ({name, width: 640, height: 480, photo: true, test: false, lens: 'OPENCV', fisheye: false, fov: 50, intrinsics: [500, 500, 320, 240],
  params: [500, 500, 320, 240, 0.1, 0, 0, 0], camera_to_world: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 3, 0, 0, 0, 1]});

function the_controls_show_the_lens_of_the_camera() {
  const page = viewerPage({views: [photoView('a')]});
  const shown = () => [page.element('lens').value, Number(page.element('fov').value), page.element('fovText').textContent];
  assert.deepEqual(shown(), ['0', 50, '50°']);
  page.run('camera.fov = 30; zoomTo(camera.target, 2)');
  page.element('keyAdd').dispatch('click');
  page.element('keys').children[0].children[0].dispatch('click'); // paths are pinhole
  assert.deepEqual(shown(), ['-1', 30, '30°']);
  page.element('home').dispatch('click');
  assert.deepEqual(shown(), ['0', 50, '50°']);
  const free = viewerPage();
  fill(free, {lens: '-1'});
  free.run("camera.lens = 0; camera.fov = 20");
  free.element('home').dispatch('click');
  assert.deepEqual([free.element('lens').value, Number(free.element('fov').value)], ['-1', 20]);
}

function photos_are_loaded_for_a_comparison_only() {
  const page = viewerPage({views: [photoView('a'), photoView('b')]}), photo = page.element('photo');
  assert.equal(photo.src, undefined);
  page.run('choosePhoto(1)');
  assert.equal(photo.src, undefined);
  fill(page, {compare: 'slider'});
  assert.equal(photo.src, '/photo/1?model=1');
  assert.equal(page.run('photoReady'), false);
  const slow = photo.onload;
  page.run('choosePhoto(0)');
  assert.equal(photo.src, '/photo/0?model=1');
  slow(); // of the photo before
  assert.equal(page.run('photoReady'), false);
  photo.dispatch('load');
  assert.equal(page.run('photoReady'), true);
  photo.src = 'kept';
  fill(page, {compare: 'photo'}); // it is loaded once
  assert.equal(photo.src, 'kept');
}

async function a_photo_that_is_refused_says_why() {
  const page = viewerPage({views: [photoView('a')]}), settled = () => new Promise((done) => setImmediate(done));
  fill(page, {compare: 'photo'});
  page.sandbox.fetch = async (to) => { page.requests.push(to); return {status: 507, text: async () => 'the photo is not shown: it takes about 80 MB\n'}; };
  page.element('photo').dispatch('error');
  await settled();
  assert.deepEqual(page.requests, ['/photo/0?model=1']);
  assert.equal(page.element('message').textContent, 'Error: the photo is not shown: it takes about 80 MB');
  page.sandbox.fetch = async () => ({status: 404});
  page.element('photo').dispatch('error');
  await settled();
  assert.equal(page.element('message').textContent, 'Error: the photo a cannot be loaded');
}

function a_sideways_wheel_keeps_the_camera() {
  const page = viewerPage({views: [photoView('a')]}), at = {clientX: 100, clientY: 100};
  page.element('picture').dispatch('wheel', {...at, deltaX: 50, deltaY: 0});
  assert.equal(page.run('camera.view'), 0);
  page.element('picture').dispatch('wheel', {...at, deltaX: 0, deltaY: 50});
  assert.equal(page.run('camera.view'), -1);
}

function points_near_the_camera_are_drawn_in_small_models() {
  for (const extent of [1e-3, 1, 1e4]) {
    const page = viewerPage({extent});
    assert.notEqual(page.run(`throughLens(lensOf(null), [0, 0, ${0.01 * extent}])`), null);
    assert.equal(page.run(`throughLens(lensOf(null), [0, 0, ${1e-4 * extent}])`), null);
  }
}

const checks = [
  the_standalone_page_orbits_about_the_up_axis_of_the_file, drags_of_photos_in_portrait_change_azimuth_and_elevation,
  a_long_drag_keeps_its_direction, drags_of_photos_taken_straight_down_turn_and_tilt, level_horizon_puts_the_up_axis_up,
  missing_values_leave_the_report_complete, only_identical_pictures_have_an_infinite_psnr, a_section_that_fails_leaves_a_line_and_the_others,
  addresses_follow_the_path_of_the_page, the_orbit_centre_lies_in_front_of_the_cameras_of_a_path,
  fly_keys_are_places_on_the_keyboard_and_act_outside_of_form_fields, a_form_field_or_another_window_ends_the_flight,
  only_exact_images_are_saved, a_region_is_over_or_under_its_quota, a_double_click_asks_for_no_ray_and_a_click_for_one,
  a_finished_training_is_not_controlled, the_page_says_that_an_exr_file_is_being_saved, a_page_without_a_place_tries_again,
  a_page_with_an_old_token_says_so, a_logarithmic_range_that_is_not_positive_is_reported_and_not_sent, crop_values_out_of_range_are_marked_and_not_sent,
  only_cropped_pictures_count_removed_primitives, the_controls_show_the_lens_of_the_camera, photos_are_loaded_for_a_comparison_only,
  a_photo_that_is_refused_says_why, a_sideways_wheel_keeps_the_camera, points_near_the_camera_are_drawn_in_small_models,
];

async function main() {
  let failed = 0;
  for (const check of checks) {
    try {
      await check();
      console.log('ok ' + check.name);
    } catch (error) {
      ++failed;
      console.log('FAIL ' + check.name + '\n' + error.stack);
    }
  }
  process.exit(failed ? 1 : 0);
}
main();
