// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The camera of this page. Axes in world space as in a camera path: right, up, back (OpenGL).

const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const norm = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => times(a, 1 / (norm(a) || 1));

const camera = viewer.camera = {
  position: [0, 0, 0], right: [1, 0, 0], up: [0, 1, 0], back: [0, 0, 1],
  fov: 50,     // vertical, degrees
  target: [0, 0, -1], // of the orbit
  view: -1,    // exactly this photo's camera
  lens: -1,    // the lens of this photo, -1: a pinhole
  type: 'perspective',
};
let worldUp = [0, -1, 0];

function rotate(vector, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(times(vector, c), cross(axis, vector), s), axis, dot(axis, vector) * (1 - c));
}

function orthonormalise() {
  camera.back = unit(camera.back);
  camera.right = unit(add(camera.right, camera.back, -dot(camera.right, camera.back)));
  camera.up = cross(camera.back, camera.right);
}

function setMatrix(m) {
  camera.right = [m[0], m[4], m[8]];
  camera.up = [m[1], m[5], m[9]];
  camera.back = [m[2], m[6], m[10]];
  camera.position = [m[3], m[7], m[11]];
  updateRoll(true);
}

function matrix(of = camera) {
  const {right: r, up: u, back: b, position: p} = of;
  return [r[0], u[0], b[0], p[0], r[1], u[1], b[1], p[1], r[2], u[2], b[2], p[2], 0, 0, 0, 1];
}

// The user moved the camera: it is no photo's any more.
function moved() {
  camera.view = -1;
  orthonormalise();
  requestPicture(true);
  photoLeft();
}

function turn(axis, angle, center) {
  for (const name of ['right', 'up', 'back']) camera[name] = rotate(camera[name], axis, angle);
  camera.position = add(center, rotate(add(camera.position, center, -1), axis, angle));
}

// How the camera is rolled about its axis: upside down beyond 135 degrees, sideways (a photo in portrait) from 45 to 135.
// Both keep their value within 8 degrees of these limits, so that no drag changes its direction. Near the poles the roll
// is not defined.
let upsideDown = false, sideways = false;

// `isNew`: the camera was set, or the up axis.
function updateRoll(isNew) {
  const level = dot(worldUp, camera.up), slack = isNew ? 0 : 0.1, limit = Math.SQRT1_2;
  const flat = Math.hypot(level, dot(worldUp, camera.right)), roll = flat > 0.05 ? level / flat : 1; // cosine
  if (isNew || flat > 0.5) {
    upsideDown = roll < -limit + (upsideDown ? slack : -slack);
    sideways = flat > 0.5 && Math.abs(roll) < limit + (sideways ? slack : -slack);
  }
}

// The up axis on the side of the camera's own, so that dragging right turns right in any capture.
function turningAxis() {
  updateRoll(false);
  return upsideDown ? times(worldUp, -1) : worldUp;
}

// The axis of the elevation: the camera's own right axis, but of a camera that is sideways the horizontal one.
function elevationAxis() {
  const level = cross(turningAxis(), camera.back);
  return sideways && norm(level) > 1e-3 ? unit(level) : camera.right;
}

function orbit(dx, dy) {
  turn(turningAxis(), -dx, camera.target);
  const axis = elevationAxis(), height = dot(camera.back, worldUp);
  const next = dot(rotate(camera.back, axis, -dy), worldUp);
  if (Math.abs(next) < 0.998 || Math.abs(next) < Math.abs(height)) turn(axis, -dy, camera.target);
  moved();
}

function look(dx, dy) {
  turn(turningAxis(), dx, camera.position);
  turn(elevationAxis(), dy, camera.position);
  camera.target = add(camera.position, camera.back, -targetDistance());
  moved();
}

function targetDistance() {
  return Math.max(norm(add(camera.target, camera.position, -1)), 1e-3 * (viewer.hello ? viewer.hello.extent : 1));
}

function pan(dx, dy) {
  const size = 2 * targetDistance() * Math.tan(camera.fov * Math.PI / 360);
  const step = add(times(camera.right, -dx * size), camera.up, dy * size);
  camera.position = add(camera.position, step);
  camera.target = add(camera.target, step);
  moved();
}

function fly(right, up, forward) {
  const step = add(add(times(camera.right, right), camera.up, up), camera.back, -forward);
  camera.position = add(camera.position, step);
  camera.target = add(camera.target, step);
  moved();
}

// Moves towards (factor below 1) or away from a point.
function zoomTo(point, factor) {
  camera.position = add(point, add(camera.position, point, -1), factor);
  camera.target = add(point, add(camera.target, point, -1), factor);
  moved();
}

function levelHorizon() {
  const right = cross(worldUp, camera.back);
  if (norm(right) > 1e-4) camera.right = unit(right);
  orthonormalise();
  updateRoll(true);
  moved();
}

// The view whose lens the picture has; null: a pinhole.
function lensView() {
  return camera.lens >= 0 ? viewer.hello.views[camera.lens] : null;
}

// Focal length and principal point, in pixels, of the picture as requested.
function intrinsics(width, height) {
  const view = lensView();
  if (!view) {
    const focal = 0.5 * height / Math.tan(camera.fov * Math.PI / 360);
    return [focal, focal, width / 2, height / 2];
  }
  const scale = height / view.height, [fx, fy, cx, cy] = view.intrinsics;
  return [fx * scale, fy * scale, width / 2 + (cx - view.width / 2) * scale, cy * scale];
}

// Unit direction in world space of the ray through a pixel.
function rayThrough(x, y) {
  const [fx, fy, cx, cy] = intrinsics(request.width, request.height);
  const ray = rayOfLens(lensOf(lensView()), [(x + 0.5 - cx) / fx, (y + 0.5 - cy) / fy]);
  return unit(add(add(times(camera.right, ray[0]), camera.up, -ray[1]), camera.back, -ray[2]));
}

function goToView(index) {
  const view = viewer.hello.views[index];
  setMatrix(view.camera_to_world);
  camera.fov = view.fov;
  camera.view = camera.lens = index;
  // Orbit around the point of interest's depth along the axis of this view.
  const depth = -dot(add(viewer.hello.target, camera.position, -1), camera.back);
  camera.target = add(camera.position, camera.back, -(depth > 0 ? depth : viewer.hello.extent));
  requestPicture(false);
}

function goHome() {
  const hello = viewer.hello;
  if (hello.views.length) {
    choosePhoto(0);
    return;
  }
  const up = unit(worldUp);
  const side = Math.abs(up[2]) < 0.9 ? [0, 0, -1] : [-1, 0, 0];
  camera.back = unit(add(side, up, 0.35 - dot(side, up)));
  camera.right = unit(cross(up, camera.back));
  camera.target = hello.target.slice();
  camera.position = add(camera.target, camera.back, 1.6 * hello.extent);
  camera.lens = -1;
  showLens();
  orthonormalise();
  updateRoll(true);
  moved();
}

// ---- Requests ----

// What the canvas shows: size in pixels and the camera message that was sent last.
const request = {width: 640, height: 360, message: null};
let restTimer = 0, frameAsked = false, movingNow = false;

function pictureSize() {
  const stage = byId('stage').getBoundingClientRect();
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  let width = Math.max(64, Math.round(stage.width * ratio)), height = Math.max(64, Math.round(stage.height * ratio));
  const choice = byId('size').value, index = camera.view >= 0 ? camera.view : camera.lens;
  const view = index >= 0 ? viewer.hello.views[index] : null;
  if (choice.includes('x')) [width, height] = choice.split('x').map(Number);
  if (choice === 'photo' && view) {
    [width, height] = [view.width, view.height];
  } else if (camera.view >= 0) { // the photo lies over the picture
    const scale = Math.min(width / view.width, height / view.height);
    [width, height] = [Math.max(1, Math.round(view.width * scale)), Math.max(1, Math.round(view.height * scale))];
  }
  const limit = Math.min(1, Math.sqrt(16e6 / (width * height)), 8192 / Math.max(width, height));
  return [Math.floor(width * limit), Math.floor(height * limit)];
}

// What is wrong with the limits of the colour range, or ''; without limits the program measures the range of each picture.
function rangeProblem() {
  const low = byId('rangeLow').value, high = byId('rangeHigh').value;
  if (!rampOf(byId('aov').value) || (low === '' && high === '')) return '';
  if (low === '' || high === '') return 'Enter both limits, or neither.';
  if (!(Number(high) > Number(low))) return 'The upper limit must exceed the lower one.';
  return byId('log').checked && !(Number(low) > 0) ? 'A logarithmic range must be positive.' : '';
}

function cameraMessage(moving) {
  [request.width, request.height] = pictureSize();
  const message = {type: 'camera', serial: ++viewer.serial, width: request.width, height: request.height, moving,
    aov: byId('aov').value || 'rgba', samples: Number(byId('samples').value)};
  const low = byId('rangeLow').value, high = byId('rangeHigh').value;
  if (rampOf(message.aov)) { // the range applies to colour-mapped AOVs only
    message.log = byId('log').checked;
    if (low !== '' && !rangeProblem()) message.range = [Number(low), Number(high)];
  }
  if (camera.view >= 0) {
    message.view = camera.view;
  } else {
    message.camera_to_world = matrix();
    message.fov = camera.fov;
    message.camera_type = camera.type;
    if (camera.lens >= 0) message.lens = camera.lens;
  }
  if (cropValues().preview !== 'off') message.crop = cropValues();
  return message;
}

function sendRequest(moving) {
  if (!viewer.hello) return;
  request.message = cameraMessage(moving);
  viewer.sent.set(viewer.serial, performance.now());
  if (viewer.sent.size > 400) viewer.sent.delete(viewer.sent.keys().next().value);
  send(request.message);
  layout();
}

// Requests are sent once per display frame; REST ms after the last movement the picture is refined.
function requestPicture(moving) {
  const REST = 140;
  clearTimeout(restTimer);
  movingNow = moving;
  if (moving) restTimer = setTimeout(() => requestPicture(false), REST);
  if (frameAsked) return;
  frameAsked = true;
  requestAnimationFrame(() => {
    frameAsked = false;
    sendRequest(movingNow);
  });
}
