// The figures; text that comes from data is escaped, because plotly takes some HTML.
const plain = text => String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
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
  div.setAttribute("aria-label", summary ? `${div.dataset.what}. ${summary}` : div.dataset.what);
  return Plotly.react(div, traces, whole, {
    displaylogo: false, displayModeBar: id.startsWith("telling") || id === "rungs" ? false : "hover", showSendToCloud: false, modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
    toImageButtonOptions: {format: "svg", filename: id},
  });
}

// Bars with their intervals, if they have one, each below its name; what is no model is grey.
function drawBars(id, rows) {
  const place = rows.map((_, k) => -k), ends = rows.map(one => one.high ?? one.mean);
  return draw(id, [{
    type: "bar", orientation: "h", y: place, x: rows.map(one => one.mean), width: 0.42, hoverinfo: "skip", showlegend: false,
    marker: {color: rows.map(one => one.faint ? color("line") : color("bar"))},
    error_x: {
      type: "data", symmetric: false, color: color("text"), thickness: 2.5, width: 0,
      array: rows.map(one => one.mean ? (one.high ?? one.mean) - one.mean : 0), arrayminus: rows.map(one => one.mean - (one.low ?? one.mean)),
    },
  }], {
    margin: {l: 8, r: 15, t: 8, b: 45}, bargap: 0, xaxis: {title: {text: "Held-out mass error"}, range: [0, 1.04 * Math.max(...ends)]},
    yaxis: {visible: false, range: [0.55 - rows.length, 0.75], fixedrange: true},
    annotations: rows.map((one, k) => ({
      x: 0, y: -k + 0.23, xanchor: "left", yanchor: "bottom", showarrow: false, align: "left",
      text: `<b>${written(one.mean)}</b>  ${plain(one.name)}`, font: {size: narrow() ? 12 : 13},
    })),
    summary: rows.map(one => `${one.name}: ${written(one.mean)}`).join("; ") + ".",
  });
}

// Error over two variables; the selected trial is ringed, if there is one, trials outside the region are faint.
function drawMap(state, id = "map") {
  const [x, y] = [state.across, state.up].map(k => trials.variables[k]), one = state.mapped(), error = massErrors(one);
  const most = share(massErrors(page.yardstick), 0.97), region = page.regions?.[state.region];
  const inside = new Set(region?.rows), marked = region && !state.brush ? [region] : page.regions ?? [], name = page.models[one].label ?? page.models[one].name;
  const spread = variable => variable.labels.length
    ? variable.values.map((value, i) => value + 0.5 * (i * 0.618 % 1 - 0.5)) : variable.values;
  const at = {x: spread(x), y: spread(y)};
  const axis = variable => ({
    title: {text: plain(variable.label)}, zeroline: false, ...(variable.period > 180 && quarters),
    ...(variable.labels.length && {tickvals: [-1, 0, 1], ticktext: variable.labels.map(plain)}),
  });
  const bar = {
    title: {text: state.alone ? "Mass error of the law alone" : page.switches?.length ? "Mass error of the ticked model" : "Mass error", side: id === "map" ? "top" : "right"}, thickness: 12, outlinewidth: 0,
    ...(id === "map" && {len: 0.9, orientation: "h", y: 1.02, yanchor: "bottom"}),
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
  return draw(id, [points, ...ring], {
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
    xaxis: {title: {text: plain(across)}, zeroline: false}, yaxis: {title: {text: plain(up)}, zeroline: false},
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

// The body above the floor, its contact point at 0; velocities as arrows of its centre of mass.
function drawPicture(state) {
  const i = state.trial, r = [trials.rx[i], trials.ry[i]], theta = trials.theta[i], mm = 1000;
  const com = [-r[0] * mm, -r[1] * mm], size = Math.hypot(...r) * mm;
  const velocities = [
    ["Before", before(i), "muted", "dot"], ["After, measured", measured(i), "text", "solid"],
    ["After, predicted", predicted(state.model, i), "red", "dash"],
  ];
  const longest = Math.max(...velocities.map(([, v]) => Math.hypot(v[0], v[1])));
  const scale = 1.6 * size / (longest || 1);
  const fastest = Math.max(...velocities.map(([, v]) => Math.abs(v[2]))) || 1;
  const traces = [];
  let ends = [[0, 0], com];
  const body = trials.outlines[""] ?? trials.outlines[trials.object[i]];
  if (body) {
    const [c, s] = [Math.cos(theta), Math.sin(theta)];
    const outline = body[0].map((x, k) => [
      com[0] + mm * (c * x - s * body[1][k]), com[1] + mm * (s * x + c * body[1][k])]);
    ends = ends.concat(outline);
    traces.push({
      type: "scatter", mode: "lines", x: outline.map(p => p[0]), y: outline.map(p => p[1]), fill: "toself",
      fillcolor: "rgba(128,140,155,0.22)", line: {color: color("muted"), width: 1.5}, name: "Body", hoverinfo: "skip",
    });
  }
  traces.push({
    type: "scatter", mode: "lines+markers", x: [com[0], 0], y: [com[1], 0], name: "Contact point", hoverinfo: "skip",
    line: {color: color("muted"), width: 1, dash: "dot"}, marker: {size: [5, 10], color: color("accent")},
  });
  for (const [k, [name, v, ink, dash]] of velocities.entries()) {
    const arrow = [0, 1].map(end => com.map((value, j) => value + scale * v[j] * (k ? end : end - 1)));  // before: comes in
    const radius = (0.55 + 0.2 * k) * size, turn = 0.85 * Math.PI * v[2] / fastest;  // counter-clockwise, from straight up
    const arc = Array.from({length: 33}, (_, j) => [com[0] - radius * Math.sin(turn * j / 32), com[1] + radius * Math.cos(turn * j / 32)]);
    ends.push(...arrow, ...arc);
    for (const [points, what] of [[arrow, `v = (${digits(v[0])}, ${digits(v[1])}) m/s`], [arc, `ω = ${digits(v[2])} rad/s`]]) {
      const head = points.map((_, j) => j === points.length - 1 && (points === arrow || Math.abs(turn) > 0.02));
      traces.push({
        type: "scatter", mode: "lines+markers", x: points.map(p => p[0]), y: points.map(p => p[1]), hoverinfo: "text",
        name: `${name}, ω = ${digits(v[2])} rad/s`, text: `${name}: ${what}`, legendgroup: name, showlegend: points === arrow,
        line: {color: color(ink), width: 2.5, dash},
        marker: {color: color(ink), symbol: head.map(one => one ? "arrow" : "circle"), size: head.map(one => one ? 14 : 0), angleref: "previous", opacity: head.map(Number)},
      });
    }
  }
  const [x, y] = [0, 1].map(k => [Math.min(...ends.map(p => p[k])), Math.max(...ends.map(p => p[k]))]);
  const margin = 0.08 * Math.max(x[1] - x[0], y[1] - y[0]);
  return draw("picture", traces, {
    xaxis: {title: {text: "From the contact point (mm)"}, range: [x[0] - margin, x[1] + margin], zeroline: false},
    yaxis: {scaleanchor: "x", range: [Math.min(0, y[0]) - margin, y[1] + margin], zeroline: true, zerolinecolor: color("text"), zerolinewidth: 3},
    summary: `Trial ${trials.name[i]} at θ = ${digits(theta * 180 / Math.PI)}°. ` + velocities.map(([name, v]) =>
      `${name}: v = (${digits(v[0])}, ${digits(v[1])}) m/s, ω = ${digits(v[2])} rad/s`).join(". ") + ".",
  });
}

// Impulses of one impact: energy ellipse, admissible part, friction cone, laws, the reach of one, and the measurement.
function drawImpulse(state) {
  const i = state.trial, at = contact(i), milli = 1000, {W, v, centre} = at;
  const ellipse = energyEllipse(at), law = page.fitted[state.law], ink = visible(law.color);
  const admissible = above(above(ellipse, p => p[1]), p => v[1] + W[1] * p[0] + W[2] * p[1]);
  const line = (points, name, style) => ({
    type: "scatter", mode: "lines", x: points.map(p => milli * p[0]), y: points.map(p => milli * p[1]), name, hoverinfo: "name", ...style,
  });
  const thin = dash => ({line: {color: color("muted"), width: 1.2, dash}});
  const chord = direction => {  // through the centre, P = centre ± d with dᵀ W d = v_cᵀ M_c v_c
    const [a, b] = direction, size = W[0] * a * a + 2 * W[1] * a * b + W[2] * b * b;
    const d = Math.sqrt(Math.max(0, -(v[0] * centre[0] + v[1] * centre[1])) / size);
    return [-1, 1].map(sign => [centre[0] + sign * d * a, centre[1] + sign * d * b]);
  };
  const top = Math.max(...ellipse.map(p => p[1])), cone = [[-law.mu * top, top], [0, 0], [law.mu * top, top]];
  const given = page.fitted.map((_, k) => [arrays.impulse(k, i, 0), arrays.impulse(k, i, 1)]);
  const real = wrench(i, minus(measured(i), before(i)));
  const model = wrench(i, minus(predicted(state.model, i), before(i)));
  const point = ([x, y], name, marker) => ({
    type: "scatter", mode: "markers", x: [milli * x], y: [milli * y], name: plain(name), hoverinfo: "text",
    text: `${plain(name)}: P = (${digits(milli * x)}, ${digits(milli * y)}) mN s`, marker,
  });
  const traces = [
    line(admissible, "Admissible", {fill: "toself", fillcolor: "rgba(128,140,155,0.16)", line: {width: 0}}),
    line(ellipse, "Energy ellipse", {line: {color: color("muted"), width: 1.5}}),
    line(reach(state.law, i, Math.hypot(...centre)), `Reach of ${law.label}`, {
      fill: "toself", fillcolor: ink, opacity: 0.45, line: {color: ink, width: 2}}),
    line(cone, `Friction cone, μ = ${digits(law.mu)}`, {line: {color: ink, width: 1.5, dash: "dash"}}),
    line(chord([W[2], -W[1]]), "Maximum compression", thin("dash")),
    line(chord([W[1], -W[0]]), "Sticking", thin("dashdot")),
    ...page.fitted.map((one, k) => point(given[k], one.label, {
      symbol: one.symbol, color: visible(one.color), size: 12, line: {width: 1, color: color("ground")}})),
    point(model, "Chosen model", {symbol: "circle-open", size: 16, color: color("red"), line: {width: 3}}),
    point(real, "Measured", {symbol: "x-thin", size: 13, color: color("text"), line: {width: 3, color: color("text")}}),
  ];
  const points = [...ellipse, ...given, real, model];
  const range = k => {
    const low = Math.min(...points.map(p => milli * p[k])), high = Math.max(...points.map(p => milli * p[k]));
    return [low - 0.08 * (high - low), high + 0.08 * (high - low)];
  };
  return draw("impulse", traces, {
    xaxis: {title: {text: "Tangential impulse P_t (mN s)"}, range: range(0)},
    yaxis: {title: {text: "Normal impulse P_n (mN s)"}, range: range(1), scaleanchor: "x"},
    summary: `Measured P = (${digits(milli * real[0])}, ${digits(milli * real[1])}) mN s; ` + page.fitted.map((one, k) =>
      `${one.label} (${digits(milli * given[k][0])}, ${digits(milli * given[k][1])})`).join(", ") + ".",
  });
}

// The cells of a law's (μ, ε) grid as it maps them, counter-clockwise, a gap between each two.
function reach(law, i, momentum) {
  const [, , A, B] = page.arrays.reach.shape, outlines = [];
  for (let a = 0; a + 1 < A; a++) for (let b = 0; b + 1 < B; b++) {
    if (arrays.torn(law, i, a, b)) continue;
    const cell = [[a, b], [a + 1, b], [a + 1, b + 1], [a, b + 1]].map(node =>
      [0, 1].map(k => momentum * arrays.reach(law, i, ...node, k)));
    const [p, q, s, t] = cell, area = (s[0] - p[0]) * (t[1] - q[1]) - (s[1] - p[1]) * (t[0] - q[0]);
    const turned = area < 0 ? cell.reverse() : cell;
    outlines.push(...turned, turned[0], [null, null]);
  }
  return outlines.map(p => p[0] === null ? [NaN, NaN] : p);
}

// Partial residuals of one effect, and the residual of the ticked model.
function drawCurve(state, k, id = `curve-${k}`) {
  const {traces, layout} = curveFigure(state, k);
  return draw(id, traces, {...layout, showlegend: id === `curve-${k}`});
}

function curveFigure(state, k) {
  const {curve} = page.effects[k], {component, quantity} = curve;
  const on = state.ticked(page.effects[k].name), wrenches = quantity === "wrench";
  const milli = wrenches ? 1000 : 1, unit = `${wrenches ? "m" : ""}${curve.unit}`;
  const [x, variableUnit] = curve.variable_unit === "rad" ? [curve.x.map(degrees), "°"]
    : curve.variable_unit === curve.unit ? [curve.x.map(value => milli * value), unit] : [curve.x, curve.variable_unit];
  const explained = trials.name.map((_, i) => milli * arrays.explained(i, k));
  const residual = trials.name.map((_, i) => {
    const difference = minus(measured(i), predicted(state.model, i));
    return milli * (wrenches ? wrench(i, difference) : difference)[component];
  });
  const without = residual.map((value, i) => value + (on ? explained[i] : 0));
  const groups = grouped(x), [middle, mean, effect, rest] = [x, without, explained, residual].map(y => means(groups, y));
  const known = values => values.filter(value => value !== null);
  const ends = [share(without, 0.01), share(without, 0.99), ...explained, ...known(rest), 0];
  const low = Math.min(...ends), high = Math.max(...ends), dots = {type: "scatter", mode: "markers", hoverinfo: "skip"};
  const traces = [
    {...dots, x, y: without, name: "Trials without it", marker: {size: 3.5, color: color("muted"), opacity: 0.45}},
    {...dots, x, y: explained, name: "Effect, by trial", marker: {size: 3, color: color("red"), opacity: 0.55}},
    {type: "scatter", mode: "lines", x: middle, y: effect, name: "Effect, mean", line: {color: color("red"), width: 2.5, dash: on ? "solid" : "dot"}},
    {type: "scatter", mode: "markers", x: middle, y: mean, name: "Trials, mean of a twentieth", marker: {size: 8, color: color("text")}},
    {type: "scatter", mode: "lines+markers", x: middle, y: rest, name: "Residual of the ticked model, mean",
     line: {color: color("accent"), width: 1.5}, marker: {size: 8, symbol: "square-open", color: color("accent"), line: {width: 2}}},
  ];
  return {traces, layout: {
    xaxis: {title: {text: plain(curve.variable + (variableUnit && ` (${variableUnit})`))}, ...(variableUnit === "°" && quarters)},
    yaxis: {title: {text: plain(`Residual of ${curve.letter} (${unit})`)}, range: [low - 0.05 * (high - low), high + 0.05 * (high - low)]},
    summary: `The effect goes from ${digits(Math.min(...known(effect)))} to ${digits(Math.max(...known(effect)))} ${unit}; the mean residual of the ticked model from ${
      digits(Math.min(...known(rest)))} to ${digits(Math.max(...known(rest)))} ${unit}.`,
  }};
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
    xaxis: {title: {text: plain(x.label)}}, yaxis: {title: {text: plain(y.label)}},
    summary: `${drops.length} drops; the table below has their states.`,
  });
}

// Mean error of each model against the number of training trials; yardsticks are level lines.
function drawLearning() {
  const traces = page.curves.flatMap(({label, color: ink, symbol, dash, sizes, intervals, level}) => {
    const band = sizes.length > 1 ? [{
      type: "scatter", mode: "lines", x: [...sizes, ...[...sizes].reverse()], hoverinfo: "skip", showlegend: false,
      y: [...intervals.map(one => one.high), ...intervals.map(one => one.low).reverse()],
      fill: "toself", fillcolor: visible(ink), opacity: 0.15, line: {width: 0},
    }] : [];
    return [...band, {
      type: "scatter", mode: level ? "lines" : "lines+markers", x: sizes, y: intervals.map(one => one.mean), name: plain(label),
      line: {color: visible(ink), dash}, marker: {symbol, size: 8, color: visible(ink)},
    }];
  });
  return draw("curve", traces, {
    xaxis: {title: {text: "Training trials"}, type: "log", tickvals: page.curves[0].sizes, ticktext: page.curves[0].sizes.map(String)},
    yaxis: {title: {text: "Mass error"}, rangemode: "tozero"},
    summary: page.curves.map(one => `${one.label}: ${one.intervals.at(-1).mean} at ${one.sizes.at(-1)}`).join("; ") + ".",
  });
}

// Boxes of the error of each model over the trials, whiskers at the 5th and 95th percentile.
function drawDistributions() {
  const shown = page.models.map((one, k) => ({...one, errors: massErrors(k)})).reverse();
  return draw("distributions", shown.map(one => ({
    type: "box", orientation: "h", y: [plain(one.label)], lowerfence: [share(one.errors, 0.05)], q1: [share(one.errors, 0.25)],
    median: [share(one.errors, 0.5)], q3: [share(one.errors, 0.75)], upperfence: [share(one.errors, 0.95)], mean: [one.mean],
    boxmean: true, showlegend: false, hoverinfo: "x", line: {color: visible(one.color), width: 1.5},
  })), {
    xaxis: {title: {text: "Mass error"}, rangemode: "tozero"}, yaxis: {showgrid: false, type: "category"},
    summary: shown.map(one => `${one.label}: median ${written(share(one.errors, 0.5))}`).reverse().join("; ") + ".",
  });
}

const quarters = {tick0: 0, dtick: 90};

// An angle in radians as degrees within ±180.
const degrees = angle => (angle * 180 / Math.PI % 360 + 540) % 360 - 180;

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
  if (ink === "#000000") return color("text");
  const lighter = share => "#" + [1, 3, 5].map(k => {
    const value = parseInt(ink.slice(k, k + 2), 16);
    return Math.round(value + share * (255 - value)).toString(16).padStart(2, "0");
  }).join("");
  const seen = share => (luminance(lighter(share)) + 0.05) / (luminance(color("ground")) + 0.05) >= 3;
  return lighter([...Array(20).keys()].map(k => k / 20).find(seen) ?? 1);
}
