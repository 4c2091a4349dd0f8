// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The run: progress, curves, structural updates, phases, options, and the buttons of a training run.

const curves = [['loss', 'loss'], ['psnr_train', 'training PSNR, dB'], ['gaussians', 'primitives'], ['rss_bytes', 'memory, MB']];

const updateHint = byId('updateText').textContent;
let chosenUpdate = null; // its iteration

// Draws the curves. During a training run they are drawn again and again; the chosen update and the focus remain.
function showHistory(history) {
  const train = history.train, spare = history.spare, box = byId('plots');
  const focused = document.activeElement.closest('#plots .update');
  const x = train.iteration || [];
  const marks = (spare.iteration || []).map((iteration, i) => ({x: iteration, chosen: iteration === chosenUpdate, pressed: () => {
    chosenUpdate = iteration;
    box.querySelectorAll('.update').forEach((line) => line.classList.toggle('chosen', line.dataset.x === String(iteration)));
    byId('updateText').textContent = Object.keys(spare).map((key) => `${key.replaceAll('_', ' ')} ${number(spare[key][i], 5)}`).join(' · ');
  }}));
  box.replaceChildren();
  for (const [key, title] of curves) {
    const y = (train[key] || []).map((value) => key === 'rss_bytes' ? value / 1e6 : value);
    const svg = shape('svg', {viewBox: '0 0 320 140', role: 'group', 'aria-label': title + ' against iteration', 'data-key': key}, box);
    plot(svg, title, [{x, y, name: key}], marks);
  }
  const again = focused && box.querySelector(`[data-key=${focused.ownerSVGElement.dataset.key}] [data-x="${focused.dataset.x}"]`);
  if (again) again.focus({preventScroll: true});
}

onMessage('history', (message) => {
  viewer.history = message;
  showHistory(message);
});

function duration(seconds) {
  if (!Number.isFinite(seconds) || seconds < 0) return '–';
  const h = Math.floor(seconds / 3600), m = Math.floor(seconds / 60) % 60, s = Math.floor(seconds) % 60;
  return h ? `${h} h ${m} min` : m ? `${m} min ${s} s` : `${s} s`;
}

function showPhases(seconds) {
  const box = byId('phases'), total = Object.values(seconds).reduce((sum, value) => sum + (value || 0), 0);
  box.replaceChildren();
  if (!total) return;
  const table = element('table', null, box);
  element('caption', 'Time by phase', table);
  for (const [name, value] of Object.entries(seconds)) {
    const row = element('tr', null, table);
    element('th', name.replaceAll('_', ' '), row).scope = 'row';
    element('td', number(value, 3) + ' s', row);
    element('td', (100 * value / total).toFixed(1) + ' %', row);
  }
}

let lastTable = 0;
onMessage('progress', (message) => {
  viewer.progress = message;
  byId('runProgress').hidden = false;
  byId('runProgress').value = message.iteration / Math.max(1, message.total);
  byId('runText').textContent = (message.finished ? 'Finished. ' : message.paused ? 'Paused. ' : '') +
    `Iteration ${message.iteration} of ${message.total} · ` +
    (message.finished ? '' : `${number(message.rate, 3)} it/s · ${duration(message.eta)} left · `) + `loss ${number(message.loss)} · PSNR ${number(message.psnr)} dB · ` +
    `${message.gaussians.toLocaleString('en')} primitives · ${number(message.rss / 1e6, 4)} MB`;
  byId('pause').textContent = message.paused ? 'Continue' : 'Pause';
  byId('pause').setAttribute('aria-pressed', String(Boolean(message.paused)));
  for (const id of ['pause', 'checkpoint', 'stop']) byId(id).disabled = Boolean(message.finished);
  showPhases(message.phases);
  if (performance.now() - lastTable > 3000) {
    lastTable = performance.now();
    send({type: 'history'});
  }
});

const hasFinished = () => Boolean(viewer.progress && viewer.progress.finished);
byId('pause').onclick = () => {
  if (!hasFinished()) send({type: 'run', action: viewer.progress && viewer.progress.paused ? 'continue' : 'pause'});
};
byId('checkpoint').onclick = () => {
  if (hasFinished()) return;
  send({type: 'run', action: 'checkpoint'});
  showMessage('Checkpoint requested');
};
byId('stop').onclick = () => {
  if (window.confirm('Stop the training after this iteration and save it?') && !hasFinished()) send({type: 'run', action: 'stop'});
};

function flatten(value, prefix, out) {
  if (value !== null && typeof value === 'object' && !Array.isArray(value))
    for (const key of Object.keys(value)) flatten(value[key], prefix ? prefix + '.' + key : key, out);
  else out.push([prefix, Array.isArray(value) ? value.join(', ') : String(value)]);
  return out;
}

function startRun(hello) {
  byId('runBox').hidden = !hello.run;
  byId('runButtons').hidden = byId('runProgress').hidden = !hello.training;
  if (!hello.run) return;
  const body = byId('options').tBodies[0];
  body.replaceChildren();
  for (const [name, value] of flatten(hello.config || {}, '', [])) {
    const row = element('tr', null, body);
    element('td', name, row);
    element('td', value, row);
  }
  const summary = hello.summary;
  if (summary && !hello.training) {
    byId('runText').textContent = `${summary.iterations} iterations in ${duration(summary.train_seconds)}: ${summary.stop_text || summary.stop_reason}. ` +
      (summary.test && summary.test.images ? `Held-out PSNR ${number(summary.test.psnr)} dB. ` : '') + `Model ${summary.model_hash}`;
    showPhases(summary.seconds || {});
  }
  send({type: 'history'});
}
