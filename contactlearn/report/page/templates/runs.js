// Several runs: the order and the choice of rows, and the figures that follow them.
const table = get("runs"), heads = [...table.tHead.rows[0].cells];
const runOf = row => page.runs[row.dataset.run];

// What has no value comes last, either way.
function sortBy(column) {
  const head = heads[column], up = head.getAttribute("aria-sort") !== "ascending", sign = up ? 1 : -1;
  const key = row => row.cells[column].dataset.sort;
  const numbers = [...table.tBodies[0].rows].map(key).filter(one => one !== undefined).every(one => one !== "" && !isNaN(one));
  const compare = (a, b) => numbers ? a - b : a.localeCompare(b, "en", {numeric: true});
  heads.forEach(one => one.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  table.tBodies[0].append(...[...table.tBodies[0].rows].sort((a, b) => {
    const [x, y] = [key(a), key(b)];
    return x === undefined || y === undefined ? (x === undefined) - (y === undefined) : sign * compare(x, y);
  }));
  redraw("by-run", "curve");
}

function filterRows() {
  const wanted = [...document.querySelectorAll("[data-effect]")].filter(one => one.value)
    .map(one => [page.effects[one.dataset.effect].name, one.value === "with"]);
  for (const row of table.tBodies[0].rows) {
    row.hidden = !wanted.every(([name, yes]) => runOf(row).effects.includes(name) === yes);
    const ladder = document.querySelector(`[data-ladder="${row.dataset.run}"]`);
    if (ladder) ladder.hidden = row.hidden;
  }
  get("shown").textContent = `${shownRuns().length} of ${page.runs.length} runs`;
  fit();
  redraw("by-run", "curve");
}

const shownRuns = () => [...table.tBodies[0].rows].filter(row => !row.hidden).map(runOf);

// Room for a line each.
function fit() {
  const [figure, curves] = [get("by-run"), get("curve")];
  if (figure) figure.style.height = `${12 + 1.5 * shownRuns().filter(one => one.error).length}rem`;
  if (curves) curves.style.height = `${23 + 1.3 * shownLines().length}rem`;
}

// The settings that tell runs apart; without their names where these do not fit, and then cut in the middle.
function shortNames(rows, length) {
  const whole = rows.map(run => run.traits.map(pair => pair.join(" ")).join(", "));
  if (whole.every(text => text.length <= length)) return whole;
  const values = rows.map(run => run.traits.map(([, value]) => value).join(", ")), half = length >> 1;
  return values.map(text => text.length > length ? `${text.slice(0, half)}…${text.slice(half + 1 - length)}` : text);
}

// Plotly has no hover for the names of an axis.
function nameTicks(rows) {
  get("by-run").querySelectorAll(".ytick text").forEach((text, k) => {
    const title = text.querySelector("title") ?? text.appendChild(document.createElementNS(text.namespaceURI, "title"));
    title.textContent = [...rows[k].traits.map(pair => pair.join(" ")), rows[k].name].join("\n");
    text.style.pointerEvents = "all";
  });
}

function drawRuns() {
  const rows = shownRuns().filter(one => one.error), names = shortNames(rows, narrow() ? 16 : 40);
  const place = new Map(rows.map((run, k) => [run, k]));
  const of = (chosen, value, style) => ({
    type: "scatter", mode: "markers", x: chosen.map(run => value(run).mean), y: chosen.map(run => place.get(run)), hoverinfo: "text",
    text: chosen.map(run => `${plain(run.name)}: ${interval(value(run))}`), ...style,
  });
  const laws = [...new Set(rows.map(run => run.label))].map(law => {
    const chosen = rows.filter(run => run.label === law), ink = visible(chosen[0].color);
    return of(chosen, run => run.error, {
      name: plain(law), marker: {color: ink, symbol: chosen[0].symbol, size: 9},
      error_x: {type: "data", symmetric: false, color: ink, thickness: 2, width: 4,
        array: chosen.map(run => (run.error.high ?? run.error.mean) - run.error.mean), arrayminus: chosen.map(run => run.error.mean - (run.error.low ?? run.error.mean))},
    });
  });
  const others = [["base", "Law alone", "circle-open"], ["noise", "Noise floor", "line-ns"], ["bound", "IRB bound", "diamond-tall-open"]];
  const marks = others.map(([key, name, symbol]) => {
    const chosen = rows.filter(run => run[key]);
    return of(chosen, run => run[key], {name, marker: {color: color("muted"), symbol, size: 11, line: {width: 2, color: color("muted")}}});
  }).filter(trace => trace.x.length);
  const least = rows.reduce((best, run) => !best || run.error.mean < best.error.mean ? run : best, null);
  return draw("by-run", [...marks, ...laws], {
    margin: {l: 50, r: 15, t: 35, b: 45},
    xaxis: {title: {text: page.error}, rangemode: "tozero"}, showlegend: true,
    yaxis: {tickvals: rows.map((_, k) => k), ticktext: names.map(plain), range: [rows.length - 0.5, -0.5], zeroline: false, showgrid: true, fixedrange: true},
    summary: rows.length ? `${rows.length} runs, the least of ${least.name} with ${interval(least.error)}; the table has the numbers.` : "No run.",
  }).then(() => nameTicks(rows));
}

// Lines of the runs that are shown, in their order, as many as can be told apart; bounds always.
const most = 30;
const ofRuns = page.curves.filter(line => line.runs.length);
function shownLines() {
  const lines = new Set([...table.tBodies[0].rows].filter(row => !row.hidden)
    .flatMap(row => ofRuns.filter(line => line.runs.includes(Number(row.dataset.run)))));
  return [...[...lines].slice(0, most), ...page.curves.filter(line => !line.runs.length)];
}

// Lines of the figure that Python has built; many of them without their intervals.
function drawLines() {
  const lines = shownLines(), {data, layout} = page.figures.curve, few = lines.length <= 8;
  const left = ofRuns.length - lines.filter(line => line.runs.length).length;
  const parts = ending => lines.map(line => data.find(one => one.meta === `${page.curves.indexOf(line)}${ending}`)).filter(Boolean);
  const hover = Object.fromEntries(lines.map(line => [page.curves.indexOf(line), {
    hoverinfo: "text", text: line.intervals.map((one, k) => `${plain(line.label)}: ${interval(one)} at ${line.sizes[k]}`),
  }]));
  get("left").textContent = left ? `${left} of ${ofRuns.length} lines are not drawn: at most ${most} are, of the first runs that the table shows.` : "";
  return show("curve", {data: [...(few ? parts(", interval") : []), ...parts("")], layout: {...layout, shapes: layout.shapes.filter(one => few || one.type === "line")}}, hover, {
    yaxis: {...layout.yaxis, rangemode: "tozero"}, showlegend: true,
    summary: lines.map(one => `${one.label}: ${written(one.intervals.at(-1).mean)} at ${one.sizes.at(-1)}`).join("; ") + ".",
  });
}

async function startRuns() {
  heads.forEach((head, column) => head.querySelector("button").addEventListener("click", () => sortBy(column)));
  for (const list of document.querySelectorAll("[data-effect]")) list.addEventListener("change", filterRows);
  await library();
  Object.assign(drawn, {"by-run": drawRuns, curve: drawLines});
  fit();
  listen();
  attend();
}

startRuns();
