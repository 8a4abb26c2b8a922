// The figures; text that comes from data is escaped, because plotly takes some HTML.
const plain = text => String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
const typeset = text => plain(text).replace(/(?<![A-Za-z_])(\p{L})_([a-z])(?![A-Za-z_])/gu, "$1<sub>$2</sub>");  // v_n, no column's name
const color = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const get = id => document.getElementById(id);
const narrow = () => document.documentElement.clientWidth < 640;

function draw(id, traces, {summary, ...layout}) {
  const div = get(id);
  const axis = {gridcolor: color("line"), zerolinecolor: color("line"), linecolor: color("muted"), automargin: true};
  const themed = Object.fromEntries(Object.entries({xaxis: {}, yaxis: {}, ...layout})
    .map(([key, value]) => [key, /^[xy]axis\d*$/.test(key) ? {...axis, ...value} : value]));
  const whole = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", margin: {l: 50, r: 15, t: 15, b: 45},
    font: {color: color("text"), size: narrow() ? 12 : 14, family: getComputedStyle(document.body).fontFamily},
    legend: {orientation: "h", yref: "container", yanchor: "bottom", y: 0, x: 0, font: {size: 12}, itemsizing: "constant"},
    hovermode: "closest", hoverlabel: {align: "left", namelength: -1}, dragmode: narrow() ? false : "zoom",
    modebar: {bgcolor: "rgba(0,0,0,0)", color: color("muted"), activecolor: color("accent")},
    ...themed, width: div.clientWidth, height: div.clientHeight,
  };
  div.setAttribute("aria-label", `${div.dataset.what}. ${summary ?? described(traces, layout)}`);
  return Plotly.react(div, traces, whole, {
    displaylogo: false, displayModeBar: "hover", showSendToCloud: false, modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
    toImageButtonOptions: {format: "svg", filename: id},
  });
}

// Describe a figure for screen readers: its notes, and the only point of each trace or its first and last.
function described(traces, {annotations = []}) {
  const bare = text => new DOMParser().parseFromString(text, "text/html").body.textContent;
  const ends = ({x, y}) => (x.length > 1 ? [0, -1] : [0]).map(k => `(${[x, y].map(part => digits(part.at(k) ?? NaN)).join(", ")})`).join(" to ");
  return [...annotations.map(one => bare(one.text)), ...traces.filter(one => one.name && one.x?.length).map(one => `${bare(one.name)} ${ends(one)}`)].join("; ");
}

// A figure that Python has built, in the colours of the page; `exchanged` has parts of its traces by their `meta`.
function show(id, {data, layout}, exchanged = {}, changed = {}) {
  const inks = ({color: ink, ...rest}) => ({...rest, ...(typeof ink === "string" ? {color: visible(ink)} : ink && {color: ink})});
  const traces = data.map(trace => {
    const {line, marker, ...rest} = exchanged[trace.meta] ?? {}, look = {...trace, ...rest};
    const own = marker ?? {}, ground = trace.marker?.line && {line: inks(trace.marker.line)};
    return {
      ...look, line: inks({...trace.line, ...line}), ...(trace.marker && {marker: {...inks({...trace.marker, ...own}), ...ground}}),
      ...(trace.fillcolor && {fillcolor: shade(look.fillcolor)}),
    };
  });
  const panels = Object.keys(layout).filter(key => key.startsWith("xaxis")).map(key => key.slice(5)), size = 1 / panels.length;
  const slim = narrow() && panels.length > 1;  // one panel below the other, with one title of their x axis if they share it
  const stacked = slim ? Object.fromEntries(panels.flatMap((key, k) => [
    [`xaxis${key}`, {...layout[`xaxis${key}`], domain: [0, 1], ...(layout[`xaxis${panels[k + 1]}`]?.matches && {title: {text: ""}})}],
    [`yaxis${key}`, {...layout[`yaxis${key}`], domain: [1 - (k + 0.78) * size, 1 - (k + 0.08) * size]}],
  ])) : {};
  const rows = new Set(panels.map(key => layout[`yaxis${key}`].domain[0])).size;
  if (panels.length > 1) get(id).style.height = slim ? `${15 * panels.length + 4}rem` : rows > 1 ? `${14 * rows + 5}rem` : "";
  const shapes = (layout.shapes ?? []).map(one => ({...one, line: inks(one.line), ...(one.fillcolor && {fillcolor: shade(one.fillcolor)})}));
  const notes = layout.annotations?.some(one => one.yref.endsWith("domain"));
  return draw(id, traces, {margin: {l: 50, r: 15, t: notes ? 40 : 15, b: 45}, ...layout, ...stacked, shapes, ...changed});
}

const state_of = (field, i) => trials.space.columns[field].map(name => trials[name][i]);
const before = i => state_of("v_pre", i);
const measured = {v_post: i => state_of("v_post", i), wrench: i => trials.space.wrench.map(name => trials[name][i])};
const predicted = (model, i) => trials.space.parts.map((_, k) => arrays.v_post(model, i, k));
const posed = i => trials.theta ? `, θ = ${digits(trials.theta[i] * 180 / Math.PI)}°` : "";
const errorsOf = model => errors[model] ??= trials.name.map((_, i) => arrays.error(model, i));

// Error over two variables; the selected trial is ringed, if there is one, trials outside the region are faint.
function drawMap(state) {
  const [x, y] = [state.across, state.up].map(k => trials.variables[k]), one = state.model, error = errorsOf(one);
  const most = share(errorsOf(page.yardstick), 0.97), region = page.regions?.[state.region];
  const inside = new Set(region?.rows), marked = region && !state.brush ? [region] : page.regions ?? [], name = page.models[one].label ?? page.models[one].name;
  const spread = variable => variable.labels.length
    ? variable.values.map((value, i) => value + 0.5 * (i * 0.618 % 1 - 0.5)) : variable.values;
  const at = {x: spread(x), y: spread(y)};
  const axis = variable => ({
    title: {text: typeset(variable.label)}, zeroline: false, ...(variable.period > 180 && quarters),
    ...(variable.labels.length && {tickvals: [-1, 0, 1], ticktext: variable.labels.map(plain)}),
  });
  const bar = {
    title: {text: page.switches && one === page.yardstick ? "Mass error of the law alone" : page.switches?.length ? "Mass error of the ticked model" : page.comparison?.[0].label ?? "Mass error", side: "top"}, thickness: 12, outlinewidth: 0,
    len: 0.9, orientation: "h", y: 1.02, yanchor: "bottom",
  };
  const points = trials.count > MOST_POINTS ? cells(at, error, most, region && inside, bar) : {
    type: "scatter", mode: "markers", ...at, showlegend: false, hoverinfo: "text",
    text: error.map((value, i) => `trial ${plain(trials.name[i])}<br>error ${written(value)}`),
    marker: {
      color: error, cmin: 0, cmax: most, colorscale: "Cividis", size: narrow() ? 6 : 7,
      opacity: region ? error.map((_, i) => inside.has(i) ? 1 : 0.15) : 0.9, colorbar: bar,
      line: {width: dark() ? 1 : 0.4, color: color("muted")},
    },
  };
  const ring = state.trial < 0 ? [] : [{
    type: "scatter", mode: "markers", x: [at.x[state.trial]], y: [at.y[state.trial]], hoverinfo: "skip", showlegend: false,
    marker: {symbol: "circle-open", size: 17, color: color("red"), line: {width: 3}},
  }];
  return draw("map", [points, ...ring], {
    ...(state.brush && !narrow() && {dragmode: "select"}), xaxis: axis(x), yaxis: axis(y), shapes: marked.flatMap(one => [...bands(one, x, "x"), ...bands(one, y, "y")]),
    uirevision: `${state.across} ${state.up}`,
    summary: `${plain(y.label)} over ${plain(x.label)} for ${name}: mean error ${written(average(error))}, largest ${
      Math.max(...error).toFixed(2)} of trial ${trials.name[error.indexOf(Math.max(...error))]}.`,
  });
}

// Mean errors of a large table in cells that hold all of its trials.
function drawWhole(which) {
  const {columns, limits: [left, right, low, high], across, up, trials: count} = page.sample.map, lines = count.length / columns;
  const table = values => Array.from({length: lines}, (_, a) => values.slice(a * columns, (a + 1) * columns));
  const centres = (from, to, n) => Array.from({length: n}, (_, k) => from + (k + 0.5) * (to - from) / n);
  const error = page.sample.map[which], there = values => values.filter(value => value !== null);
  return draw(`whole-${which}`, [{
    type: "heatmap", x: centres(left, right, columns), y: centres(low, high, lines), z: table(error), hoverinfo: "text",
    zmin: 0, zmax: share(there(page.sample.map.law), 0.97), colorscale: "Cividis",
    text: table(error.map((value, k) => value === null ? "" : `${count[k]} trials<br>mean error ${written(value)}`)),
    colorbar: {title: {text: "Mass error", side: "right"}, thickness: 12, outlinewidth: 0},
  }], {
    xaxis: {title: {text: typeset(across)}, zeroline: false}, yaxis: {title: {text: typeset(up)}, zeroline: false},
    summary: `${count.reduce((sum, n) => sum + n, 0)} trials in ${there(error).length} cells; mean errors of cells from ${
      written(Math.min(...there(error)))} to ${written(Math.max(...there(error)))}.`,
  });
}

// Mean errors of many trials in cells of the map; a cell knows its worst trial.
const MOST_POINTS = 5000;

function cells({x, y}, error, most, inside, colorbar) {
  const ends = values => values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  const across = narrow() ? 40 : 90, up = 60, [[left, right], [low, high]] = [ends(x), ends(y)];
  const place = (value, from, to, count) => Math.min(count - 1, Math.floor(count * (value - from) / (to - from || 1)));
  const table = of => Array.from({length: up}, () => Array(across).fill(of));
  const sum = table(0), count = table(0), rows = table(null);
  error.forEach((value, i) => {
    if (inside && !inside.has(i)) return;
    const [a, b] = [place(y[i], low, high, up), place(x[i], left, right, across)];
    sum[a][b] += value;
    count[a][b] += 1;
    if (rows[a][b] === null || value > error[rows[a][b]]) rows[a][b] = i;
  });
  const centres = (from, to, n) => Array.from({length: n}, (_, k) => from + (k + 0.5) * (to - from) / n);
  return {
    type: "heatmap", x: centres(left, right, across), y: centres(low, high, up), rows, hoverinfo: "text", showlegend: false,
    z: sum.map((row, a) => row.map((value, b) => count[a][b] ? value / count[a][b] : null)), zmin: 0, zmax: most, colorscale: "Cividis",
    text: sum.map((row, a) => row.map((value, b) => count[a][b] ? `${count[a][b]} trials<br>mean error ${written(value / count[a][b])}` : "")),
    colorbar,
  };
}

// The trial of a point of the map, or the worst of a cell.
const trialAt = ({curveNumber, data, pointIndex, pointNumber}) =>
  curveNumber > 0 ? null : data?.rows ? data.rows[pointNumber[0]]?.[pointNumber[1]] : pointIndex;

// The window of a region along an axis of its variable; around a circle it may come in two parts.
function bands(region, variable, along) {
  if (region.variable !== variable.name || variable.labels.length) return [];
  const scale = variable.scale, other = along === "x" ? "y" : "x";
  const ends = [Math.min(...variable.values), Math.max(...variable.values)];
  const turns = variable.period ? [-1, 0, 1].map(k => k * variable.period) : [0];
  return turns.map(turn => [
    Math.max(ends[0], (region.low ?? -Infinity) * scale + turn), Math.min(ends[1], (region.high ?? Infinity) * scale + turn),
  ]).filter(([low, high]) => low < high).map(([low, high]) => ({
    type: "rect", layer: "below", fillcolor: color("yellow"), opacity: 0.22, line: {width: 0},
    [`${along}0`]: low, [`${along}1`]: high, [`${other}0`]: 0, [`${other}1`]: 1, [`${other}ref`]: "paper",
  }));
}

// Slip of the contact point in space with a velocity of the body; and the direction of that before contact.
const slipWith = (i, [x, y, , a, b, c]) => {
  const [rx, ry, rz] = state_of("r", i);
  return [x + b * rz - c * ry, y + c * rx - a * rz];
};
const heading = i => { const [x, y] = slipWith(i, before(i)), length = Math.hypot(x, y) || 1; return [x / length, y / length]; };

// A vector, velocity or wrench in space along the slip, across it and along the normal.
function alongSlip(i, vector) {
  if (trials.space.planar) return vector;
  const [c, s] = heading(i);
  return vector.map((x, k) => k % 3 === 2 ? x : k % 3 ? c * x - s * vector[k - 1] : c * x + s * vector[k + 1]);
}

// A vector in the picture: in space along the slip and up, and what is across the slip at 45° and half its length.
const slant = 0.5 ** 1.5, towards = [slant, -1, slant].map(x => x / Math.hypot(slant, 1, slant));  // the viewer
const oblique = ([along, across, up]) => [along + slant * across, up + slant * across];
const seen = (i, vector) => trials.space.planar ? vector : oblique(alongSlip(i, vector));

// The outline of a convex body in front of it and behind it, and its silhouette, in the picture.  A piece is in front
// where some direction that is turned to the viewer has its support there, within 4 % of the body's size; `surface` are
// points of a round body beside its outline.
const directions = Array.from({length: 1200}, (_, k) => {
  const z = 1 - (2 * k + 1) / 1200, angle = k * Math.PI * (3 - Math.sqrt(5)), radius = Math.sqrt(1 - z * z);
  return [radius * Math.cos(angle), radius * Math.sin(angle), z];
});
function solid(outline, surface) {
  const dot = (p, n) => p[0] * n[0] + p[1] * n[1] + p[2] * n[2], normals = directions.filter(n => dot(n, towards) > 0);
  const points = [...outline.filter(Boolean), ...surface], size = Math.max(...points.map(p => Math.hypot(...p)));
  const support = normals.map(n => Math.max(...points.map(p => dot(p, n))) - 0.04 * size), front = [], back = [];
  outline.slice(1).forEach((q, k) => {
    const p = outline[k];
    if (!p || !q) return;
    const middle = p.map((x, j) => (x + q[j]) / 2);
    (normals.some((n, j) => dot(middle, n) >= support[j]) ? front : back).push(oblique(p), oblique(q), [null, null]);
  });
  const flat = points.map(oblique).sort((p, q) => p[0] - q[0] || p[1] - q[1]);
  const half = ordered => ordered.reduce((chain, p) => {
    const turns = () => { const [a, b] = chain.slice(-2); return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0; };
    while (chain.length > 1 && turns()) chain.pop();
    return [...chain, p];
  }, []);
  return {front, back, silhouette: [...half(flat), ...half([...flat].reverse())]};
}

// The rotation by a unit quaternion: p + 2 w u × p + 2 u × (u × p).
function spun([w, ...u]) {
  const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
  return p => {
    const once = cross(u, p), twice = cross(u, once);
    return p.map((value, k) => value + 2 * (w * once[k] + twice[k]));
  };
}

// The body above the floor, its contact point at 0; velocities as arrows of its centre of mass.
function drawPicture(state) {
  const i = state.trial, arm = state_of("r", i), r = seen(i, arm), theta = trials.theta?.[i], mm = 1000, d = arm.length;
  const com = [-r[0] * mm, -r[1] * mm], size = Math.hypot(...arm) * mm;
  const velocities = [
    ["Before", before(i), "muted", "dot"], ["After, measured", measured.v_post(i), "text", "solid"],
    ["After, predicted", predicted(state.model, i), "red", "dash"],
  ];
  const longest = Math.max(...velocities.map(([, v]) => Math.hypot(...v.slice(0, d))));
  const scale = 1.6 * size / (longest || 1), told = values => values.map(x => digits(x)).join(", ");
  const fastest = Math.max(...velocities.map(([, v]) => Math.hypot(...v.slice(d)))) || 1;
  const traces = [];
  let ends = [[0, 0], com];
  const body = trials.outlines[""] ?? trials.outlines[trials.object[i]];
  if (body) {
    const turned = d > 2 ? spun(state_of("q", i).slice(3)) : ([x, y]) => [c * x - s * y, s * x + c * y];
    const [c, s] = [Math.cos(theta), Math.sin(theta)];
    const points = body[0].map((x, k) => x === null ? null : turned(body.map(part => part[k])));
    const line = (part, look) => {
      const at = part.map(p => !p || p[0] === null ? [null, null] : p.map((value, j) => com[j] + mm * value));
      ends = ends.concat(at.filter(([x]) => x !== null));
      traces.push({type: "scatter", mode: "lines", x: at.map(p => p[0]), y: at.map(p => p[1]), name: "Body", hoverinfo: "skip", line: {color: color("muted"), width: 1.5}, ...look});
    };
    if (d > 2) {
      const semi = body.map(part => Math.max(...part.map(Math.abs)));
      const round = body[0].every((x, k) => x === null || Math.abs(body.reduce((sum, part, j) => sum + (part[k] / semi[j]) ** 2, 0) - 1) < 0.02);
      const surface = round ? directions.map(n => alongSlip(i, turned(n.map((x, j) => x * semi[j])))) : [];
      const {front, back, silhouette} = solid(points.map(p => p && alongSlip(i, p)), surface), width = 1.1 * size;
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([along, across]) => oblique([along * width, across * width, 0]));
      traces.push({type: "scatter", mode: "lines", x: corners.map(p => p[0]), y: corners.map(p => p[1]), fill: "toself", fillcolor: "rgba(128,140,155,0.12)", line: {width: 0}, name: "Floor", hoverinfo: "skip"});
      line(silhouette, {fill: "toself", fillcolor: "rgba(128,140,155,0.3)"});
      line(back, {line: {color: color("muted"), width: 0.75, dash: "dot"}, showlegend: false});
      line(front, {showlegend: false});
    } else line(points, {fill: "toself", fillcolor: "rgba(128,140,155,0.22)"});
  }
  traces.push({
    type: "scatter", mode: "lines+markers", x: [com[0], 0], y: [com[1], 0], name: "Contact point", hoverinfo: "skip",
    line: {color: color("muted"), width: 1, dash: "dot"}, marker: {size: [5, 10], color: color("accent")},
  });
  for (const [k, [name, v, ink, dash]] of velocities.entries()) {
    const flat = seen(i, v.slice(0, d)), spin = v.slice(d), omega = d > 2 ? `(${told(spin)})` : told(spin);
    const arrow = [0, 1].map(end => com.map((value, j) => value + scale * flat[j] * (k ? end : end - 1)));  // before: comes in
    const radius = (0.55 + 0.2 * k) * size, turn = 0.85 * Math.PI * spin[0] / fastest;  // counter-clockwise, from straight up
    const arc = d > 2 ? [com, seen(i, spin).map((value, j) => com[j] + size * value / fastest)] :
      Array.from({length: 33}, (_, j) => [com[0] - radius * Math.sin(turn * j / 32), com[1] + radius * Math.cos(turn * j / 32)]);
    ends.push(...arrow, ...arc);
    for (const [points, what] of [[arrow, `v = (${told(v.slice(0, d))}) m/s`], [arc, `ω = ${omega} rad/s`]]) {
      const head = points.map((_, j) => j === points.length - 1 && (points === arrow || d > 2 || Math.abs(turn) > 0.02));
      traces.push({
        type: "scatter", mode: "lines+markers", x: points.map(p => p[0]), y: points.map(p => p[1]), hoverinfo: "text",
        name: `${name}, ω = ${omega} rad/s`, text: `${name}: ${what}`, legendgroup: name, showlegend: points === arrow,
        line: {color: color(ink), width: points === arc && d > 2 ? 1 : 2.5, dash},
        marker: {color: color(ink), symbol: head.map(one => one ? "arrow" : "circle"), size: head.map(one => one ? 14 : 0), angleref: "previous", opacity: head.map(Number)},
      });
    }
  }
  const [x, y] = [0, 1].map(k => [Math.min(...ends.map(p => p[k])), Math.max(...ends.map(p => p[k]))]);
  const margin = 0.08 * Math.max(x[1] - x[0], y[1] - y[0]);
  return draw("picture", traces, {
    xaxis: {title: {text: d > 2 ? "Along the slip from the contact point (mm)" : "Horizontal distance from contact (mm)"}, range: [x[0] - margin, x[1] + margin], zeroline: false},
    yaxis: {title: {text: "Height (mm)"}, scaleanchor: "x", range: [Math.min(0, y[0]) - margin, y[1] + margin], zeroline: d < 3, zerolinecolor: color("text"), zerolinewidth: 3},
    summary: `Trial ${trials.name[i]}${posed(i)}. ` + velocities.map(([name, v]) =>
      `${name}: v = (${told(v.slice(0, d))}) m/s, ω = ${told(v.slice(d))} rad/s`).join(". ") + ".",
  });
}

// Impulse space of the selected trial: the figure of Python with the arrays of this trial, law and model.
function drawImpulse(state) {
  if (!trials.space.planar) return drawHodograph(state);
  const i = state.trial, law = page.fitted[state.law], pair = at => [at(0), at(1)];
  const [centre, across, up, along] = [0, 1, 2, 3].map(one => pair(k => arrays.ellipse(i, one, k)));
  const turn = (from, to) => Array.from({length: 121}, (_, k) => from + (to - from) * k / 120)
    .map(angle => pair(k => centre[k] + Math.cos(angle) * across[k] + Math.sin(angle) * up[k]));
  const chord = half => [-1, 1].map(sign => pair(k => centre[k] + sign * half[k]));
  const ellipse = turn(0, 2 * Math.PI), top = Math.max(...ellipse.map(p => p[1]));
  const impulses = page.fitted.map((_, one) => pair(k => arrays.impulse(one, i, k)));
  const model = pair(k => arrays.wrench(state.model, i, k)), real = measured.wrench(i).slice(0, 2);
  const trace = points => ({x: points.map(p => p[0]), y: points.map(p => p[1])});
  const ink = {color: law.color}, named = {
    admissible: trace(pushing(turn(0, Math.PI))), ellipse: trace(ellipse),
    "Maximum compression": trace(chord(across)), Sticking: trace(chord(along)),
    reach: {...trace(reach(state.law, i, Math.hypot(...centre))), name: `Reach of ${plain(law.label)}`, fillcolor: law.color, opacity: 0.45, line: ink},
    cone: {...trace([[-law.mu * top, top], [0, 0], [law.mu * top, top]]), name: `Friction cone, μ = ${digits(law.mu)}`, line: ink},
    Measured: trace([real]), model: trace([model]),
  };
  impulses.forEach((one, k) => { named[`law ${k}`] = trace([one]); });
  const points = [...ellipse, ...impulses, real, model], {xaxis, yaxis} = page.impulses.layout;
  const range = k => {
    const low = Math.min(...points.map(p => p[k])), high = Math.max(...points.map(p => p[k]));
    return [low - 0.08 * (high - low), high + 0.08 * (high - low)];
  };
  return show("impulse", page.impulses, named, {xaxis: {...xaxis, range: range(0)}, yaxis: {...yaxis, range: range(1)}});
}

// The slip of the selected trial in space, along its direction before contact and across it, with Routh's path of a law.
function drawHodograph(state) {
  const i = state.trial, law = page.fitted[state.law], steps = page.arrays.path.shape[2];
  const turned = v => { const [along, across] = alongSlip(i, [...slipWith(i, v), 0]); return {x: [along], y: [across]}; };
  const path = Array.from({length: steps}, (_, k) => [0, 1].map(j => arrays.path(state.law, i, k, j)));
  const named = {
    path: {x: path.map(p => p[0]), y: path.map(p => p[1]), name: `Routh's path, μ = ${digits(law.mu)} of ${plain(law.label)}`, line: {color: law.color}},
    before: turned(before(i)), Measured: turned(measured.v_post(i)), "Chosen model": turned(predicted(state.model, i)),
  };
  page.fitted.forEach((_, k) => { named[`law ${k}`] = {x: [arrays.end(k, i, 0)], y: [arrays.end(k, i, 1)]}; });
  return show("impulse", page.impulses, named);
}

// The part of a convex polygon where the contact does not pull.
function pushing(polygon) {
  return polygon.flatMap((p, k) => {
    const q = polygon[(k + 1) % polygon.length], cut = p[1] / (p[1] - q[1]);
    return [...(p[1] >= 0 ? [p] : []), ...(p[1] * q[1] < 0 ? [[p[0] + cut * (q[0] - p[0]), 0]] : [])];
  });
}

// The cells of a law's (μ, ε) grid as it maps them, counter-clockwise, a gap between each two.
function reach(law, i, momentum) {
  const [, , A, B] = page.arrays.reach.shape, outlines = [];
  for (let a = 0; a + 1 < A; a++) for (let b = 0; b + 1 < B; b++) {
    if (arrays.torn(law, i, a, b)) continue;
    const cell = [[a, b], [a + 1, b], [a + 1, b + 1], [a, b + 1]].map(node => [0, 1].map(k => momentum * arrays.reach(law, i, ...node, k)));
    const [p, q, s, t] = cell, area = (s[0] - p[0]) * (t[1] - q[1]) - (s[1] - p[1]) * (t[0] - q[0]);
    const turned = area < 0 ? cell.reverse() : cell;
    outlines.push(...turned, turned[0], [null, null]);
  }
  return outlines;
}

// Partial residuals of one effect, and the residual of the ticked model, in the figure of Python.
function drawCurve(state, k, id = `curve-${k}`) {
  const {figure} = page.effects[k].curve, found = curve(state, k), known = [...found.explained.y, ...found.rest.y.filter(value => value !== null), 0];
  const ends = [share(found.measured.y, 0.01), share(found.measured.y, 0.99), ...known], low = Math.min(...ends), high = Math.max(...ends);
  const range = [low - 0.05 * (high - low), high + 0.05 * (high - low)];
  return show(id, figure, found, {yaxis: {...figure.layout.yaxis, range}, showlegend: id === `curve-${k}`});
}

function curve(state, k) {
  const {quantity, component, scale, groups, x} = page.effects[k].curve, on = state.ticked(page.effects[k].name);
  const explained = trials.name.map((_, i) => scale * arrays.explained(i, k));
  const left = i => measured[quantity](i).map((value, k) => value - arrays[quantity](state.model, i, k));
  const rest = trials.name.map((_, i) => alongSlip(i, left(i))[component]);
  const without = rest.map((value, i) => value + (on ? explained[i] : 0));
  const opacity = dark() ? 0.45 : 1, mean = y => groups.map(group => group && average(group.map(i => y[i]))), middle = mean(x);
  return {
    measured: {x, y: without, opacity}, explained: {x, y: explained, opacity}, mean: {x: middle, y: mean(without)}, rest: {x: middle, y: mean(rest)},
    effect: {x: middle, y: mean(explained), line: {dash: on ? "solid" : "dot"}},
  };
}

// States before impact, and the drops to make next.
function drawDrops(state) {
  const {axes, drops} = page.experiment, [x, y] = [axes[state.dropAcross], axes[state.dropUp]];
  const of = axis => drops.map(drop => drop[axis.name]);
  return draw("drops", [
    {type: "scatter", mode: "markers", x: trials[x.column].map(value => x.scale * value), y: trials[y.column].map(value => y.scale * value), name: "Measured", hoverinfo: "skip",
     marker: {size: 5, color: color("muted"), opacity: 0.5}},
    {type: "scatter", mode: "markers+text", x: of(x), y: of(y), name: "To make next", text: drops.map((_, k) => `${k + 1}`),
     textposition: "top center", textfont: {size: 16, color: color("text")}, hoverinfo: "x+y",
     marker: {size: 13, symbol: "diamond", color: color("red"), line: {width: 1.5, color: color("ground")}}},
  ], {
    xaxis: {title: {text: typeset(x.label)}}, yaxis: {title: {text: typeset(y.label)}},
    summary: `${drops.length} drops; the table below has their states.`,
  });
}

const quarters = {tick0: 0, dtick: 90};

// Relative luminance of "#rrggbb", as WCAG has it.
function luminance(ink) {
  const part = k => {
    const value = parseInt(ink.slice(k, k + 2), 16) / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  };
  return 0.2126 * part(1) + 0.7152 * part(3) + 0.0722 * part(5);
}

const dark = () => luminance(color("ground")) < 0.2;

// On a dark ground a colour is lightened until its contrast is 3:1.
function visible(ink) {
  if (!dark() || !/^#[0-9a-f]{6}$/i.test(ink)) return ink;
  if (luminance(ink) < 0.02) return color("text");
  const lighter = share => "#" + [1, 3, 5].map(k => {
    const value = parseInt(ink.slice(k, k + 2), 16);
    return Math.round(value + share * (255 - value)).toString(16).padStart(2, "0");
  }).join("");
  const seen = share => (luminance(lighter(share)) + 0.05) / (luminance(color("ground")) + 0.05) >= 3;
  return lighter([...Array(20).keys()].map(k => k / 20).find(seen) ?? 1);
}

// A light tint would glare on a dark ground.
const shade = ink => dark() && luminance(ink) > 0.4 ? `${ink}40` : visible(ink);

const average = values => values.reduce((sum, value) => sum + value, 0) / values.length;
const share = (values, part) => [...values].sort((a, b) => a - b)[Math.round(part * (values.length - 1))];

// Number formats: as in contactlearn/report/text/numbers.py.
const written = x => {
  if (Math.abs(x) >= 1e-3 || x === 0) return x.toFixed(4).replace("-", "−");
  const [figure, power] = x.toExponential(1).split("e");
  return Math.abs(x) >= 1e-4 ? digits(x, 2) : `${digits(Number(figure), 2)}e−${-power}`;
};
const compared = (x, y) => {
  const [word, ratio] = x <= y ? ["smaller", y / x] : ["larger", x / y];
  if (!(Math.min(x, y) > 0)) return x === y ? "no smaller" : word;
  const times = ratio < 10 ? ratio.toFixed(1) : ratio.toFixed(0);
  const percent = 100 * Math.abs(x - y) / y;
  return ratio >= 2 ? `${times}× ${word}` : `${percent.toFixed(percent < 1 ? 1 : 0)}\u00a0% ${word}`;
};
const interval = one => `${written(one.mean)} (${written(one.low)}${one.low < 0 ? " to " : "–"}${written(one.high)})`;

const digits = (x, count = 3) => Number(x.toPrecision(count)).toString().replace("-", "−");
