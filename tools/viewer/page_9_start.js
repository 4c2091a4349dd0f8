// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Fills the page once the program has described the model, then connects.

function fillSelect(select, entries) {
  const before = select.value;
  select.replaceChildren();
  for (const [value, text] of entries) element('option', text, select).value = value;
  if (entries.some(([value]) => value === before)) select.value = before;
}

// Whether the program describes the same model and views as before.
function isSame(before, hello) {
  return before.model === hello.model && JSON.stringify(before.views) === JSON.stringify(hello.views);
}

// Resets what belongs to the model and the views before.
function reset() {
  Object.assign(camera, {view: -1, lens: -1, fov: 50});
  showLens();
  photoLeft();
  photo.removeAttribute('src');
  resetCrop();
  for (const name of ['frame', 'probe', 'ray', 'region', 'history', 'progress']) viewer[name] = null;
  for (const id of ['value', 'message', 'pixelText', 'regionText']) byId(id).textContent = '';
  chosenUpdate = screenshotOf = null;
  byId('updateText').textContent = updateHint;
  for (const id of ['pixelPlot', 'regionPlot', 'plots']) byId(id).replaceChildren();
  for (const id of ['pixelTable', 'regionTable']) byId(id).tBodies[0].replaceChildren();
}

onMessage('hello', (hello) => {
  const before = viewer.hello, stays = before && isSame(before, hello);
  viewer.hello = hello;
  if (!stays) ++viewer.models;
  if (before && !stays) reset();
  document.title = byId('title').textContent = modelName() + ' · sparegs';
  byId('title').title = hello.model;
  fillSelect(byId('aov'), hello.aovs.map((aov) => [aov.name, aov.name.replaceAll('_', ' ')]));
  fillSelect(byId('lens'), [['-1', 'pinhole'], ...hello.views.map((view, index) => [String(index), `${view.name} (${view.lens})`])]);
  drawRamp(hello.ramp);
  setUp();
  listPhotos(hello.views);
  byId('photosBox').hidden = !hello.views.length;
  for (const id of ['compare', 'gain']) byId(id).disabled = !hello.views.some((view) => view.photo);
  byId('regionBox').hidden = !hello.aovs.some((aov) => aov.name === 'region');
  for (const id of ['log', 'rangeLow', 'rangeHigh']) byId(id).disabled = !rampOf(byId('aov').value);
  startCrop(hello);
  if (stays) requestPicture(false);
  else goHome();
  showLens();
  startRun(hello);
  if (hello.progress) (listeners.progress || []).forEach((call) => call(hello.progress));
});

connect();
