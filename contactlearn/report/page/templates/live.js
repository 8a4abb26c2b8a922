// The choices of the reader, and all that depends on them.
const state = {
  model: 0, trial: 0, region: -1, law: 0, across: 0, up: 0, dropAcross: 0, dropUp: 0,
  ticked: name => {
    const bit = (page.switches ?? []).findIndex(one => one.name === name);
    return bit < 0 || Boolean(state.model >> bit & 1);
  },
};

const model = () => page.models[state.model];

function showModel() {
  for (const box of document.querySelectorAll("[data-bit]")) box.checked = Boolean(state.model >> box.dataset.bit & 1);
  for (const output of document.querySelectorAll(".ticked")) {
    const less = state.model ? `, ${compared(model().mean, page.models[0].mean)}` : "";
    output.textContent = `Error of the fit to all trials: ${written(model().mean)}${less}`;
  }
  page.regions?.forEach((region, k) => {
    const cells = get("regions").tBodies[0].rows[k], inside = new Set(region.rows), error = errorsOf(state.model);
    cells.querySelector(".there").textContent = written(average(error.filter((_, i) => inside.has(i))));
    cells.querySelector(".elsewhere").textContent = written(average(error.filter((_, i) => !inside.has(i))));
  });
}

function showTrial(note = "") {
  const i = state.trial, rank = errorsOf(state.model).filter(error => error > errorsOf(state.model)[i]).length + 1;
  get("number").value = i + 1;
  get("name").value = trials.name[i];
  const parts = trials.space.parts.map((name, k) => [arrays.parts(state.model, i, k), name]).sort((a, b) => b[0] - a[0]);
  const percent = part => part < 0.005 ? "below 1\u00a0%" : `${(100 * part).toFixed(0)}\u00a0%`;
  get("trial-name").textContent = `${note}Trial ${trials.name[i]} of ${trials.object[i]}${posed(i)}: error of the ${page.switches?.length ? "ticked" : "chosen"} model ${
    written(errorsOf(state.model)[i])}, ${rank > 1 ? `number ${rank} from the worst` : "the worst"} of ${trials.count} trials` + (parts[0][0] ? `; ${
    parts.map(([part, name], k) => `${percent(part)} ${k ? "" : "of the squared error is "}in ${name}`).join(", ")}` : "") + ".";
  const wrench = trials.space.wrench.map((_, k) => arrays.wrench(state.model, i, k));
  const rows = [["Before", before(i), []], ["After, measured", measured.v_post(i), measured.wrench(i)], ["After, predicted", predicted(state.model, i), wrench]];
  get("numbers").tBodies[0].replaceChildren(...rows.map(([name, v, impulse]) => {
    const row = document.createElement("tr"), head = document.createElement("th");
    head.textContent = name;
    head.scope = "row";
    row.append(head);
    for (const value of [...v, ...impulse]) row.insertCell().textContent = digits(Math.abs(value) < 1e-9 ? 0 : value, 4);
    if (!impulse.length) row.insertCell().colSpan = trials.space.wrench.length;
    return row;
  }));
}

const drawn = {
  map: () => drawMap(state), picture: () => drawPicture(state), impulse: () => drawImpulse(state),
  "whole-law": () => drawWhole("law"), "whole-named": () => drawWhole("named"),
  drops: () => drawDrops(state),
};
for (const [id, figure] of Object.entries(page.figures ?? {})) drawn[id] = () => show(id, figure);
page.effects?.forEach((_, k) => { drawn[`curve-${k}`] = () => drawCurve(state, k); });

// Figures are drawn when they are near the window, or all of them for paper.
const stale = new Set(), near = new Set();

function redraw(...ids) {
  for (const id of ids) if (get(id)) stale.add(id);
  for (const id of stale) {
    if (!near.has(id) && !document.documentElement.classList.contains("paper")) continue;
    stale.delete(id);
    drawn[id]();
    if (id === "map" && !get("map").dataset.clicks) {
      get("map").dataset.clicks = "yes";
      get("map").on("plotly_click", event => { if (trialAt(event.points[0]) !== null) select(trialAt(event.points[0])); });
    }
  }
}

const watch = new IntersectionObserver(entries => {
  for (const {target, isIntersecting} of entries) isIntersecting ? near.add(target.id) : near.delete(target.id);
  redraw();
}, {rootMargin: "400px"});

const ofModel = () => ["map", "picture", "impulse", ...Object.keys(drawn).filter(id => id.startsWith("curve-"))];

function choose(number) {
  state.model = number;
  showModel();
  showTrial();
  redraw(...ofModel());
}

function select(trial) {
  if (!(trial >= 0 && trial < trials.count && Number.isInteger(trial))) return showTrial("No such trial. ");
  state.trial = trial;
  showTrial();
  redraw("map", "picture", "impulse");
}

// A select for each axis: its options, what it starts at, and the figure that it moves.
function axes(id, key, labels, start, figure) {
  const list = get(id);
  if (!list) return;
  list.replaceChildren(...labels.map((label, k) => new Option(label, k, k === start, k === start)));
  state[key] = start;
  list.addEventListener("change", () => { state[key] = Number(list.value); redraw(figure); });
}

function listen() {
  const on = (id, event, act) => get(id)?.addEventListener(event, act);
  for (const box of document.querySelectorAll("[data-bit]")) {
    box.addEventListener("change", () => choose(
      box.checked ? state.model | 1 << box.dataset.bit : state.model & ~(1 << box.dataset.bit)));
  }
  for (const button of document.querySelectorAll("[data-ticks]")) {
    button.addEventListener("click", () => choose(button.dataset.ticks === "all" ? page.models.length - 1 : 0));
  }
  on("model", "change", event => choose(Number(event.target.value)));
  on("region", "change", event => { state.region = Number(event.target.value); redraw("map"); });
  on("law", "change", event => { state.law = Number(event.target.value); redraw("impulse"); });
  const typed = (id, row) => on(id, "change", event => { if (event.target.value || event.target.validity.badInput) select(row(event.target.value)); });
  typed("number", value => Number(value) - 1);
  typed("name", value => trials.name.indexOf(value.trim()));
  on("worse", "click", () => select(nextWorse()));
  on("previous", "click", () => select((state.trial + trials.count - 1) % trials.count));
  on("next", "click", () => select((state.trial + 1) % trials.count));
  on("worst", "click", () => select(worst()));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraw(...Object.keys(drawn)));
}

// On paper all is open and drawn.
function paper(on) {
  document.documentElement.classList.toggle("paper", on);
  for (const one of document.querySelectorAll(on ? "details:not([open])" : "details[data-shut]")) {
    one.open = on;
    one.toggleAttribute("data-shut", on);
  }
  if (globalThis.Plotly) redraw(...Object.keys(drawn));
}

// Tables that are wider than their place can be reached and moved by keys.
const reachable = new ResizeObserver(entries => {
  for (const {target} of entries) {
    const wider = target.scrollWidth > target.clientWidth;
    target.classList.toggle("wider", wider);
    for (const [name, value] of [["tabindex", "0"], ["role", "region"], ["aria-label", "Table, wider than the page"]]) {
      wider ? target.setAttribute(name, value) : target.removeAttribute(name);
    }
  }
});

const worst = () => errorsOf(state.model).indexOf(Math.max(...errorsOf(state.model)));

// The trial that comes after the selected one in the order of errors; after the best comes the worst.
function nextWorse() {
  const error = errorsOf(state.model), order = trials.name.map((_, i) => i).sort((i, j) => error[j] - error[i]);
  return order[(order.indexOf(state.trial) + 1) % order.length];
}

// Load the library that draws.
async function library() {
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await unpacked("library"));
  document.head.append(script);
}

// Draw each figure when it comes near the window or changes its size.
function attend() {
  const resized = new ResizeObserver(entries => redraw(...entries.map(one => one.target.id)));
  for (const figure of document.querySelectorAll(".plot")) { watch.observe(figure); resized.observe(figure); }
  document.documentElement.dataset.ready = "yes";
}

async function start() {
  addEventListener("beforeprint", () => paper(true));
  addEventListener("afterprint", () => paper(false));
  for (const table of document.querySelectorAll(".wide")) reachable.observe(table);
  get("sections").replaceChildren(...[...document.querySelectorAll("main section")].map(section => {
    const link = document.createElement("a"), item = document.createElement("li");
    link.href = `#${section.id}`;
    link.textContent = section.querySelector("h2").textContent;
    item.append(link);
    return item;
  }));
  if (!trials) {
    if (!page.runs && !page.recordings && !page.plan) document.documentElement.dataset.ready = "yes";
    return;
  }
  const [block] = await Promise.all([unpacked("block"), library()]);
  for (const [name, entry] of Object.entries(page.arrays)) arrays[name] = view(block, entry);
  const labels = trials.variables.map(one => one.label), place = name => trials.variables.findIndex(one => one.name === name);
  // A variable that is constant, as θ of a ball, shows no map.
  const varying = trials.variables.filter(one => one.values.some(value => value !== one.values[0])).map(one => one.name);
  const likely = names => Math.max(0, place([...names, ...varying].find(name => varying.includes(name))));
  const up = likely([page.regions?.[0]?.variable, "theta", "approach_speed"]), drawnUp = trials.variables[up].name;
  const pose = ["theta", "theta_folded", "lever_arm", "lever_length"].includes(drawnUp);
  axes("map-x", "across", labels, likely([...(pose ? [] : ["theta"]), "incidence", ...varying].filter(name => name !== drawnUp)), "map");
  axes("map-y", "up", labels, up, "map");
  if (page.experiment) {
    const states = page.experiment.axes.map(one => one.label), known = name => page.experiment.axes.findIndex(one => one.name === name);
    axes("drops-x", "dropAcross", states, known(trials.space.planar ? "theta" : "v_z"), "drops");
    axes("drops-y", "dropUp", states, known("v_x"), "drops");
  }
  state.model = page.chosen;
  state.law = Math.max(0, page.fitted.findIndex(one => one.name === page.law.name));
  get("law").value = state.law;
  if (get("model")) get("model").value = state.model;
  state.trial = worst();
  showModel();
  showTrial();
  listen();
  attend();
}

start();
