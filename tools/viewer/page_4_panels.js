// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The controls of AOV, camera, photos, pixel and region.

// Sets the controls of lens and field of view to those of the camera.
function showLens() {
  byId('lens').value = String(camera.lens);
  byId('fov').value = camera.fov;
  byId('fovText').textContent = number(camera.fov, 3) + '°';
}

function setUp() {
  const choice = byId('up').value;
  worldUp = choice === 'cameras' ? viewer.hello.up.slice() : [0, 0, 0];
  if (choice !== 'cameras') worldUp['xyz'.indexOf(choice.slice(-1))] = choice[0] === '-' ? -1 : 1;
  updateRoll(true);
}

function rampOf(name) {
  const row = viewer.hello.aovs.find((aov) => aov.name === name);
  return row && row.ramp;
}

function showRange() {
  byId('rangeText').textContent = rangeProblem();
  for (const id of ['rangeLow', 'rangeHigh']) byId(id).setAttribute('aria-invalid', String(rangeProblem() !== ''));
  requestPicture(false);
}

function showAov() {
  const ramp = rampOf(byId('aov').value);
  for (const id of ['log', 'rangeLow', 'rangeHigh']) byId(id).disabled = !ramp;
  byId('samples').disabled = byId('aov').value !== 'rgba';
  byId('value').textContent = '';
  showRange();
}

// The last part of the model's path.
function modelName() {
  return viewer.hello.model.split('/').filter(Boolean).pop() || viewer.hello.model;
}

// Only exact pictures are saved. A request waits for the picture of the view that was shown when the button was pressed.
let screenshotOf = null;

// The last request without what differs between pictures of one view.
function requestedView() {
  return JSON.stringify({...request.message, serial: 0, moving: false});
}

function isExact() {
  return Boolean(viewer.frame) && viewer.frame.lossless && viewer.frame.serial === viewer.serial;
}

function saveScreenshot() {
  const {limited, width, height} = viewer.frame;
  screenshotOf = null;
  picture.toBlob((blob) => {
    if (!blob) { showMessage('Error: the browser cannot encode the image'); return; }
    viewer.saved = {kind: 'png', size: blob.size};
    download(modelName() + '.png', blob);
    if (limited) showMessage(`Saved at ${width} × ${height}: --max-memory of the training limits the size`);
  });
}

function askScreenshot() {
  if (isExact()) { saveScreenshot(); return; }
  const progress = viewer.progress, runs = viewer.hello && viewer.hello.training && !(progress && (progress.paused || progress.finished));
  screenshotOf = requestedView();
  showMessage(runs ? 'The image is not exact yet. It is saved when the training is paused or has ended.'
    : 'The image is not exact yet. It is saved as soon as it is.');
}

function continueScreenshot() {
  if (screenshotOf === null || viewer.frame.serial !== viewer.serial) return;
  if (screenshotOf !== requestedView()) {
    screenshotOf = null;
    showMessage('The view changed before its image was exact; save it again.');
  } else if (isExact()) {
    byId('message').textContent = '';
    saveScreenshot();
  }
}

onMessage('saved', (message) => {
  viewer.saved = {kind: 'exr', path: message.path};
  showMessage('Saved ' + message.path);
});

for (const id of ['samples', 'size']) byId(id).onchange = () => requestPicture(false);
for (const id of ['log', 'rangeLow', 'rangeHigh']) byId(id).onchange = showRange;
byId('aov').onchange = showAov;
byId('screenshot').onclick = askScreenshot;
byId('exr').onclick = () => { if (send({type: 'exr'})) showMessage('Saving…'); };
byId('fov').oninput = () => {
  camera.fov = Number(byId('fov').value);
  camera.lens = -1;
  showLens();
  moved();
};
byId('lens').onchange = () => {
  camera.lens = Number(byId('lens').value);
  if (camera.lens >= 0) camera.fov = viewer.hello.views[camera.lens].fov;
  showLens();
  moved();
};
byId('up').onchange = () => { setUp(); levelHorizon(); };
byId('home').onclick = goHome;
byId('level').onclick = levelHorizon;
byId('frusta').onchange = drawOverlay;
byId('compare').onchange = () => {
  if (byId('compare').value !== 'render' && camera.view < 0) showMessage('Choose a photo from the list to compare with it.');
  compareAgain();
};
byId('split').oninput = compareAgain;
byId('gain').oninput = compareAgain;
byId('fold').onclick = () => {
  const folded = byId('panel').classList.toggle('folded');
  byId('fold').setAttribute('aria-expanded', String(!folded));
  byId('fold').textContent = folded ? 'Show controls' : 'Hide controls';
  requestPicture(false);
};

function listPhotos(views) {
  const list = byId('photos');
  list.replaceChildren();
  views.forEach((view, index) => {
    const button = element('button', null, element('li', null, list));
    button.type = 'button';
    button.setAttribute('aria-pressed', String(index === camera.view));
    button.title = `${view.name}, ${view.width} × ${view.height}, ${view.lens}${view.test ? ', held out' : ''}`;
    if (view.photo) {
      const image = element('img', null, button);
      image.loading = 'lazy';
      image.alt = '';
      image.src = photoAddress('thumb', index);
    }
    element('span', (view.test ? '◇ ' : '') + view.name, button);
    button.onclick = () => choosePhoto(index);
  });
}

// ---- One pixel ----

function choosePixel(x, y) {
  chosen = [x, y];
  drawOverlay();
  probe(x, y);
  send({type: 'ray', x, y});
}

onMessage('ray', (message) => {
  viewer.ray = message;
  byId('pixelBox').open = true;
  byId('pixelText').textContent = `Pixel (${message.x}, ${message.y}): ${message.count} primitives, remaining transmittance ${number(message.transmittance)}`;
  const body = byId('pixelTable').tBodies[0];
  body.replaceChildren();
  for (const hit of message.hits) {
    const row = element('tr', null, body);
    for (const cell of [hit.id, number(hit.t, 6), number(hit.alpha), number(hit.weight),
      hit.scale.map((scale) => number(scale, 2)).join(' '), hit.region === null ? '–' : hit.region]) element('td', cell, row);
  }
  const steps = {x: [], y: []};
  for (const hit of message.hits) {
    steps.x.push(hit.t, hit.t);
    steps.y.push(hit.transmittance, hit.transmittance * (1 - hit.alpha));
  }
  plot(byId('pixelPlot'), 'transmittance against t', [{x: steps.x, y: steps.y, name: 'T'}]);
  const main = message.hits.reduce((best, hit) => (!best || hit.weight > best.weight ? hit : best), null);
  if (main && main.region !== null) send({type: 'region', number: main.region});
});

// ---- One region ----

onMessage('region', (message) => {
  viewer.region = message;
  const updates = message.updates;
  byId('regionBox').open = true;
  const body = byId('regionTable').tBodies[0];
  body.replaceChildren();
  for (const update of updates) {
    const row = element('tr', null, body);
    for (const key of ['iteration', 'count', 'quota', 'slack', 'weight', 'demand', 'capacity', 'densified', 'removed', 'redundant'])
      element('td', number(update[key]), row);
  }
  const last = updates[updates.length - 1];
  byId('regionText').textContent = last ? `Region ${message.voxel} around (${last.center.map((c) => number(c, 3)).join(', ')}): ` +
    `${last.count} primitives, quota ${number(last.quota)}: ${last.count > last.quota ? 'over' : 'under'} quota` :
    `Region ${message.voxel}: no primitives at any update`;
  const x = updates.map((update) => update.iteration);
  plot(byId('regionPlot'), 'primitives', [{x, y: updates.map((update) => update.count), name: 'count'},
    {x, y: updates.map((update) => update.quota), name: 'quota'}]);
});
