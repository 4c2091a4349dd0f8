// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Fills the page once the program has described the model, then connects.

function fillSelect(select, entries) {
  const before = select.value;
  select.replaceChildren();
  for (const [value, text] of entries) element('option', text, select).value = value;
  if (entries.some(([value]) => value === before)) select.value = before;
}

onMessage('hello', (hello) => {
  const again = Boolean(viewer.hello);
  viewer.hello = hello;
  const name = hello.model.split('/').filter(Boolean).pop() || hello.model;
  document.title = byId('title').textContent = name + ' · sparegs';
  fillSelect(byId('aov'), hello.aovs.map((aov) => [aov.name, aov.name.replaceAll('_', ' ')]));
  fillSelect(byId('lens'), [['-1', 'pinhole'], ...hello.views.map((view, index) => [String(index), `${view.name} (${view.lens})`])]);
  drawRamp(hello.ramp);
  setUp();
  listPhotographs(hello.views);
  byId('photosBox').hidden = !hello.views.length;
  byId('regionBox').hidden = !hello.aovs.some((aov) => aov.name === 'region');
  for (const id of ['log', 'rangeLow', 'rangeHigh']) byId(id).disabled = !rampOf(byId('aov').value);
  startCrop(hello);
  if (again) requestPicture(false);
  else goHome();
  showFov();
  startRun(hello);
  if (hello.progress) (listeners.progress || []).forEach((call) => call(hello.progress));
});

connect();
