// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The picture, what is drawn over it, and the pointer and keys that move the camera.

const picture = byId('picture'), overlay = byId('overlay'), photo = byId('photo');

// Places the picture in the middle of the stage, as large as possible.
function layout() {
  const stage = byId('stage').getBoundingClientRect(), fit = byId('fit');
  const scale = Math.min(stage.width / request.width, stage.height / request.height);
  const width = request.width * scale, height = request.height * scale;
  fit.style.width = width + 'px';
  fit.style.height = height + 'px';
  fit.style.left = (stage.width - width) / 2 + 'px';
  fit.style.top = (stage.height - height) / 2 + 'px';
  byId('split').style.bottom = Math.max(8, 60 - (stage.height - height) / 2) + 'px'; // above the lines of text
  if (overlay.width !== request.width || overlay.height !== request.height) {
    overlay.width = request.width;
    overlay.height = request.height;
  }
  drawOverlay();
}

function showPicture(head, bitmap) {
  // The last picture of a view with less memory than the size requires keeps its own size, so that it can be saved.
  const width = head.limited ? head.width : head.full_width, height = head.limited ? head.height : head.full_height;
  if (picture.width !== width || picture.height !== height) {
    picture.width = width;
    picture.height = height;
  }
  const context = picture.getContext('2d', {alpha: false});
  context.imageSmoothingEnabled = head.width !== width;
  context.drawImage(bitmap, 0, 0, width, height);
  bitmap.close();
  const now = performance.now(), sent = viewer.sent.get(head.serial);
  viewer.shown.push([now, sent === undefined ? NaN : now - sent]);
  if (viewer.shown.length > 1000) viewer.shown.shift();
  viewer.frame = head;
  if (head.serial > messageSerial) byId('message').textContent = '';
  const rate = viewer.shown.filter((entry) => entry[0] > now - 1000).length;
  byId('status').textContent = `${head.width} × ${head.height}${head.lossless ? ', exact' : ''} · ${(1000 * head.seconds).toFixed(0)} ms · ` +
    `${rate} fps · ${head.gaussians.toLocaleString('en')} primitives` + (head.iteration ? ` · iteration ${head.iteration}` : '');
  showBar(head);
  if (head.removed !== undefined)
    byId('cropText').textContent = `${head.removed.toLocaleString('en')} of ${head.gaussians.toLocaleString('en')} primitives are removed${cropProblem()}`;
  else if (request.message && request.message.crop && head.serial === viewer.serial)
    byId('cropText').textContent = 'This AOV shows the whole model' + cropProblem();
  compareAgain();
  continueScreenshot();
}

function showBar(head) {
  byId('bar').hidden = !head.range;
  if (!head.range) return;
  byId('low').textContent = number(head.range[0]);
  byId('high').textContent = number(head.range[1]);
  byId('barAov').textContent = head.aov + (byId('log').checked ? ' (log)' : '');
}

function drawRamp(colors) {
  const canvas = byId('ramp');
  canvas.width = colors.length;
  const context = canvas.getContext('2d');
  colors.forEach((color, i) => {
    context.fillStyle = `rgb(${color.join(' ')})`;
    context.fillRect(i, 0, 1, 1);
  });
}

// ---- Overlay: the frusta of the cameras, the chosen pixel, the difference ----

let chosen = null; // the clicked pixel
// Pixel coordinates of a point in world space, through the lens of the picture; null if it has none.
function project(point) {
  const [fx, fy, cx, cy] = intrinsics(request.width, request.height);
  const offset = add(point, camera.position, -1);
  const at = throughLens(lensOf(lensView()), [dot(offset, camera.right), -dot(offset, camera.up), -dot(offset, camera.back)]);
  return at && [cx + fx * at[0], cy + fy * at[1]];
}

// A line in world space, in pieces: lenses bend it.
function drawLine(context, a, b, pieces = 16) {
  const longest = lensOf(lensView()).fisheye ? overlay.width : Infinity; // around the back of a fisheye
  let from = project(a);
  for (let k = 1; k <= pieces; ++k) {
    const to = project(add(times(a, 1 - k / pieces), b, k / pieces));
    if (from && to && Math.hypot(to[0] - from[0], to[1] - from[1]) < longest) {
      context.moveTo(...from);
      context.lineTo(...to);
    }
    from = to;
  }
}

// The corners lie on the plane at distance `size`, beyond 60 degrees from the axis nearer.
function drawFrustum(context, view, size) {
  const m = view.camera_to_world, [fx, fy, cx, cy] = view.intrinsics;
  const at = (x, y, z) => [0, 1, 2].map((k) => m[4 * k + 3] + x * m[4 * k] + y * m[4 * k + 1] + z * m[4 * k + 2]);
  const corners = [[0, 0], [view.width, 0], [view.width, view.height], [0, view.height]].map(([x, y]) => {
    const ray = unit(rayOfLens(lensOf(view), [(x - cx) / fx, (y - cy) / fy])), scale = size / Math.max(ray[2], 0.5);
    return at(ray[0] * scale, -ray[1] * scale, -ray[2] * scale);
  });
  context.beginPath();
  corners.forEach((corner, k) => {
    drawLine(context, corner, corners[(k + 1) % 4], 8);
    drawLine(context, at(0, 0, 0), corner, 8);
  });
  context.stroke();
}

// In world units: 4 % of the mean distance of the cameras from their centre, so that frusta of neighbours stay apart.
function frustumSize() {
  const hello = viewer.hello, most = 0.04 * hello.extent;
  const places = hello.views.map((view) => [3, 7, 11].map((k) => view.camera_to_world[k]));
  const centre = places.reduce((sum, place) => add(sum, place, 1 / places.length), [0, 0, 0]);
  const spread = places.reduce((sum, place) => sum + norm(add(place, centre, -1)) / places.length, 0);
  return spread > 0 ? Math.min(most, 0.04 * spread) : most;
}

function drawOverlay() {
  const context = overlay.getContext('2d');
  context.clearRect(0, 0, overlay.width, overlay.height);
  drawDifference(context);
  if (byId('frusta').checked && viewer.hello) {
    context.lineWidth = Math.max(1, overlay.height / 600);
    const size = frustumSize();
    viewer.hello.views.forEach((view, index) => {
      if (index === camera.view) return;
      context.strokeStyle = view.test ? '#ffb000' : '#4fc3f7';
      drawFrustum(context, view, size);
    });
  }
  drawMore.forEach((call) => call(context));
  if (chosen) {
    context.strokeStyle = '#ff4081';
    context.lineWidth = Math.max(1, overlay.height / 500);
    context.strokeRect(chosen[0] - 5, chosen[1] - 5, 11, 11);
  }
}
const drawMore = []; // further drawings over the picture

// ---- Photos ----

// The number of the model keeps the browser from showing those of the model before.
function photoAddress(kind, index) {
  return `${folder}${kind}/${index}?model=${viewer.models}`;
}

let photoReady = false, photoSource = ''; // the address that was requested
function photoLeft() {
  byId('split').hidden = photo.hidden = true;
  photoReady = false;
  photoSource = '';
  clearTimeout(clickTimer); // of the camera before
  chosen = null;
  byId('value').textContent = ''; // of the camera before
  document.querySelectorAll('#photos button[aria-pressed=true]').forEach((button) => button.setAttribute('aria-pressed', 'false'));
}

// Why the browser has no photo: the program answers with a line of text.
async function explainPhoto(address, name) {
  const answer = await fetch(address, {cache: 'no-store'}).catch(() => null);
  const reason = answer && answer.status === 507 ? (await answer.text()).trim() : `the photo ${name} cannot be loaded`;
  if (photoSource === address) showMessage('Error: ' + reason);
}

// Loads the photo of the camera if it is compared.
function loadPhoto() {
  const view = camera.view >= 0 ? viewer.hello.views[camera.view] : null;
  if (byId('compare').value === 'render' || !view || !view.photo) return;
  const address = photoAddress('photo', camera.view);
  if (photoSource === address) return;
  photoSource = address;
  photo.onload = () => { if (photoSource === address) { photoReady = true; compareAgain(); } };
  photo.onerror = () => explainPhoto(address, view.name);
  photo.alt = 'Photo ' + view.name;
  photo.src = address;
}

function compareAgain() {
  loadPhoto();
  const mode = byId('compare').value, shows = camera.view >= 0 && viewer.hello.views[camera.view].photo;
  photo.hidden = !(shows && photoReady && (mode === 'slider' || mode === 'photo'));
  byId('split').hidden = !(shows && photoReady && mode === 'slider');
  photo.style.clipPath = mode === 'slider' ? `inset(0 ${100 - byId('split').value}% 0 0)` : 'none';
  drawOverlay();
}

function drawDifference(context) {
  if (byId('compare').value !== 'difference' || camera.view < 0 || !photoReady ||
      !viewer.frame || viewer.frame.full_width !== overlay.width || viewer.frame.full_height !== overlay.height) return;
  const width = overlay.width, height = overlay.height, gain = Number(byId('gain').value);
  const scratch = document.createElement('canvas');
  scratch.width = width;
  scratch.height = height;
  const other = scratch.getContext('2d');
  other.drawImage(picture, 0, 0, width, height);
  const b = other.getImageData(0, 0, width, height).data;
  other.drawImage(photo, 0, 0, width, height);
  const a = other.getImageData(0, 0, width, height);
  for (let i = 0; i < b.length; ++i) if (i % 4 !== 3) a.data[i] = gain * Math.abs(a.data[i] - b[i]);
  context.putImageData(a, 0, 0);
}

function choosePhoto(index) {
  photoLeft();
  goToView(index);
  const button = document.querySelectorAll('#photos button')[index];
  if (button) button.setAttribute('aria-pressed', 'true');
  showLens();
  loadPhoto();
}

// ---- Values under the cursor ----

let probing = false, probeNext = null, probedCamera = '';
function probe(x, y) {
  if (probing) { probeNext = [x, y]; return; }
  probing = true;
  probedCamera = matrix().join();
  send({type: 'probe', x, y});
  setTimeout(() => { probing = false; }, 2000);
}

onMessage('probe', (message) => {
  viewer.probe = message;
  probing = false;
  const aov = byId('aov').value;
  const value = aov === 'rgba' ? message.rgba : message[aov];
  const text = Array.isArray(value) ? value.map((v) => number(v)).join(', ') : number(value, 6);
  byId('value').textContent = `(${message.x}, ${message.y}) ${aov}: ${text}` + (aov === 'depth' ? '' : ` · depth ${number(message.depth)}`);
  if (probeNext) {
    const next = probeNext;
    probeNext = null;
    probe(...next);
  }
});

// Pixel coordinates of the pointer.
function pointerAt(event) {
  const box = picture.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width * request.width, (event.clientY - box.top) / box.height * request.height];
}

function pixelAt(event) {
  const [x, y] = pointerAt(event).map(Math.floor);
  return x >= 0 && y >= 0 && x < request.width && y < request.height ? [x, y] : null;
}

// The point on the surface at a pixel: the traced one if it was probed near this pixel since the camera moved, else
// one on the pixel's ray at the last depth or the orbit's distance.
function pointAt(pixel) {
  const last = viewer.probe, near = last && Math.hypot(last.x - pixel[0], last.y - pixel[1]) < 0.03 * request.height;
  if (near && last.depth > 0 && probedCamera === matrix().join()) return last.position;
  const depth = near && last.depth > 0 ? last.depth : targetDistance();
  return add(camera.position, rayThrough(...pixel), depth);
}

// ---- Pointer ----

const pointers = new Map();
let dragged = 0, grabbed = null; // grabbed: a handle of the crop

picture.addEventListener('pointerdown', (event) => {
  picture.focus({preventScroll: true});
  try { picture.setPointerCapture(event.pointerId); } catch (error) { /* a synthetic event */ }
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
  dragged = pointers.size > 1 ? 99 : 0;
  grabbed = pointers.size === 1 ? handleAt(pointerAt(event)) : null;
});

function drag(event, from) {
  const box = picture.getBoundingClientRect();
  const dx = (event.clientX - from[0]) / box.height, dy = (event.clientY - from[1]) / box.height;
  const mode = event.buttons & 6 || event.shiftKey ? 'pan' : byId('mode').value;
  if (mode === 'pan') pan(dx, dy);
  else if (mode === 'fly') look(dx * 1.5, dy * 1.5);
  else orbit(dx * 4, dy * 4);
}

function pinchTo(from, event) {
  const other = [...pointers.entries()].find(([id]) => id !== event.pointerId)[1];
  const before = Math.hypot(from[0] - other[0], from[1] - other[1]);
  const after = Math.hypot(event.clientX - other[0], event.clientY - other[1]);
  const box = picture.getBoundingClientRect();
  pan((event.clientX - from[0]) / 2 / box.height, (event.clientY - from[1]) / 2 / box.height);
  if (before > 5 && after > 5) zoomTo(camera.target, before / after);
}

picture.addEventListener('pointermove', (event) => {
  const from = pointers.get(event.pointerId);
  if (!from) {
    const pixel = pixelAt(event);
    if (pixel && !movingNow) probe(...pixel);
    return;
  }
  dragged += Math.hypot(event.clientX - from[0], event.clientY - from[1]);
  if (dragged > 4 || pointers.size > 1) {
    if (grabbed) dragHandle(grabbed, pointerAt(event));
    else if (pointers.size > 1) pinchTo(from, event);
    else drag(event, from);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }
});

// A click waits until it cannot become a double click, which does not choose a pixel.
const DOUBLE_CLICK = 300; // ms
let clickTimer = 0;

function release(event) {
  if (pointers.delete(event.pointerId) && event.type === 'pointerup' && dragged <= 4 && event.button === 0) {
    const pixel = pixelAt(event);
    clearTimeout(clickTimer);
    if (pixel) clickTimer = setTimeout(() => choosePixel(...pixel), DOUBLE_CLICK);
  }
}
picture.addEventListener('pointerup', release);
picture.addEventListener('pointercancel', release);
picture.addEventListener('contextmenu', (event) => event.preventDefault());

picture.addEventListener('wheel', (event) => {
  event.preventDefault();
  const pixel = event.deltaY ? pixelAt(event) : null; // sideways: no zoom
  if (pixel) zoomTo(pointAt(pixel), Math.exp(Math.max(-1, Math.min(1, event.deltaY / 400))));
}, {passive: false});

picture.addEventListener('dblclick', (event) => {
  const pixel = pixelAt(event);
  clearTimeout(clickTimer);
  if (!pixel) return;
  camera.target = pointAt(pixel);
  requestPicture(false);
});

// ---- Keys ----

// Keys to fly, by their place on the keyboard: W A S D Q E of a US layout.
const flyKeys = ['KeyW', 'KeyA', 'KeyS', 'KeyD', 'KeyQ', 'KeyE'];
const held = new Set();
let flying = 0;
function flyStep(time) {
  const seconds = Math.min(0.1, (time - flying) / 1000);
  flying = held.size ? time : 0;
  if (!held.size) return;
  const step = seconds * targetDistance() * 0.7 * 10 ** Number(byId('speed').value);
  const axis = (plus, minus) => (held.has(plus) - held.has(minus)) * step;
  fly(axis('KeyD', 'KeyA'), axis('KeyE', 'KeyQ'), axis('KeyW', 'KeyS'));
  requestAnimationFrame(flyStep);
}

const takesKeys = (at) => Boolean(at) && ['INPUT', 'SELECT', 'TEXTAREA'].includes(at.tagName);

const inPanel = (at) => Boolean(at) && Boolean(at.closest('#panel'));

// Keys act wherever the focus is, except in form fields; Enter also presses buttons. Arrows and Home scroll the panel.
document.addEventListener('keydown', (event) => {
  const key = event.key.toLowerCase(), at = document.activeElement;
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || !viewer.hello || takesKeys(at)) return;
  if (flyKeys.includes(event.code)) {
    held.add(event.code);
    if (!flying) requestAnimationFrame((time) => { flying = time; flyStep(time); });
  } else if ((key.startsWith('arrow') || key === 'home') && inPanel(at)) {
    return;
  } else if (key.startsWith('arrow')) {
    const dx = (key === 'arrowright') - (key === 'arrowleft'), dy = (key === 'arrowdown') - (key === 'arrowup');
    if (event.shiftKey) pan(0.03 * dx, 0.03 * dy);
    else if (byId('mode').value === 'fly') look(-0.06 * dx, -0.06 * dy);
    else orbit(0.08 * dx, 0.08 * dy);
  } else if (key === '+' || key === '=' || key === '-') {
    zoomTo(camera.target, key === '-' ? 1.12 : 1 / 1.12);
  } else if (key === 'home') {
    goHome();
  } else if (key === 'enter' && (at === picture || at === document.body)) {
    choosePixel(request.width >> 1, request.height >> 1);
  } else {
    return;
  }
  event.preventDefault();
});
document.addEventListener('keyup', (event) => held.delete(event.code));
document.addEventListener('focusin', () => { if (takesKeys(document.activeElement)) held.clear(); });
window.addEventListener('blur', () => held.clear());
new ResizeObserver(() => { if (viewer.hello) requestPicture(false); }).observe(byId('stage'));
