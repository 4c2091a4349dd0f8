// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The lenses of COLMAP's camera models, with the formulas and the domain of src/rays/camera.c. A point becomes a plane
// vector x = (u, v): (X, Y) / Z, or theta (X, Y) / R for fisheye models. The lens distorts it. Points beyond the radius
// `limit`, where the distortion folds, have no pixel.

const coefficients = {
  SIMPLE_RADIAL: ['k1'], SIMPLE_RADIAL_FISHEYE: ['k1'], RADIAL: ['k1', 'k2'], RADIAL_FISHEYE: ['k1', 'k2'],
  OPENCV: ['k1', 'k2', 'p1', 'p2'], OPENCV_FISHEYE: ['k1', 'k2', 'k3', 'k4'], FOV: ['omega'],
  FULL_OPENCV: ['k1', 'k2', 'p1', 'p2', 'k3', 'd1', 'd2', 'd3'],
  THIN_PRISM_FISHEYE: ['k1', 'k2', 'p1', 'p2', 'k3', 'k4', 'sx', 'sy'],
};

const pinhole = {fisheye: false, numerator: [1], denominator: [1], p1: 0, p2: 0, sx: 0, sy: 0, omega: 0, limit: Infinity};
const lenses = new WeakMap(); // view -> lens

// The lens of a view of `hello`; null: a pinhole.
function lensOf(view) {
  if (!view) return pinhole;
  if (!lenses.has(view)) lenses.set(view, makeLens(view.lens, view.fisheye, view.params));
  return lenses.get(view);
}

function makeLens(model, fisheye, params) {
  const names = coefficients[model] || [], value = {};
  names.forEach((name, i) => { value[name] = params[params.length - names.length + i]; });
  const all = (...list) => list.map((name) => value[name] || 0);
  const [p1, p2, sx, sy, omega] = all('p1', 'p2', 'sx', 'sy', 'omega');
  const lens = {fisheye, numerator: [1, ...all('k1', 'k2', 'k3', 'k4')], denominator: [1, ...all('d1', 'd2', 'd3')],
    p1, p2, sx, sy, omega: Math.abs(omega)};
  lens.limit = domainLimit(lens);
  return lens;
}

// ---- Domain ----

function polynomial(c, x) {
  return c.reduceRight((sum, value) => sum * x + value, 0);
}

// Sorted sign changes of a polynomial in (0, end). Between the roots of its derivative it is monotonic.
function polynomialRoots(c, end) {
  let degree = c.length - 1;
  while (degree > 0 && c[degree] === 0) --degree;
  if (degree <= 0) return [];
  const used = c.slice(0, degree + 1), roots = [];
  let low = 0;
  for (const cut of [...polynomialRoots(used.slice(1).map((value, i) => (i + 1) * value), end), end]) {
    let a = low, b = cut;
    const sign = polynomial(used, a) > 0;
    low = b;
    if (polynomial(used, b) > 0 === sign) continue;
    for (let step = 0; step < 100; ++step) {
      const middle = 0.5 * (a + b);
      if (polynomial(used, middle) > 0 === sign) a = middle;
      else b = middle;
    }
    roots.push(a);
  }
  return roots;
}

// The first root of D, of (h - q r) D^2 and of (g - q r) D, for g = N / D, h = d(r g)/dr.
function domainLimit(lens) {
  const {numerator: n, denominator: d} = lens, end = lens.fisheye ? Math.PI : 1e6;
  const q = 6 * Math.hypot(lens.p1, lens.p2) + 2 * Math.hypot(lens.sx, lens.sy);
  const pole = Array(7).fill(0), fold = Array(16).fill(0), side = Array(10).fill(0);
  n.forEach((value, i) => {
    side[2 * i] += value;
    d.forEach((other, j) => { fold[2 * (i + j)] += (1 + 2 * i - 2 * j) * value * other; });
  });
  d.forEach((value, i) => {
    pole[2 * i] = value;
    side[2 * i + 1] -= q * value;
    d.forEach((other, j) => { fold[2 * (i + j) + 1] -= q * value * other; });
  });
  const limit = Math.min(...[pole, fold, side].map((c) => polynomialRoots(c, end)[0] ?? end));
  return limit >= end && !lens.fisheye ? Infinity : limit;
}

// ---- Projection ----

function distort(lens, [u, v]) {
  const {p1, p2, sx, sy, omega} = lens, s = u * u + v * v;
  const across = 2 * Math.tan(omega / 2) * Math.sqrt(s);
  const g = across > 0 ? Math.atan(across) / (omega * Math.sqrt(s)) : polynomial(lens.numerator, s) / polynomial(lens.denominator, s);
  return [u * g + 2 * p1 * u * v + p2 * (s + 2 * u * u) + sx * s, v * g + 2 * p2 * u * v + p1 * (s + 2 * v * v) + sy * s];
}

// A point in camera axes (right, down, forward) on the distorted image plane; null outside of the domain.
function throughLens(lens, [x, y, z]) {
  const across = Math.hypot(x, y);
  const nearest = 1e-3 * (viewer.hello ? viewer.hello.extent : 1);
  if (lens.fisheye ? !(across > 0 || z > 0) : !(z > nearest)) return null;
  const scale = !lens.fisheye ? 1 / z : across > 0 ? Math.atan2(across, z) / across : 1;
  return across * scale <= lens.limit ? distort(lens, [x * scale, y * scale]) : null;
}

// The plane vector that distort maps to `target`, by damped Newton steps; null if there is none.
function undistort(lens, target) {
  const away = (x) => { const y = distort(lens, x); return [target[0] - y[0], target[1] - y[1]]; };
  const start = Math.min(1, 0.9 * lens.limit / Math.max(Math.hypot(...target), 1e-9));
  let x = [target[0] * start, target[1] * start], e = away(x);
  for (let step = 0; step < 60 && Math.hypot(...e) > 1e-12; ++step) {
    const h = 1e-6 * (1 + Math.hypot(...x));
    const [a, b] = [[h, 0], [0, h]].map(([du, dv]) => {
      const more = distort(lens, [x[0] + du, x[1] + dv]), less = distort(lens, [x[0] - du, x[1] - dv]);
      return [(more[0] - less[0]) / (2 * h), (more[1] - less[1]) / (2 * h)];
    });
    const det = a[0] * b[1] - a[1] * b[0];
    const dx = [(b[1] * e[0] - b[0] * e[1]) / det, (a[0] * e[1] - a[1] * e[0]) / det];
    let next = null;
    for (let share = 1; share > 1e-9 && !next; share /= 2) {
      const tried = [x[0] + share * dx[0], x[1] + share * dx[1]];
      if (Math.hypot(...tried) <= lens.limit && Math.hypot(...away(tried)) < Math.hypot(...e)) next = tried;
    }
    if (!next) break;
    x = next;
    e = away(x);
  }
  return Math.hypot(...e) < 1e-9 * (1 + Math.hypot(...target)) ? x : null;
}

// Direction in camera axes (right, down, forward) of the ray through a point of the distorted image plane. Points that no
// ray reaches have the direction of a pinhole.
function rayOfLens(lens, target) {
  const x = undistort(lens, target) || target, r = Math.hypot(...x);
  if (!lens.fisheye) return [x[0], x[1], 1];
  const scale = r > 0 ? Math.sin(r) / r : 1;
  return [x[0] * scale, x[1] * scale, Math.cos(r)];
}
