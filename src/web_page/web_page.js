// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Draws a SOG model that is part of this file with WebGL 2. The vertex shader decodes the textures; a worker sorts the
// primitives by their distance from the camera. Axes: x right, y down, z front.
'use strict';
(() => {
const $ = (name) => document.getElementById(name);
const given = JSON.parse($('model').textContent);
const canvas = $('picture'), status = $('status');
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((x) => x / (Math.hypot(...a) || 1));

// ---- Shaders ----

const vertexShader = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
layout(location = 0) in uint index;
uniform sampler2D means_l, means_u, scales, quats, sh0, shN_centroids, shN_labels;
uniform sampler2D codes;       // 256 x 3: logarithms of scales, colours, SH
uniform vec3 low, high, eye;
uniform mat3 axes;             // world to camera
uniform vec2 focal, center, size; // pixels
uniform float near;
uniform int bands;
uniform bool antialiased;
out vec2 offset;
out vec4 color;

float code(float byte, int row) { return texelFetch(codes, ivec2(int(byte * 255.0 + 0.5), row), 0).r; }
vec3 code3(vec3 bytes, int row) { return vec3(code(bytes.x, row), code(bytes.y, row), code(bytes.z, row)); }

mat3 rotation(vec4 packed) {
  vec3 rest = (packed.xyz - 0.5) * 1.41421356237;
  float largest = sqrt(max(0.0, 1.0 - dot(rest, rest)));
  int which = int(packed.w * 255.0 + 0.5) - 252;
  vec4 q = which == 0 ? vec4(largest, rest) : which == 1 ? vec4(rest.x, largest, rest.yz)
         : which == 2 ? vec4(rest.xy, largest, rest.z) : vec4(rest, largest); // w, x, y, z
  q = normalize(q);
  return mat3(1.0 - 2.0 * (q.z * q.z + q.w * q.w), 2.0 * (q.y * q.z + q.x * q.w), 2.0 * (q.y * q.w - q.x * q.z),
              2.0 * (q.y * q.z - q.x * q.w), 1.0 - 2.0 * (q.y * q.y + q.w * q.w), 2.0 * (q.z * q.w + q.x * q.y),
              2.0 * (q.y * q.w + q.x * q.z), 2.0 * (q.z * q.w - q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z));
}

// Spherical harmonics of degrees 1 to 3.
vec3 harmonics(ivec2 pixel, vec3 d) {
  vec4 label = texelFetch(shN_labels, pixel, 0);
  int entry = int(label.r * 255.0 + 0.5) + 256 * int(label.g * 255.0 + 0.5), count = (bands + 1) * (bands + 1) - 1;
  ivec2 at = ivec2(entry % 64 * count, entry / 64);
  float b[15];
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  b[0] = -0.4886025119 * y; b[1] = 0.4886025119 * z; b[2] = -0.4886025119 * x;
  b[3] = 1.0925484306 * x * y; b[4] = -1.0925484306 * y * z; b[5] = 0.3153915653 * (2.0 * zz - xx - yy);
  b[6] = -1.0925484306 * x * z; b[7] = 0.5462742153 * (xx - yy);
  b[8] = -0.5900435899 * y * (3.0 * xx - yy); b[9] = 2.8906114426 * x * y * z;
  b[10] = -0.4570457995 * y * (4.0 * zz - xx - yy); b[11] = 0.3731763326 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
  b[12] = -0.4570457995 * x * (4.0 * zz - xx - yy); b[13] = 1.4453057213 * z * (xx - yy);
  b[14] = -0.5900435899 * x * (xx - 3.0 * yy);
  vec3 sum = vec3(0.0);
  for (int k = 0; k < 15; ++k)
    if (k < count) sum += b[k] * code3(texelFetch(shN_centroids, at + ivec2(k, 0), 0).rgb, 2);
  return sum;
}

void main() {
  int width = textureSize(means_l, 0).x;
  ivec2 pixel = ivec2(int(index) % width, int(index) / width);
  vec3 t = mix(low, high, (texelFetch(means_l, pixel, 0).rgb * 255.0 + texelFetch(means_u, pixel, 0).rgb * 65280.0) / 65535.0);
  vec3 mean = sign(t) * (exp(abs(t)) - 1.0);
  vec3 at = axes * (mean - eye);
  vec4 sh = texelFetch(sh0, pixel, 0);
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0); // outside
  offset = vec2(0.0);
  color = vec4(0.0);
  if (at.z <= near || sh.a * 255.0 <= 1.0) return;

  vec3 s = exp(code3(texelFetch(scales, pixel, 0).rgb, 0));
  mat3 m = axes * rotation(texelFetch(quats, pixel, 0)) * mat3(s.x, 0, 0, 0, s.y, 0, 0, 0, s.z);
  vec2 limit = 1.3 * 0.5 * size / focal, ratio = clamp(at.xy / at.z, -limit, limit);
  vec3 jx = vec3(focal.x, 0.0, -focal.x * ratio.x) / at.z, jy = vec3(0.0, focal.y, -focal.y * ratio.y) / at.z;
  vec3 u = jx * m, v = jy * m; // rows of the Jacobian times the factor of the covariance
  float a = dot(u, u), b = dot(u, v), c = dot(v, v), opacity = sh.a;
  float filtered = antialiased ? 0.1 : 0.3;
  if (antialiased)
    opacity *= sqrt(max(0.0, a * c - b * b) / ((a + filtered) * (c + filtered) - b * b));
  a += filtered;
  c += filtered;
  if (opacity * 255.0 <= 1.0) return;

  // The quad covers the ellipse where alpha reaches 1/255.
  float middle = 0.5 * (a + c), radius = length(vec2(0.5 * (a - c), b));
  float first = middle + radius, second = max(middle - radius, 0.01), reach = sqrt(2.0 * log(opacity * 255.0));
  vec2 axis = radius < 1e-6 ? vec2(1.0, 0.0) : abs(b) > 1e-6 * radius ? normalize(vec2(b, first - a))
            : a > c ? vec2(1.0, 0.0) : vec2(0.0, 1.0);
  offset = reach * vec2(float(gl_VertexID & 1) * 2.0 - 1.0, float(gl_VertexID >> 1) * 2.0 - 1.0);
  vec2 place = focal * at.xy / at.z + center + offset.x * sqrt(first) * axis + offset.y * sqrt(second) * vec2(-axis.y, axis.x);
  gl_Position = vec4(place.x / size.x * 2.0 - 1.0, 1.0 - place.y / size.y * 2.0, 0.0, 1.0);
  vec3 rgb = 0.5 + 0.28209479177 * code3(sh.rgb, 1);
  if (bands > 0) rgb += harmonics(pixel, normalize(mean - eye));
  color = vec4(max(rgb, 0.0), opacity);
}`;
const fragmentShader = `#version 300 es
precision highp float;
in vec2 offset;
in vec4 color;
out vec4 result;
void main() {
  float alpha = min(0.99, color.a * exp(-0.5 * dot(offset, offset)));
  if (alpha < 1.0 / 255.0) discard;
  result = vec4(color.rgb * alpha, alpha);
}`;

// Scene-linear colours are blended in a texture and encoded as sRGB afterwards.
const screenShader = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;
const encodingShader = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D linear;
out vec4 result;
void main() {
  vec3 value = clamp(texelFetch(linear, ivec2(gl_FragCoord.xy), 0).rgb, 0.0, 1.0);
  result = vec4(mix(1.055 * pow(value, vec3(1.0 / 2.4)) - 0.055, 12.92 * value, lessThanEqual(value, vec3(0.0031308))), 1.0);
}`;

function compile(gl, vertexShader, fragmentShader) {
  const program = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, vertexShader], [gl.FRAGMENT_SHADER, fragmentShader]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

// ---- Textures ----

const meta = given.meta, count = meta.count;

async function bitmap(name) {
  const bytes = Uint8Array.from(atob(given.files[name]), (c) => c.charCodeAt(0));
  delete given.files[name];
  return createImageBitmap(new Blob([bytes], {type: 'image/webp'}), {premultiplyAlpha: 'none', colorSpaceConversion: 'none'});
}

function makeTexture(gl, image) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  if (image instanceof ImageBitmap) gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
  else gl.texImage2D(gl.TEXTURE_2D, 0, gl.R32F, 256, 3, 0, gl.RED, gl.FLOAT, image);
  return texture;
}

function pixels(gl, texture, image) {
  const target = gl.createFramebuffer(), bytes = new Uint8Array(4 * image.width * image.height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
  gl.readPixels(0, 0, image.width, image.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  gl.deleteFramebuffer(target);
  return bytes;
}

function decodeMeans(lower, upper) {
  const means = new Float32Array(3 * count), {mins, maxs} = meta.means;
  for (let i = 0; i < count; ++i)
    for (let k = 0; k < 3; ++k) {
      const t = mins[k] + (maxs[k] - mins[k]) * (lower[4 * i + k] + 256 * upper[4 * i + k]) / 65535;
      means[3 * i + k] = Math.sign(t) * Math.expm1(Math.abs(t));
    }
  return means;
}

// ---- Linear colours ----

// Half floats keep values above 1. Without them, WebGL 2 still blends sRGB textures in linear light.
function makeEncoder(gl, unit) {
  const half = gl.getExtension('EXT_color_buffer_float') || gl.getExtension('EXT_color_buffer_half_float');
  const program = compile(gl, screenShader, encodingShader), target = gl.createFramebuffer(), place = gl.TEXTURE0 + unit;
  let texture = null, width = 0, height = 0;
  gl.useProgram(program);
  gl.uniform1i(gl.getUniformLocation(program, 'linear'), unit);
  return {
    begin() {
      gl.bindFramebuffer(gl.FRAMEBUFFER, target);
      if (width === canvas.width && height === canvas.height) return;
      gl.deleteTexture(texture);
      [texture, width, height] = [gl.createTexture(), canvas.width, canvas.height];
      gl.activeTexture(place);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, half ? gl.RGBA16F : gl.SRGB8_ALPHA8, width, height);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    },
    end() {
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.useProgram(program);
      gl.disable(gl.BLEND);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      gl.enable(gl.BLEND);
    },
  };
}

// ---- Order ----

// Runs in a worker: rows by decreasing distance from the eye, a counting sort with 65536 buckets.
function sorter() {
  let means, count;
  onmessage = ({data}) => {
    if (data.means) {
      means = data.means;
      count = means.length / 3;
      return;
    }
    const [x, y, z] = data.eye, keys = new Float32Array(count), order = new Uint32Array(count);
    let low = Infinity, high = 0;
    for (let i = 0; i < count; ++i) {
      const key = keys[i] = Math.hypot(means[3 * i] - x, means[3 * i + 1] - y, means[3 * i + 2] - z);
      if (key < low) low = key;
      if (key > high) high = key;
    }
    // Logarithmic steps: near primitives need finer ones.
    const start = Math.log(Math.max(low, 1e-3 * high, 1e-30)), step = 65535 / (Math.log(Math.max(high, 1e-30)) - start || 1);
    const begin = new Uint32Array(65537);
    for (let i = 0; i < count; ++i) {
      const bucket = 65535 - Math.max(0, Math.min(65535, Math.round((Math.log(keys[i]) - start) * step)));
      keys[i] = bucket;
      ++begin[bucket + 1];
    }
    for (let k = 0; k < 65536; ++k) begin[k + 1] += begin[k];
    for (let i = 0; i < count; ++i) order[begin[keys[i]]++] = i;
    postMessage(order, [order.buffer]);
  };
}

// ---- Camera ----

const camera = {eye: [0, 0, 0], axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], lens: null, number: 0, moved: false};
const views = given.cameras;
const hasUp = Math.hypot(...given.up) > 0;
let target = [0, 0, 0], up = hasUp ? unit(given.up) : [0, -1, 0], near = 0.2, extent = 1;

function quantile(values, share) {
  return values.slice().sort()[Math.floor(share * (values.length - 1))];
}

// Centre and size of the model, the up axis, and a camera for models without one.
function frame(means) {
  const step = Math.max(1, Math.floor(count / 20000)), part = [[], [], []];
  for (let i = 0; i < count; i += step) for (let k = 0; k < 3; ++k) part[k].push(means[3 * i + k]);
  const sorted = part.map((p) => Float32Array.from(p));
  target = sorted.map((p) => quantile(p, 0.5));
  extent = Math.max(...sorted.map((p) => quantile(p, 0.9) - quantile(p, 0.1))) || 1; // 1: as model_measure
  if (views.length) {
    if (!hasUp) up = unit(views.reduce((sum, v) => add(sum, v.axes[1], -1), [0, 0, 0]));
    const middle = views.reduce((sum, v) => add(sum, v.eye, 1 / views.length), [0, 0, 0]);
    const reach = 1.1 * Math.max(...views.map((v) => Math.hypot(...add(v.eye, middle, -1))));
    near = 0.2 * Math.min(1, reach || 1);
  } else {
    near = 0.01 * Math.min(1, extent);
    views.push({name: '', eye: add(target, [0, 0, -1.5 * extent]), axes: camera.axes, width: 1, height: 1,
                fx: 0.9, fy: 0.9, cx: 0.5, cy: 0.5});
  }
}

function goTo(number) {
  camera.number = (number + views.length) % views.length;
  camera.moved = false;
  const view = camera.lens = views[camera.number];
  camera.eye = view.eye.slice();
  camera.axes = view.axes.map((a) => a.slice());
  updateRoll(true);
  // Orbit about the point of the view axis that is nearest to the model's centre.
  const depth = dot(add(centre, camera.eye, -1), camera.axes[2]);
  target = add(camera.eye, camera.axes[2], depth > near ? depth : 0.5 * extent);
  changed();
}

function rotate(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(v.map((x) => x * c), cross(axis, v), s), axis, dot(axis, v) * (1 - c));
}

function turn(axis, angle) {
  camera.axes = camera.axes.map((a) => rotate(a, axis, angle));
  camera.eye = add(target, rotate(add(camera.eye, target, -1), axis, angle));
  const [, , front] = camera.axes, right = unit(add(camera.axes[0], front, -dot(camera.axes[0], front)));
  camera.axes = [right, cross(front, right), front];
}

// How the camera is rolled, as in the viewer: upside down beyond 135 degrees, sideways (a photo in portrait) from 45 to
// 135. Both keep their value within 8 degrees of these limits, and near the poles.
let upsideDown = false, sideways = false;

function updateRoll(isNew) {
  const level = -dot(up, camera.axes[1]), slack = isNew ? 0 : 0.1, limit = Math.SQRT1_2;
  const flat = Math.hypot(level, dot(up, camera.axes[0])), roll = flat > 0.05 ? level / flat : 1; // cosine
  if (isNew || flat > 0.5) {
    upsideDown = roll < -limit + (upsideDown ? slack : -slack);
    sideways = flat > 0.5 && Math.abs(roll) < limit + (sideways ? slack : -slack);
  }
}

function orbit(dx, dy) {
  updateRoll(false);
  const side = upsideDown ? -1 : 1; // upside down: drag as seen
  turn(up, -dx * side);
  const level = cross(camera.axes[2], up), axis = sideways && Math.hypot(...level) > 1e-3 ? unit(level.map((x) => x * side)) : camera.axes[0];
  const lift = dot(rotate(camera.axes[2], axis, -dy), up);
  if (Math.abs(lift) < 0.998 || Math.abs(lift) < Math.abs(dot(camera.axes[2], up))) turn(axis, -dy);
  moved();
}

function move(x, y, z) {
  for (const [k, amount] of [x, y, z].entries()) {
    camera.eye = add(camera.eye, camera.axes[k], amount);
    target = add(target, camera.axes[k], amount);
  }
  moved();
}

function zoom(factor) {
  camera.eye = add(target, add(camera.eye, target, -1), factor);
  moved();
}

// The user moved the camera.
function moved() {
  camera.moved = true;
  changed();
}

const distance = () => Math.hypot(...add(camera.eye, target, -1));

// ---- Picture ----

let gl, program, encoder = null, textures, worker, sorting = false, sortedFor = null, ordered = false, pending = false, lost = false;
let centre = [0, 0, 0];
const places = {}; // uniforms that change with the camera

function changed() {
  if (!pending && program) {
    pending = true;
    requestAnimationFrame(draw);
  }
}

function sort() {
  if (sorting || (sortedFor && camera.eye.every((x, k) => x === sortedFor[k]))) return;
  sorting = true;
  sortedFor = camera.eye.slice();
  worker.postMessage({eye: sortedFor});
}

function projection() {
  const {width, height, fx, fy, cx, cy} = camera.lens, scale = Math.min(canvas.width / width, canvas.height / height);
  return {focal: [fx * scale, fy * scale],
          center: [canvas.width / 2 + (cx - width / 2) * scale, canvas.height / 2 + (cy - height / 2) * scale]};
}

function draw() {
  pending = false;
  if (lost) return;
  const ratio = Math.min(devicePixelRatio || 1, 2);
  canvas.width = Math.round(canvas.clientWidth * ratio);
  canvas.height = Math.round(canvas.clientHeight * ratio);
  sort();
  if (!canvas.width || !canvas.height) return;
  gl.viewport(0, 0, canvas.width, canvas.height);
  if (encoder) encoder.begin();
  gl.clearColor(0, 0, 0, 1);
  gl.clear(gl.COLOR_BUFFER_BIT);
  if (!ordered) return;
  const {focal, center} = projection(), [r, d, f] = camera.axes;
  gl.useProgram(program);
  gl.uniform3fv(places.eye, camera.eye);
  gl.uniformMatrix3fv(places.axes, false, [r[0], d[0], f[0], r[1], d[1], f[1], r[2], d[2], f[2]]);
  gl.uniform2fv(places.focal, focal);
  gl.uniform2fv(places.center, center);
  gl.uniform2f(places.size, canvas.width, canvas.height);
  gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
  if (encoder) encoder.end();
  if (!sorting) status.textContent = `${given.name}: ${count.toLocaleString('en')} primitives` +
    (camera.lens.name && !camera.moved ? `, ${camera.lens.name}` : '');
}

async function start() {
  gl = canvas.getContext('webgl2', {alpha: false, antialias: false, premultipliedAlpha: true, powerPreference: 'high-performance'});
  if (!gl) throw new Error('this browser has no WebGL 2');
  const names = Object.keys(given.files), images = await Promise.all(names.map(bitmap));
  const side = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  if (images.some((image) => image.width > side || image.height > side))
    throw new Error(`the model needs textures larger than the ${side} pixels of this device`);
  for (const flag of [gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, gl.UNPACK_FLIP_Y_WEBGL]) gl.pixelStorei(flag, false);
  gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
  textures = images.map((image) => makeTexture(gl, image));
  const bytes = (name) => pixels(gl, textures[names.indexOf(name)], images[names.indexOf(name)]);
  const means = decodeMeans(bytes('means_l.webp'), bytes('means_u.webp'));
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  images.forEach((image) => image.close());
  frame(means);
  centre = target;
  document.title = given.name;

  if (given.linear) encoder = makeEncoder(gl, images.length + 1);
  program = compile(gl, vertexShader, fragmentShader);
  const place = (name) => gl.getUniformLocation(program, name);
  gl.useProgram(program);
  const bands = meta.shN ? meta.shN.bands : 0, codes = new Float32Array(768);
  codes.set(meta.scales.codebook, 0);
  codes.set(meta.sh0.codebook, 256);
  if (bands) codes.set(meta.shN.codebook, 512);
  [...names.map((name) => name.replace('.webp', '')), 'codes'].forEach((name, k) => gl.uniform1i(place(name), k));
  [...textures, makeTexture(gl, codes)].forEach((texture, k) => {
    gl.activeTexture(gl.TEXTURE0 + k);
    gl.bindTexture(gl.TEXTURE_2D, texture);
  });
  if (!bands) for (const name of ['shN_centroids', 'shN_labels']) gl.uniform1i(place(name), 0);
  gl.uniform3fv(place('low'), meta.means.mins);
  gl.uniform3fv(place('high'), meta.means.maxs);
  gl.uniform1f(place('near'), near);
  gl.uniform1i(place('bands'), bands);
  gl.uniform1i(place('antialiased'), meta.model === 'antialiased' ? 1 : 0);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
  gl.vertexAttribDivisor(0, 1);

  worker = new Worker(URL.createObjectURL(new Blob([`(${sorter})()`], {type: 'text/javascript'})));
  worker.onmessage = ({data}) => {
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    sorting = false;
    ordered = true;
    changed();
  };
  worker.postMessage({means}, [means.buffer]);
  for (const name of ['eye', 'axes', 'focal', 'center', 'size']) places[name] = place(name);
  goTo(askedCamera());
}

// The number of the camera in the address.
function askedCamera() {
  const asked = /camera=(\d+)/.exec(location.hash);
  return asked ? Number(asked[1]) : 0;
}

// ---- Input ----

const fingers = new Map();

canvas.addEventListener('pointerdown', (event) => {
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, event);
  canvas.focus({preventScroll: true});
});
for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
canvas.addEventListener('contextmenu', (event) => event.preventDefault());
canvas.addEventListener('pointermove', (event) => {
  const last = fingers.get(event.pointerId);
  if (!last || !camera.lens) return;
  const dx = event.clientX - last.clientX, dy = event.clientY - last.clientY, scale = distance() / canvas.clientHeight;
  if (fingers.size === 2) {
    const other = [...fingers.values()].find((finger) => finger.pointerId !== event.pointerId);
    const apart = (finger) => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY) || 1;
    zoom(apart(last) / apart(event));
    move(-0.5 * dx * scale, -0.5 * dy * scale, 0);
  } else if (event.shiftKey || last.button === 2 || event.buttons & 2) {
    move(-dx * scale, -dy * scale, 0);
  } else {
    orbit(dx * 0.005, dy * 0.005);
  }
  fingers.set(event.pointerId, event);
});
canvas.addEventListener('wheel', (event) => {
  event.preventDefault();
  if (camera.lens) zoom(Math.exp(Math.max(-0.5, Math.min(0.5, event.deltaY * 0.001))));
}, {passive: false});

const keys = {
  ArrowLeft: () => orbit(-0.05, 0), ArrowRight: () => orbit(0.05, 0), ArrowUp: () => orbit(0, -0.05), ArrowDown: () => orbit(0, 0.05),
  '+': () => zoom(0.9), '=': () => zoom(0.9), '-': () => zoom(1 / 0.9),
  w: () => move(0, 0, 0.02 * extent), s: () => move(0, 0, -0.02 * extent), a: () => move(-0.02 * extent, 0, 0),
  d: () => move(0.02 * extent, 0, 0), q: () => move(0, 0.02 * extent, 0), e: () => move(0, -0.02 * extent, 0),
  n: () => goTo(camera.number + 1), p: () => goTo(camera.number - 1), Home: () => goTo(0), Escape: () => showHelp(false),
};
document.addEventListener('keydown', (event) => {
  const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!act || !camera.lens || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  act();
});
$('next').addEventListener('click', keys.n);
$('previous').addEventListener('click', keys.p);
$('home').addEventListener('click', keys.Home);
function showHelp(shown) {
  $('help').hidden = !shown;
  $('info').setAttribute('aria-expanded', String(shown));
}
$('info').addEventListener('click', () => showHelp($('help').hidden));
addEventListener('resize', changed);
addEventListener('hashchange', () => { if (camera.lens) goTo(askedCamera()); });
canvas.addEventListener('webglcontextlost', () => {
  lost = true;
  status.textContent = 'The graphics device was lost. Reload the page.';
});
$('next').hidden = $('previous').hidden = views.length < 2;
window.page = {camera, draw, projection, near: () => near, settled: () => ordered && !sorting && !pending};
start().catch((error) => {
  status.setAttribute('role', 'alert');
  status.textContent = 'The model cannot be shown: ' + error.message;
});
})();
