// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
'use strict';

// Shared helpers, and the WebSocket to the program. Nothing is loaded from elsewhere.

const byId = (id) => document.getElementById(id);

// The state that several files use; tests read it as window.viewer.
const viewer = window.viewer = {
  hello: null,       // facts of the model
  models: 0,         // number of models described so far
  frame: null,       // header of the picture on the canvas
  serial: 0,         // of the last request
  sent: new Map(),   // serial -> time of sending
  shown: [],         // [time, latency in ms] of the last pictures
  probe: null, ray: null, region: null, history: null, progress: null, saved: null, errors: [],
};

const listeners = {};
function onMessage(type, call) {
  (listeners[type] = listeners[type] || []).push(call);
}

function element(name, text, parent) {
  const made = document.createElement(name);
  if (text !== undefined && text !== null) made.textContent = text;
  if (parent) parent.append(made);
  return made;
}

// A number with `digits` digits; all digits of integers, such as rows, iterations and counts.
function number(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  if (Number.isSafeInteger(value)) return String(value);
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e7 || size < 1e-3)) return value.toExponential(2);
  return String(Number(value.toPrecision(digits)));
}

function notice(text) {
  byId('notice').textContent = text || '';
  byId('notice').hidden = !text;
}

// What was saved, or what is wrong; stays until a picture of a later request.
let messageSerial = 0;
function showMessage(text) {
  byId('message').textContent = text;
  messageSerial = viewer.serial;
}

// The token of the address was exchanged for a cookie.
if (location.search) history.replaceState(null, '', location.pathname);

// The path of the page, which ends in '/': a reverse proxy may serve it below others.
const folder = location.pathname.replace(/[^/]*$/, '');

let socket = null, retries = 0;
const FULL_PAUSE = 10000; // ms, before the next attempt if all places are taken

// Pause in ms before the next attempt to connect.
function retryDelay(count) {
  return Math.min(10000, 1000 * 2 ** count);
}

// False without a connection.
function send(message) {
  if (!socket || socket.readyState !== WebSocket.OPEN) return false;
  socket.send(JSON.stringify(message));
  return true;
}

function connect() {
  socket = new WebSocket((location.protocol === 'https:' ? 'wss://' : 'ws://') + location.host + folder + 'stream');
  socket.binaryType = 'arraybuffer';
  let full = false, open = false;
  socket.onmessage = (event) => {
    if (typeof event.data !== 'string') {
      receivePicture(event.data);
      return;
    }
    const message = JSON.parse(event.data);
    full = message.type === 'full';
    if (!full) retries = 0;
    notice(full ? 'Eight pages are already open. Close one to continue here.' : '');
    (listeners[message.type] || []).forEach((call) => call(message));
  };
  socket.onopen = () => { open = true; };
  socket.onclose = () => {
    if (full) setTimeout(connect, FULL_PAUSE);
    else connectLater();
    if (!open) checkToken();
  };
}

// A program that started again may have another token.
async function checkToken() {
  const answer = await fetch(folder, {cache: 'no-store'}).catch(() => null);
  if (answer && answer.status === 401) notice('The token has changed. Open the URL printed by sparegs.');
}

// Tries again until the program answers.
function connectLater() {
  const delay = retryDelay(retries++);
  const ended = viewer.progress && viewer.progress.finished ? 'The training has ended. ' : '';
  notice(`${ended}No connection to sparegs. Reconnecting in ${delay / 1000} s (attempt ${retries}).`);
  setTimeout(connect, delay);
}

onMessage('error', (message) => {
  viewer.errors.push(message.text);
  showMessage('Error: ' + message.text);
});

// Pictures: 4 bytes length of the JSON header (little-endian), the header, the image file.
let drawing = Promise.resolve();
function receivePicture(data) {
  const length = new DataView(data).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const file = new Blob([new Uint8Array(data, 4 + length)], {type: 'image/' + head.encoding});
  drawing = drawing.then(() => createImageBitmap(file, {colorSpaceConversion: 'none', premultiplyAlpha: 'none'}))
    .then((bitmap) => showPicture(head, bitmap)).catch((error) => viewer.errors.push(String(error)))
    .then(() => send({type: 'ack', number: head.frame}));
}

// A file for the user's download folder.
function download(name, blob) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// A plot of curves over iterations or distances. curves: [{x, y, name}]; marks: [{x, pressed, chosen}].
const svgName = 'http://www.w3.org/2000/svg';
function shape(name, attributes, parent, text) {
  const made = document.createElementNS(svgName, name);
  for (const key of Object.keys(attributes)) made.setAttribute(key, attributes[key]);
  if (text !== undefined) made.textContent = text;
  parent.append(made);
  return made;
}

function plot(svg, title, curves, marks = []) {
  svg.replaceChildren();
  const left = 48, right = 312, top = 18, bottom = 118;
  const points = curves.map((curve) => curve.x.map((x, i) => [x, curve.y[i]]).filter(
    (point) => Number.isFinite(point[0]) && Number.isFinite(point[1])));
  const all = points.flat();
  const heading = shape('text', {x: 4, y: 11}, svg, title + (curves.length > 1 ? ':' : ''));
  if (curves.length > 1) curves.forEach((curve, k) => shape('tspan', {class: k ? 'otherName' : 'lineName'}, heading, ' ' + curve.name));
  if (!all.length) return;
  let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const mark of marks) { x0 = Math.min(x0, mark.x); x1 = Math.max(x1, mark.x); }
  for (const [x, y] of all) {
    x0 = Math.min(x0, x); x1 = Math.max(x1, x); y0 = Math.min(y0, y); y1 = Math.max(y1, y);
  }
  // A range of one value is labelled once, in the middle.
  const one = {x: x1 === x0, y: y1 === y0};
  if (one.x) { x0 -= 1; x1 += 1; }
  if (one.y) { y0 -= 0.5; y1 += 0.5; }
  const px = (x) => (left + (x - x0) / (x1 - x0) * (right - left)).toFixed(1);
  const py = (y) => (bottom - (y - y0) / (y1 - y0) * (bottom - top)).toFixed(1);
  for (const mark of marks)
    if (mark.x >= x0 && mark.x <= x1) {
      const line = shape('line', {x1: px(mark.x), x2: px(mark.x), y1: top, y2: bottom, class: mark.chosen ? 'update chosen' : 'update', tabindex: 0,
        role: 'button', 'data-x': mark.x, 'aria-label': 'structural update of iteration ' + mark.x}, svg);
      line.onclick = mark.pressed;
      line.onkeydown = (event) => { if (event.key === 'Enter' || event.key === ' ') { event.preventDefault(); mark.pressed(event); } };
    }
  shape('path', {d: `M${left} ${top}V${bottom}H${right}`, class: 'axis'}, svg);
  points.forEach((list, k) => {
    if (list.length)
      shape('polyline', {points: list.map(([x, y]) => px(x) + ',' + py(y)).join(' '), class: k ? 'other' : 'line'}, svg);
  });
  const middle = (a, b) => (a + b) / 2;
  for (const [at, y] of one.y ? [[middle(top, bottom), middle(y0, y1)]] : [[top + 4, y1], [bottom, y0]])
    shape('text', {x: 4, y: at}, svg, number(y, 3));
  for (const [at, x, anchor] of one.x ? [[middle(left, right), middle(x0, x1), 'middle']] : [[left, x0, 'start'], [right, x1, 'end']])
    shape('text', {x: at, y: bottom + 14, 'text-anchor': anchor}, svg, number(x, 5));
}
