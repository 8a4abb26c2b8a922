// The workbench: what the server sends goes to the figures; what is picked in a figure goes to the server.
const state = {
  model: 1, trial: 0, region: -1, law: 0, across: 0, up: 0, alone: false, brush: true,
  mapped: () => state.alone ? page.yardstick : state.model, ticked: () => true,
};
const drawn = {
  map: () => drawMap(state), picture: () => drawPicture(state), impulse: () => drawImpulse(state),
  curve: () => show("curve", page.curve),
};
const needs = {map: () => errors, picture: () => true, impulse: () => page.fitted.length, curve: () => page.curve};
const stale = new Set(), near = new Set();

// Actions that the server has not answered yet; it is sent all of them, so none is lost when answers are overtaken.
const pending = [];
let count = 0;

function act(kind, of = "", value = null) {
  if (kind !== "slider") release();
  pending.push({n: ++count, kind, of, value});
  document.documentElement.dataset.busy = "";
  dash_clientside.set_props("acted", {data: [...pending]});
}

function redraw(...ids) {
  for (const id of ids) stale.add(id);
  while (redrawOne());
}

// Draw a figure that is near the window and not up to date; false if there is none.
function redrawOne(among = stale) {
  if (!globalThis.Plotly || !trials || !arrays.v_post) return false;
  const ready = id => stale.has(id) && near.has(id) && get(id)?.clientWidth && (!needs[id] || needs[id]());
  const id = [...among].find(ready);
  if (!id) return false;
  stale.delete(id);
  drawn[id]();
  if (id === "map") listenToMap(get(id));
  return true;
}

// Draw figures one at a time, each behind what else the browser has to do.
let waiting = false;
function redrawSoon(...ids) {
  for (const id of ids) { stale.delete(id); stale.add(id); }
  if (waiting) return;
  waiting = true;
  setTimeout(() => { waiting = false; if (redrawOne()) redrawSoon(); });
}

function shown() {
  document.documentElement.dataset.shown = String(Number(document.documentElement.dataset.shown ?? 0) + 1);
}

// A click selects a trial, a box a window of both variables.
function listenToMap(place) {
  if (place.dataset.listens) return;
  place.dataset.listens = "yes";
  place.on("plotly_click", event => {
    const picked = trialAt(event.points[0]);
    if (Number.isInteger(picked)) act("picked", "", picked);
  });
  place.on("plotly_selected", event => {
    if (!event?.range?.x) return;
    const along = (k, [low, high]) => ({variable: trials.variables[k].name, low: Math.min(low, high), high: Math.max(low, high)});
    act("boxed", "", [along(state.across, event.range.x), along(state.up, event.range.y)]);
  });
}

const watch = new IntersectionObserver(entries => {
  for (const {target, isIntersecting} of entries) isIntersecting ? near.add(target.id) : near.delete(target.id);
  redraw();
}, {rootMargin: "200px"});
const resized = new ResizeObserver(entries => redraw(...entries.map(one => one.target.id)));

function attend() {
  for (const figure of document.querySelectorAll(".plot")) { watch.observe(figure); resized.observe(figure); }
}

// Curves: a figure for each effect of the model.
function showCurves() {
  const place = get("curves"), wanted = page.effects.map((_, k) => `curve-${k}`);
  while (place.children.length > wanted.length) place.lastChild.remove();
  page.effects.forEach((effect, k) => {
    const id = wanted[k], what = `${effect.label}: what it changes, and what the model leaves`;
    if (!get(id)) {
      const figure = document.createElement("figure"), plot = document.createElement("div"), caption = document.createElement("figcaption");
      Object.assign(plot, {id, className: "plot"});
      plot.setAttribute("role", "img");
      figure.append(plot, caption);
      place.append(figure);
    }
    get(id).dataset.what = what;
    get(id).parentNode.lastChild.textContent = what;
    drawn[id] = () => drawCurve(state, k);
  });
  attend();
  return wanted;
}

function showTrial() {
  const line = get("trial-status");
  if (!trials || !errors || !line) return;
  const i = state.trial, all = errorsOf(state.model);
  const parts = trials.space.parts.map((name, k) => `${(100 * arrays.parts(state.model, i, k)).toFixed(0)} % in ${name}`);
  line.textContent = `Trial ${trials.name[i]} of ${trials.object[i]}${posed(i)}: error of the model ${
    written(all[i])}, of the law alone ${written(errorsOf(0)[i])}; of the squared error ${parts.join(", ")}.`;
}

// The mean errors inside the windows of the map and in the rest.
function showWindow() {
  const line = get("window-status"), rows = page.regions[0]?.rows;
  if (!line || !trials) return;
  if (!rows?.length) { line.textContent = rows ? "No trial lies in these windows." : "Draw a box on the map to select trials, or click one."; return; }
  const inside = new Set(rows), mean = (model, is) => {
    const some = errorsOf(model).filter((_, i) => inside.has(i) === is);
    return some.length ? written(average(some)) : "–";
  };
  line.textContent = `${rows.length} of ${trials.count} trials are selected: mean error of the model ${mean(1, true)} (elsewhere ${
    mean(1, false)}), of the law alone ${mean(0, true)} (elsewhere ${mean(0, false)}).`;
}

window.dash_clientside = Object.assign({}, window.dash_clientside, {workbench: {
  // Whether there is nothing to undo, nothing to do again, and nothing but the law.
  steps(history, address) {
    const more = key => ["effect", "line"].includes(key) || key.startsWith("manual.");
    const keys = [...new URLSearchParams(address ?? "").keys()];
    return [!history?.past?.length, !history?.future?.length, !keys.some(more)];
  },
  data(sent) {
    if (!sent) return "";
    const names = [...Object.values(sent.space.columns).flat(), ...sent.space.wrench];
    trials = {...sent, ...Object.fromEntries(names.map(name => [name, floats(sent[name])])),
      variables: sent.variables.map(one => ({...one, values: floats(one.values)}))};
    arrays.v_post = null;
    const place = name => Math.max(0, trials.variables.findIndex(one => one.name === name));
    [state.across, state.up] = [place("slip_speed"), place(trials.space.planar ? "theta" : "approach_speed")];
    const options = trials.variables.map(one => one.label);
    for (const [id, chosen] of [["map-x", state.across], ["map-y", state.up]]) {
      get(id).replaceChildren(...options.map((text, k) => new Option(text, k, k === chosen, k === chosen)));
    }
    showBox();
    return sent.source;
  },
  model(sent) {
    if (!sent || !trials || sent.count !== trials.count) return "";
    const N = trials.count;
    for (const [name, size] of sizes()) {
      outcomes[name] = floats(sent[name]);
      arrays[name] = (model, i, k = 0) => outcomes[name][(model * N + i) * size + k];
    }
    errors = [];
    page.models = sent.names.map(name => ({name, label: name}));
    page.effects = sent.effects.map(one => ({...one, curve: {...one.curve, x: Array.from(floats(one.curve.x))}}));
    const explained = sent.explained && floats(sent.explained), K = sent.effects.length;
    arrays.explained = (i, k) => explained[i * K + k];
    still();
    redraw(...showCurves());
    redrawSoon("map", "picture", "impulse");
    showTrial();
    showWindow();
    shown();
    return String(sent.mean);
  },
  trial(sent) {
    if (!sent) return "";
    state.trial = sent.row;
    Object.assign(page, {fitted: sent.fitted, impulses: sent.figure});
    state.law = Math.max(0, sent.fitted.findIndex(one => one.name === sent.law));
    for (const name of ["reach", "path"]) {
      const one = sent[name];
      if (one) page.arrays[name] = {shape: [one.length, 1, one[0].length, one[0][0].length]};
    }
    for (const name of ["impulse", "end", "reach", "path", "torn"]) {
      arrays[name] = (law, _, ...index) => index.reduce((part, k) => part[k], sent[name][law]) ?? NaN;
    }
    arrays.ellipse = (_, vector, k) => sent.ellipse[vector][k];
    if (arrays.v_post) showTrial();
    redraw("map", "picture", "impulse");
    return String(sent.row);
  },
  done(number) {
    while (pending.length && pending[0].n <= number) pending.shift();
    if (!pending.length) delete document.documentElement.dataset.busy;
    return "";
  },
  slider() {
    const moved = movedSlider();
    if (moved) letGo(moved);
    return "";
  },
  drag() {
    const moved = movedSlider();
    if (moved) preview(moved);
    return "";
  },
  curve(sent) {
    if (!sent) return "";
    page.curve = sent;
    redraw("curve");
    return String(sent.data.length);
  },
  windows(sent) {
    if (!sent) return "";
    const scale = one => trials?.variables.find(variable => variable.name === one.variable)?.scale ?? 1;
    page.regions = sent.windows.map(one => ({...one, low: one.low / scale(one), high: one.high / scale(one), rows: sent.rows}));
    page.windows = sent.windows;
    state.region = sent.windows.length ? 0 : -1;
    showBox();
    if (arrays.v_post) showWindow();
    redraw("map");
    return "";
  },
}});

function chosenAxes() {
  state.across = Number(get("map-x").value);
  state.up = Number(get("map-y").value);
  state.alone = get("errors-of").value === "alone";
  showBox();
  redraw("map");
}

// Buttons, lists and sliders, wherever they are made.
const named = place => JSON.parse(place.closest('[id^="{"]')?.id ?? "{}");

document.addEventListener("click", ({target}) => {
  const button = target.closest?.("[data-action]");
  if (!button) return;
  const {action, of} = button.dataset;
  act(action, action === "line" && !of ? get("line").value : of);
});
document.addEventListener("change", ({target}) => {
  const {set, of} = named(target);
  if (set === "ticks") act("ticks", target.value, target.checked);
  if (set === "law") act("law", target.value);
  if (set === "form" || set === "option") act(set, of, target.value);
});
document.addEventListener("keydown", ({target, key}) => {
  if (target.id === "line" && key === "Enter") act("line", target.value);
});
// The page is made by scripts: what it needs is attached once it is there.
const begun = new MutationObserver(() => {
  if (!get("map")) return;
  begun.disconnect();
  for (const id of ["map-x", "map-y", "errors-of"]) get(id).addEventListener("change", chosenAxes);
  get("line").setAttribute("list", "completions");
  new MutationObserver(nameSliders).observe(get("parts"), {childList: true, subtree: true});
  attend();
  redraw("map", "picture", "impulse");
});
begun.observe(document.documentElement, {childList: true, subtree: true});
document.getElementById("plotly").addEventListener("load", () => redraw());
addEventListener("load", () => redraw());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraw(...Object.keys(drawn)));
