// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A camera path through key frames: positions by Catmull-Rom splines, rotations by spherical
// interpolation of quaternions. The file is a camera path as nerfstudio writes it, which
// `sparegs render --camera` reads.

const keys = viewer.keys = [];

function quaternionOf(m) {
  const t = m[0] + m[5] + m[10];
  let q;
  if (t > 0) q = [1 + t, m[9] - m[6], m[2] - m[8], m[4] - m[1]];
  else if (m[0] > m[5] && m[0] > m[10]) q = [m[9] - m[6], 1 + m[0] - m[5] - m[10], m[1] + m[4], m[2] + m[8]];
  else if (m[5] > m[10]) q = [m[2] - m[8], m[1] + m[4], 1 + m[5] - m[0] - m[10], m[6] + m[9]];
  else q = [m[4] - m[1], m[2] + m[8], m[6] + m[9], 1 + m[10] - m[0] - m[5]];
  const length = Math.hypot(...q);
  return q.map((value) => value / length);
}

function matrixOf([w, x, y, z], p) {
  return [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), p[0],
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), p[1],
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), p[2], 0, 0, 0, 1];
}

function slerp(a, b, t) {
  let cosine = a.reduce((sum, value, k) => sum + value * b[k], 0);
  if (cosine < 0) { b = b.map((value) => -value); cosine = -cosine; }
  const angle = Math.acos(Math.min(1, cosine));
  const [s, e] = angle < 1e-6 ? [1 - t, t] : [Math.sin((1 - t) * angle) / Math.sin(angle), Math.sin(t * angle) / Math.sin(angle)];
  const q = a.map((value, k) => s * value + e * b[k]), length = Math.hypot(...q);
  return q.map((value) => value / length);
}

// The camera at t from 0 (first key frame) to 1 (last).
function pathAt(t) {
  const at = t * (keys.length - 1), i = Math.min(Math.floor(at), keys.length - 2), u = at - i;
  const [p0, p1, p2, p3] = [-1, 0, 1, 2].map((k) => keys[Math.min(Math.max(i + k, 0), keys.length - 1)].position);
  const position = [0, 1, 2].map((k) => 0.5 * (2 * p1[k] + (p2[k] - p0[k]) * u + (2 * p0[k] - 5 * p1[k] + 4 * p2[k] - p3[k]) * u * u +
    (3 * p1[k] - p0[k] - 3 * p2[k] + p3[k]) * u * u * u));
  const a = keys[i], b = keys[i + 1];
  const between = (name) => a[name] + u * (b[name] - a[name]);
  return {matrix: matrixOf(slerp(a.rotation, b.rotation, u), position), fov: between('fov'), distance: between('distance')};
}

// Moves the camera to a key frame or a point of the path, with the centre of the orbit in front of it.
function goToKey(key) {
  setMatrix(key.matrix);
  camera.target = add(camera.position, camera.back, -key.distance);
  camera.fov = key.fov;
  camera.lens = -1;
  showLens();
  moved();
}

// The number of a field; its initial one if it is empty or not positive.
function positive(id) {
  const value = Number(byId(id).value);
  return value > 0 ? value : Number(byId(id).defaultValue);
}

function pathFile() {
  const fps = positive('pathFps'), seconds = positive('pathSeconds');
  const count = Math.max(2, Math.round(fps * seconds)), aspect = request.width / request.height;
  const frames = [];
  for (let i = 0; i < count; ++i) {
    const at = pathAt(i / (count - 1));
    frames.push({camera_to_world: at.matrix, fov: at.fov, aspect});
  }
  return {camera_type: 'perspective', render_width: request.width, render_height: request.height, fps, seconds,
    keyframes: keys.map((key) => ({matrix: key.matrix, fov: key.fov, aspect})), camera_path: frames};
}

function listKeys() {
  const list = byId('keys');
  list.replaceChildren();
  keys.forEach((key, index) => {
    const row = element('li', null, list);
    const go = element('button', `at (${key.position.map((value) => number(value, 3)).join(', ')})`, row);
    go.type = 'button';
    go.onclick = () => goToKey(key);
    const remove = element('button', 'Remove', row);
    remove.type = 'button';
    remove.setAttribute('aria-label', `Remove key frame ${index + 1}`);
    remove.onclick = () => { keys.splice(index, 1); listKeys(); };
  });
  byId('play').disabled = byId('pathSave').disabled = keys.length < 2;
  if (keys.length < 2) stopPlaying();
}

byId('keyAdd').onclick = () => {
  const m = matrix();
  keys.push({matrix: m, position: camera.position.slice(), rotation: quaternionOf(m), fov: camera.fov, distance: targetDistance()});
  listKeys();
};

let playing = 0;
function playStep(time) {
  if (!playing) return;
  const t = (time - playing) / 1000 / positive('pathSeconds');
  goToKey(pathAt(Math.min(Math.max(t, 0), 1)));
  if (t < 1) requestAnimationFrame(playStep);
  else stopPlaying();
}

function stopPlaying() {
  playing = 0;
  byId('play').textContent = 'Play';
}

byId('play').onclick = () => {
  if (playing) { stopPlaying(); return; }
  byId('play').textContent = 'Stop';
  requestAnimationFrame((time) => { playing = time; playStep(time); });
};

byId('pathSave').onclick = () => {
  viewer.saved = {kind: 'path', text: JSON.stringify(pathFile(), null, 1)};
  download('path.json', new Blob([viewer.saved.text], {type: 'application/json'}));
};
listKeys();
