// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Crop and clean: the filters of `sparegs convert`, previewed by the program. Box and sphere are drawn over the picture;
// their handles can be dragged.

const boxNames = ['x', 'y', 'z', 'X', 'Y', 'Z'], sphereNames = ['x', 'y', 'z', 'radius'];

function cropFields(box, prefix, names) {
  for (const name of names) {
    const label = element('label', name + ' ', byId(box)), input = element('input', null, label);
    input.type = 'number';
    input.step = 'any';
    input.id = prefix + name;
    const limit = prefix !== 'box_' ? name : (name === name.toLowerCase() ? 'minimum ' : 'maximum ') + name.toLowerCase();
    input.title = limit;
    input.setAttribute('aria-label', limit);
    input.onchange = cropChanged;
  }
}
cropFields('boxFields', 'box_', boxNames);
cropFields('sphereFields', 'sphere_', sphereNames);

// The fields, and the ranges of those that are not coordinates.
const cropIds = [...boxNames.map((name) => 'box_' + name), ...sphereNames.map((name) => 'sphere_' + name), 'cropOpacity', 'cropSize',
  'cropSlack', 'cropRegion'];
const cropRanges = {cropOpacity: [0, 1], cropSize: [0, Infinity], sphere_radius: [0, Infinity], cropRegion: [0, 4294967295]};

function isInRange(id) {
  const value = Number(byId(id).value), [low, high] = cropRanges[id] || [-Infinity, Infinity];
  return value >= low && value <= high && Math.abs(value) < 1e30;
}

// The number of a field; null if it is empty or out of range: no limit.
function cropNumber(id) {
  return byId(id).value === '' || !isInRange(id) ? null : Number(byId(id).value);
}

function cropNumbers(prefix, names) {
  return names.map((name) => cropNumber(prefix + name));
}

function cropValues() {
  const crop = {preview: byId('cropPreview').value, opacity: cropNumber('cropOpacity') || 0, size: cropNumber('cropSize') || 0,
    floaters: byId('cropFloaters').checked}, slack = cropNumber('cropSlack'), region = cropNumber('cropRegion');
  if (slack !== null) crop.slack = slack;
  if (region !== null) crop.region = Math.round(region);
  if (byId('boxOn').checked) crop.box = cropNumbers('box_', boxNames);
  const sphere = cropNumbers('sphere_', sphereNames);
  if (byId('sphereOn').checked && !sphere.includes(null)) crop.sphere = sphere;
  return crop;
}

function cropProblem() {
  const wrong = cropIds.some((id) => !isInRange(id));
  return (wrong ? '. The marked values are out of range and not applied' : '') +
    (byId('sphereOn').checked && !cropValues().sphere ? '. The sphere requires four numbers and is not applied' : '');
}

function markCrop() {
  for (const id of cropIds) byId(id).setAttribute('aria-invalid', String(!isInRange(id)));
}

function quoted(text) {
  return /^[\w./+-]+$/.test(text) ? text : "'" + text.replaceAll("'", "'\\''") + "'";
}

// The command line that makes the same file.
function cropCommand() {
  const crop = cropValues(), words = ['sparegs convert', quoted(viewer.hello.model), 'OUT.ply'];
  if (crop.box) words.push('--filter-box ' + crop.box.map((value) => value === null ? '-' : value).join(','));
  if (crop.sphere) words.push('--filter-sphere ' + crop.sphere.join(','));
  if (crop.size > 0) words.push('--filter-value ' + [0, 1, 2].map((k) => `scale_${k},lte,${crop.size}`).join(','));
  if (crop.opacity > 0) words.push('--filter-opacity ' + crop.opacity);
  if ('slack' in crop) words.push('--filter-slack ' + crop.slack);
  if ('region' in crop) words.push('--filter-region ' + crop.region);
  if (crop.floaters) words.push('--filter-floaters auto');
  if (viewer.hello.marks) words.push(viewer.hello.marks);
  return words.join(' ');
}

function cropChanged() {
  if (byId('cropPreview').value === 'off') byId('cropPreview').value = 'mark';
  cropShown();
}

function cropShown() {
  markCrop();
  byId('cropCommand').textContent = cropCommand();
  byId('cropText').textContent = '';
  requestPicture(false);
}

function resetCrop() {
  byId('cropPreview').value = 'off';
  for (const id of ['boxOn', 'sphereOn', 'cropFloaters']) byId(id).checked = false;
  for (const id of ['cropSize', 'cropSlack', 'cropRegion']) byId(id).value = '';
  byId('cropOpacity').value = 0;
  for (const name of boxNames) byId('box_' + name).value = '';
  for (const name of sphereNames) byId('sphere_' + name).value = '';
  byId('cropText').textContent = '';
  markCrop();
}

function startCrop(hello) {
  byId('cropBox').hidden = hello.training;
  if (hello.training) resetCrop(); // the page of a stored model stays open
  byId('cropRegions').hidden = !hello.aovs.some((aov) => aov.name === 'slack');
  if (byId('box_x').value === '') {
    const digits = (value) => Number(value.toPrecision(4));
    boxNames.forEach((name, k) => {
      byId('box_' + name).value = digits(hello.target[k % 3] + (k < 3 ? -0.5 : 0.5) * hello.extent);
    });
    sphereNames.forEach((name, k) => { byId('sphere_' + name).value = digits(k < 3 ? hello.target[k] : 0.5 * hello.extent); });
  }
  byId('cropCommand').textContent = cropCommand();
}

for (const id of ['boxOn', 'sphereOn', 'cropOpacity', 'cropSize', 'cropSlack', 'cropRegion', 'cropFloaters']) byId(id).onchange = cropChanged;
byId('cropPreview').onchange = cropShown;
byId('cropSave').onclick = () => {
  if (cropIds.some((id) => !isInRange(id))) {
    showMessage('Error: values of the crop are out of range');
    return;
  }
  if (byId('cropPreview').value === 'off') byId('cropPreview').value = 'mark';
  sendRequest(false);
  send({type: 'crop', crop: cropValues()});
};
// Browsers have a clipboard only for pages of this machine or over TLS.
async function copyCommand() {
  try {
    await navigator.clipboard.writeText(cropCommand());
    byId('cropText').textContent = 'Copied.';
  } catch (error) {
    byId('cropText').textContent = 'Select the command and copy it.';
  }
}
byId('cropCopy').onclick = copyCommand;
onMessage('crop', (message) => {
  viewer.saved = {kind: 'crop', ...message};
  showMessage(`Saved ${message.kept.toLocaleString('en')} primitives as ${message.path}`);
});

// ---- Handles ----

// Points that can be dragged: {point, axis, apply(distance)}. axis NULL: in the plane of the picture.
function cropHandles() {
  const crop = cropValues(), handles = [], axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const move = (id, by) => { byId(id).value = Number((Number(byId(id).value) + by).toPrecision(7)); };
  if (crop.box && !crop.box.includes(null)) {
    const middle = [0, 1, 2].map((k) => (crop.box[k] + crop.box[k + 3]) / 2);
    crop.box.forEach((value, k) => {
      const point = middle.slice();
      point[k % 3] = value;
      handles.push({point, axis: axes[k % 3], apply: (by) => move('box_' + boxNames[k], by)});
    });
  }
  if (crop.sphere) {
    handles.push({point: crop.sphere.slice(0, 3), axis: null,
      apply: (by) => by.forEach((value, k) => move('sphere_' + sphereNames[k], value))});
    handles.push({point: add(crop.sphere.slice(0, 3), camera.right, crop.sphere[3]), axis: camera.right,
      apply: (by) => { byId('sphere_radius').value = Math.max(0, Number((crop.sphere[3] + by).toPrecision(7))); }});
  }
  return byId('cropPreview').value === 'off' ? [] : handles;
}

// The handle near a point of the picture, and its distance from it; null without one.
function handleAt(pointer) {
  const reach = 12 * request.height / picture.getBoundingClientRect().height;
  const places = cropHandles().map((handle) => project(handle.point));
  const index = places.findIndex((at) => at && Math.hypot(at[0] - pointer[0], at[1] - pointer[1]) < reach);
  return index < 0 ? null : {index, offset: [places[index][0] - pointer[0], places[index][1] - pointer[1]]};
}

// Moves a handle to the pointer, except for its offset.
function dragHandle(held, pointer) {
  const handle = cropHandles()[held.index], at = handle && project(handle.point);
  if (!at) return;
  const delta = [pointer[0] + held.offset[0] - at[0], pointer[1] + held.offset[1] - at[1]], step = 1e-3 * targetDistance();
  // Pixels per unit along an axis.
  const along = (axis) => {
    const next = project(add(handle.point, axis, step));
    return next && [(next[0] - at[0]) / step, (next[1] - at[1]) / step];
  };
  if (handle.axis) {
    const axis = along(handle.axis);
    if (!axis) return;
    handle.apply((delta[0] * axis[0] + delta[1] * axis[1]) / Math.max(axis[0] ** 2 + axis[1] ** 2, 1e-9));
  } else {
    const right = along(camera.right), up = along(camera.up), det = right && up ? right[0] * up[1] - right[1] * up[0] : 0;
    if (!det) return;
    handle.apply(add(times(camera.right, (delta[0] * up[1] - delta[1] * up[0]) / det), camera.up,
      (delta[1] * right[0] - delta[0] * right[1]) / det));
  }
  byId('cropCommand').textContent = cropCommand();
  requestPicture(true);
}

drawMore.push((context) => {
  const crop = viewer.hello ? cropValues() : {preview: 'off'};
  if (crop.preview === 'off') return;
  context.strokeStyle = '#7cff6b';
  context.lineWidth = Math.max(1, overlay.height / 600);
  context.beginPath();
  if (crop.box && !crop.box.includes(null)) {
    const corner = (bits) => [0, 1, 2].map((k) => crop.box[bits >> k & 1 ? k + 3 : k]);
    for (let a = 0; a < 8; ++a) for (let k = 0; k < 3; ++k) if (!(a >> k & 1)) drawLine(context, corner(a), corner(a | 1 << k));
  }
  if (crop.sphere) {
    const center = crop.sphere.slice(0, 3), around = (u, v, t) =>
      add(add(center, u, crop.sphere[3] * Math.cos(t)), v, crop.sphere[3] * Math.sin(t));
    for (const [u, v] of [[[1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, 1]], [[0, 0, 1], [1, 0, 0]]])
      for (let i = 0; i < 48; ++i) drawLine(context, around(u, v, i * Math.PI / 24), around(u, v, (i + 1) * Math.PI / 24), 1);
  }
  context.stroke();
  context.fillStyle = '#7cff6b';
  for (const handle of cropHandles()) {
    const at = project(handle.point);
    if (!at) continue;
    context.beginPath();
    context.arc(at[0], at[1], Math.max(4, overlay.height / 120), 0, 7);
    context.fill();
  }
});
