// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
'use strict';

// Runs the scripts of a page in node, without a browser. Elements remember what is assigned to them; drawing does
// nothing. Frames and timers run when a test asks for them.

const fs = require('fs');
const vm = require('vm');

class Element {
  constructor(id, page) {
    Object.assign(this, {id, page, value: '', defaultValue: '', textContent: '', checked: false, hidden: false, disabled: false,
      width: 0, height: 0, style: {}, dataset: {}, children: [], calls: {}, tagName: 'DIV', clientWidth: 640, clientHeight: 360});
    this.classList = {toggle: () => false, add() {}, remove() {}, contains: () => false};
    this.tBodies = id === undefined ? [] : [new Element(undefined, page)];
  }
  addEventListener(type, call) { (this.calls[type] = this.calls[type] || []).push(call); }
  // The listeners of an event, then its `on` handler. Events do not bubble.
  dispatch(type, event = {}) {
    const given = {type, target: this, preventDefault() { given.prevented = true; }, ...event};
    for (const call of [...this.calls[type] || [], this['on' + type]]) if (call) call(given);
    return given;
  }
  append(...list) { this.children.push(...list); }
  appendChild(child) { this.children.push(child); return child; }
  add(child) { this.children.push(child); }
  insertRow() { return this.appendChild(new Element(undefined, this.page)); }
  createTHead() { return this.insertRow(); }
  createTBody() { return this.insertRow(); }
  get selectedOptions() { return [{textContent: this.value}]; }
  get allText() { return this.textContent + this.children.map((child) => child.allText || '').join('|'); }
  replaceChildren(...list) { this.children = list; }
  getBoundingClientRect() { return {left: 0, top: 0, width: 640, height: 360}; }
  getContext(kind) { return kind === '2d' ? this.page.context : null; }
  toBlob(call) { call({size: 1, shown: this.page.drawn}); }
  querySelectorAll() { return []; }
  querySelector() { return null; }
  closest() { return null; }
  setAttribute(name, value) { this[name] = value; }
  removeAttribute(name) { delete this[name]; }
  setPointerCapture() {}
  focus() { this.page.sandbox.document.activeElement = this; }
  click() { this.page.clicked.push(this); this.dispatch('click'); }
}

// A page with the global names of a browser. `address`: its location; `fetch`: answers requests.
class Page {
  constructor(address = 'http://127.0.0.1:8080/') {
    const url = new URL(address);
    Object.assign(this, {elements: {}, frames: [], timers: [], sockets: [], sent: [], clicked: [], requests: [], time: 1000, made: 0});
    this.context = new Proxy({}, {get: (held, name) => held[name] || (() => {}), set: () => true});
    const page = this;
    const document = new Element('document', this);
    Object.assign(document, {
      getElementById: (id) => page.element(id),
      createElement: (name) => Object.assign(new Element(undefined, page), {tagName: name.toUpperCase()}),
      createElementNS: (_, name) => Object.assign(new Element(undefined, page), {tagName: name}),
      body: page.element('body'), documentElement: page.element('html'),
    });
    document.activeElement = document.body;
    const window = new Element('window', this);
    class WebSocket {
      constructor(to) { this.url = to; this.readyState = 1; page.sockets.push(this); }
      send(text) { page.sent.push(JSON.parse(text)); }
    }
    WebSocket.OPEN = 1;
    this.sandbox = {
      document, window, WebSocket, console, URL: {createObjectURL: () => 'blob:', revokeObjectURL() {}},
      location: {protocol: url.protocol, host: url.host, pathname: url.pathname, search: url.search, hash: url.hash},
      history: {replaceState(_state, _title, to) { page.replaced = to; }},
      navigator: {}, performance: {now: () => page.time}, ResizeObserver: class { observe() {} },
      requestAnimationFrame: (call) => page.frames.push(call), devicePixelRatio: 1,
      setTimeout: (call, delay = 0) => { page.timers.push({id: ++page.made, call, at: page.time + delay}); return page.made; },
      clearTimeout: (id) => { page.timers = page.timers.filter((timer) => timer.id !== id); },
      fetch: async (to) => { page.requests.push(to); return {status: 200}; },
      addEventListener: (type, call) => window.addEventListener(type, call),
      Blob: class {}, Worker: class { postMessage() {} }, ImageBitmap: class {}, createImageBitmap: async () => ({width: 1, height: 1, close() {}}),
      atob: () => '', TextDecoder,
      Option: class { constructor(name, value) { Object.assign(this, {textContent: name, value}); } },
      Image: class extends Element { constructor() { super(undefined, page); } },
    };
    vm.createContext(this.sandbox);
  }
  element(id) {
    this.elements[id] = this.elements[id] || new Element(id, this);
    return this.elements[id];
  }
  load(text, name) { vm.runInContext(text, this.sandbox, {filename: name}); }
  // The value of an expression in the scope of the scripts.
  run(text) { return vm.runInContext(text, this.sandbox); }
  // Runs the animation frames that are due, `count` times, then the timers of the next `ms`.
  pass(ms = 0, count = 1) {
    for (let k = 0; k < count; ++k) {
      const due = this.frames;
      this.frames = [];
      for (const call of due) call(this.time);
    }
    this.time += ms;
    const due = this.timers.filter((timer) => timer.at <= this.time);
    this.timers = this.timers.filter((timer) => timer.at > this.time);
    for (const timer of due) timer.call();
  }
}

const text = (path) => fs.readFileSync(`${process.env.SPAREGS_SOURCE}/${path}`, 'utf8');

// The viewer's page, connected, with the given facts of the model.
function viewerPage(hello = {}, address = undefined) {
  const page = new Page(address);
  for (const [id, value] of Object.entries({aov: 'rgba', samples: '1', size: 'window', up: 'cameras', mode: 'orbit', compare: 'render',
    speed: '0', gain: '4', split: '50', cropPreview: 'off', cropOpacity: '0'})) page.element(id).value = value;
  const folder = process.env.SPAREGS_SOURCE + '/tools/viewer';
  const parts = fs.readdirSync(folder).filter((name) => /^page_.*\.js$/.test(name)).sort();
  page.load(parts.map((name) => text('tools/viewer/' + name)).join('\n'), 'viewer');
  page.sandbox.given = {type: 'hello', model: 'a/model.ply', marks: '', training: false, run: false, target: [0, 0, 0], extent: 2,
    up: [0, -1, 0], aovs: [{name: 'rgba', ramp: false}, {name: 'depth', ramp: true}], ramp: [], views: [], config: null, summary: null, ...hello};
  page.run('listeners.hello.forEach((call) => call(given))');
  page.pass();
  return page;
}

// The standalone page without its function, so that its names can be seen. The model is never drawn.
function standalonePage(given) {
  const page = new Page('file:///page.html');
  page.element('model').textContent = JSON.stringify({name: 'model', meta: {count: given.count || 0, means: {}}, cameras: [], up: [0, 0, 0], files: {},
    linear: false, ...given});
  const whole = text('src/web_page/web_page.js');
  const begin = whole.indexOf('(() => {\n') + 9, end = whole.lastIndexOf('})();');
  page.load(`'use strict';\n${whole.slice(begin, end)}`, 'web_page');
  return page;
}

// The page of `report` with its data.
function reportPage(data) {
  const page = new Page('file:///report.html'), whole = text('tools/report/report_page.html');
  page.element('data').textContent = JSON.stringify(data);
  page.element('metric').value = 'psnr';
  page.sandbox.console = {error() {}};
  const begin = whole.lastIndexOf('<script>') + 8, end = whole.lastIndexOf('</script>');
  page.load(whole.slice(begin, end), 'report_page');
  return page;
}

module.exports = {viewerPage, standalonePage, reportPage};
