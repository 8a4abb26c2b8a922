"use strict";
// The mechanics of one impact: as in contactlearn/mechanics/rigid_body.py and metrics.py.
const measured = i => [trials.vx_post[i], trials.vy_post[i], trials.omega_post[i]];
const before = i => [trials.vx[i], trials.vy[i], trials.omega[i]];
const predicted = (model, i) => [0, 1, 2].map(k => arrays.v_post(model, i, k));
const mass = i => [trials.mass[i], trials.mass[i], trials.inertia[i]];

// √(eᵀ M e) / √(vᵀ M v)
function massErrors(model) {
  errors[model] ??= trials.name.map((_, i) => {
    const v = measured(i), u = predicted(model, i), M = mass(i);
    const norm = x => Math.sqrt(x.reduce((sum, value, k) => sum + M[k] * value * value, 0));
    return norm(v.map((value, k) => u[k] - value)) / norm(v);
  });
  return errors[model];
}

// The wrench (P_t, P_n, τ) in N s and N m s that changes the velocity by dv.
function wrench(i, dv) {
  const [m, , I] = mass(i), P = [m * dv[0], m * dv[1]];
  return [...P, I * dv[2] - (trials.rx[i] * P[1] - trials.ry[i] * P[0])];
}

// Parts of the squared error that are in v_x, v_y and ω.
function errorParts(model, i) {
  const v = measured(i), parts = predicted(model, i).map((value, k) => mass(i)[k] * (value - v[k]) ** 2);
  const whole = parts.reduce((sum, part) => sum + part, 0);
  return parts.map(part => whole ? part / whole : 0);
}

const minus = (a, b) => a.map((value, k) => value - b[k]);

// W (1/kg), v_c (m/s) and the momentum −M_c v_c (N s), which is the centre of the energy ellipse.
function contact(i) {
  const [m, , I] = mass(i), x = trials.rx[i], y = trials.ry[i], [vx, vy, omega] = before(i);
  const W = [1 / m + y * y / I, -x * y / I, 1 / m + x * x / I], v = [vx - y * omega, vy + x * omega];
  const det = W[0] * W[2] - W[1] * W[1];
  const centre = [-(W[2] * v[0] - W[1] * v[1]) / det, -(W[0] * v[1] - W[1] * v[0]) / det];
  return {W, v, centre};
}

// Impulses (P + M_c v_c)ᵀ W (P + M_c v_c) = v_cᵀ M_c v_c.
function energyEllipse({W, v, centre}) {
  const radius = Math.sqrt(Math.max(0, -(centre[0] * v[0] + centre[1] * v[1])));
  const a = Math.sqrt(W[0]), b = W[1] / a, c = Math.sqrt(W[2] - b * b);  // W = L Lᵀ
  return Array.from({length: 181}, (_, k) => {
    const angle = k * Math.PI / 90, y = radius * Math.sin(angle) / c;
    return [centre[0] + (radius * Math.cos(angle) - b * y) / a, centre[1] + y];
  });
}

// The part of a convex polygon where the height is not negative.
function above(polygon, height) {
  return polygon.flatMap((p, k) => {
    const q = polygon[(k + 1) % polygon.length], h = height(p), g = height(q);
    const cut = h * g < 0 ? [p.map((value, j) => value + h / (h - g) * (q[j] - value))] : [];
    return h >= 0 ? [p, ...cut] : cut;
  });
}

// Trials in groups of about equal number along x, and null where a tenth of its range is empty; a few far off are in none.
function grouped(x, groups = 20) {
  const order = [...x.keys()].sort((i, j) => x[i] - x[j]), size = x.length / Math.min(groups, x.length);
  const gap = 0.1 * (x[order.at(-1)] - x[order[0]]), runs = [];
  order.forEach((i, k) => k && x[i] - x[order[k - 1]] <= gap ? runs.at(-1).push(i) : runs.push([i]));
  return runs.filter(run => run.length > size / 3).flatMap((run, k) => {
    const count = Math.max(1, Math.round(run.length / size)), cut = j => Math.round(j * run.length / count);
    const parts = Array.from({length: count}, (_, j) => run.slice(cut(j), cut(j + 1)));
    return k ? [null, ...parts] : parts;
  });
}

const means = (groups, y) => groups.map(part => part && average(part.map(i => y[i])));

const average = values => values.reduce((sum, value) => sum + value, 0) / values.length;
const share = (values, part) => [...values].sort((a, b) => a - b)[Math.round(part * (values.length - 1))];

// Number formats: as in contactlearn/report/text/numbers.py.
const written = x => {
  if (Math.abs(x) >= 1e-3 || x === 0) return x.toFixed(4).replace("-", "−");
  const [figure, power] = x.toExponential(1).split("e");
  return Math.abs(x) >= 1e-4 ? digits(x, 2) : `${digits(Number(figure), 2)}e−${-power}`;
};
const compared = (x, y) => {
  const [word, ratio] = x <= y ? ["less", y / x] : ["more", x / y];
  if (!(Math.min(x, y) > 0)) return x === y ? "no less" : word;
  const times = ratio < 10 ? ratio.toFixed(1) : ratio.toFixed(0);
  const percent = 100 * Math.abs(x - y) / y;
  return ratio >= 2 ? `${times} times ${word}` : `${percent.toFixed(percent < 1 ? 1 : 0)}\u00a0% ${word}`;
};
const interval = one => `${written(one.mean)} (${written(one.low)}${one.low < 0 ? " to " : "–"}${written(one.high)})`;

const digits = (x, count = 3) => Number(x.toPrecision(count)).toString().replace("-", "−");
