// Sliders: while one is dragged the server previews the model at its place, the newest place first, one request at a
// time.  The curves in view move at once, within their axes and with some of many dots; the other figures follow
// between the questions, and the whole of them once the slider rests.
const touched = {of: "", when: 0};
const MOVED_DOTS = 200, REST = 300;  // ms
let wanted = null, requesting = false, settling = 0;

// The slider of a callback, if a person moved it: new sliders trigger callbacks, too.
function movedSlider() {
  const moved = dash_clientside.callback_context.triggered[0];
  if (!moved || !touched.of || performance.now() - touched.when > 3000) return null;
  const {of} = JSON.parse(moved.prop_id.slice(0, moved.prop_id.lastIndexOf(".")));
  return of === touched.of && Number.isFinite(moved.value) ? {of, value: moved.value} : null;
}

// Sliders that were let go; the server fits and shows the rest once they stay where they are, also where a key is held.
const resting = new Map();

function letGo({of, value}) {
  clearTimeout(resting.get(of)?.timer);
  resting.set(of, {value, timer: setTimeout(release, REST)});
}

function release() {
  for (const [of, {value, timer}] of [...resting]) {
    clearTimeout(timer);
    resting.delete(of);
    act("slider", of, value);
  }
}

async function preview(place) {
  wanted = place;
  if (requesting) return;
  requesting = true;
  while (wanted) {
    const one = {...wanted, address: location.search};
    wanted = null;
    const sent = await previewed(one);
    if (sent && one.address === location.search) showMoved(sent);
  }
  requesting = false;
}

// The server's preview of the model with one parameter moved; null if the model has changed, or the server has ended.
async function previewed(one) {
  try {
    const answer = await fetch("/preview", {method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(one)});
    return answer.ok ? await answer.json() : null;
  } catch { return null; }
}

function showMoved({changes, summary, ...outcome}) {
  const N = trials.count, change = floats(changes);
  if (floats(outcome.error).length !== N || change.length !== 3 * N * page.effects.length) return;  // of other data, or another model
  for (const [name, size] of sizes()) outcomes[name].set(floats(outcome[name]), size * N);
  delete errors[1];
  arrays.explained = (i, k) => change[(k * N + i) * trials.space.parts.length + page.effects[k].curve.component];
  page.effects.forEach(({curve}, k) => { if (curve.own) curve.x = trials.name.map((_, i) => curve.scale * arrays.explained(i, k)); });
  document.documentElement.dataset.moving = "yes";
  const [before, number, after] = summary, strong = document.createElement("b");
  strong.textContent = number;
  get("summary-moving").replaceChildren(before, strong, after);
  const curves = page.effects.map((_, k) => `curve-${k}`), view = curves.filter(id => inView(id) && get(id).data);
  for (const id of view) moveCurve(id, curves.indexOf(id));
  redrawSoon("map", "picture", "impulse", ...curves.filter(id => !view.includes(id)));
  showTrial();
  showWindow();
  shown();
  clearTimeout(settling);
  settling = setTimeout(() => redrawSoon(...curves), REST);
}

// Plotly's way without legend, axes and margins.
function moveCurve(id, k) {
  const found = curve(state, k), frame = {duration: 0, redraw: false}, metas = get(id).data.map(({meta}) => meta);
  const data = metas.map(meta => ({x: found[meta].x, y: found[meta].y, marker: {maxdisplayed: MOVED_DOTS}}));
  Plotly.animate(id, {data, traces: [...metas.keys()]}, {mode: "immediate", transition: {duration: 0}, frame});
}

// The page shows the model of its address again.
function still() {
  clearTimeout(settling);
  delete document.documentElement.dataset.moving;
}

function inView(id) {
  const {top, bottom, width} = get(id)?.getBoundingClientRect() ?? {};
  return width > 0 && bottom > 0 && top < innerHeight;
}

// A slider is named by the line above it.
function nameSliders() {
  for (const part of document.querySelectorAll(".parameter")) {
    part.querySelector("[role=slider]")?.setAttribute("aria-label", part.querySelector(".parameter-value span").textContent);
  }
}

for (const event of ["pointerdown", "pointermove", "pointerup", "keydown"]) {
  document.addEventListener(event, ({target, buttons, type}) => {
    const {set, of} = target.closest?.(".parameter") ? named(target) : {};
    if (set === "slider" && (type !== "pointermove" || buttons)) Object.assign(touched, {of, when: performance.now()});
    else if (type === "pointerup" && touched.of) touched.when = performance.now();
  }, true);
}
