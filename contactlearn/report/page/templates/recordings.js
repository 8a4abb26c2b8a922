// Recordings: the chosen one over time with its flights, residuals and refused parts, and the body at contact.
const tracked = {recording: 0, contact: 0, all: []};
const {coordinates} = page;
const inkOf = {frames: "muted", flight: "accent", refused: "red", rest: "muted", contact: "text"};
const current = () => tracked.all[tracked.recording];
const suffix = k => k ? String(k + 1) : "";

// Where each coordinate and its residuals are drawn: in columns, or one below the other on a narrow page.
function places(slim) {
  const count = coordinates.length, column = 1.08 / count;
  return coordinates.map((_, k) => {
    if (!slim) return {x: `x${suffix(k)}`, across: [k * column, k * column + column - 0.08], up: [0.4, 1], below: [0, 0.3]};
    const top = 1 - k / count, size = 1 / count - 0.035;
    return {x: "x", across: [0, 1], up: [top - 0.64 * size, top], below: [top - size, top - 0.72 * size]};
  });
}

const spanOf = values => {
  const finite = values.filter(value => value !== null), low = Math.min(...finite), high = Math.max(...finite);
  const margin = 0.06 * (high - low) || 1e-3;
  return finite.length ? [low - margin, high + margin] : [0, 1];
};
const broken = parts => parts.flatMap((part, k) => k ? [null, ...part] : part);

function drawTrack() {
  const one = current(), slim = narrow(), layout = {shapes: [], showlegend: false, margin: {l: 50, r: 15, t: 32, b: 45}}, traces = [];
  places(slim).forEach(({x, across, up, below}, k) => {
    const [name, unit, fine] = coordinates[k], upper = `y${suffix(k)}`, lower = `y${k + 1 + coordinates.length}`, last = !slim || k === coordinates.length - 1;
    const range = spanOf([...one.pose[k], ...one.flights.flatMap(flight => flight.line[k])]);
    const at = one.flights.map(flight => flight.at.map(place => one.time[place])), left = one.flights.map(flight => flight.residual[k]);
    const far = Math.max(1e-9, ...left.flat().map(Math.abs)) * 1.1;
    if (!slim || !k) layout[`xaxis${x.slice(1)}`] = {domain: across, anchor: slim ? `y${2 * coordinates.length}` : lower, matches: k ? "x" : undefined, zeroline: false, title: {text: "Time (s)"}};
    layout[`yaxis${suffix(k)}`] = {domain: up, anchor: x, range, zeroline: false, title: {text: `${name} (${unit})`, standoff: 4}};
    layout[`yaxis${k + 1 + coordinates.length}`] = {domain: below, anchor: x, range: [-far, far], nticks: 4, title: {text: slim || k ? `Δ${name} (${fine})` : `Residual Δ${name} (${fine})`, standoff: 4}};
    const mark = {type: "scatter", mode: "markers", xaxis: x, hovertemplate: `%{x:.4f} s, %{y} `};
    traces.push(...one.refused.map(part => band(one, part, range, x, upper)), ...one.refused.map(part => band(one, part, [-far, far], x, lower)));
    traces.push(
      {...mark, yaxis: upper, x: one.time, y: one.pose[k], hovertemplate: `${mark.hovertemplate}${unit}<extra></extra>`, marker: {size: 4, color: color(inkOf.frames), opacity: 0.75}},
      {type: "scatter", mode: "lines", xaxis: x, yaxis: upper, x: broken(one.flights.map(flight => flight.time)), y: broken(one.flights.map(flight => flight.line[k])), hoverinfo: "skip", line: {color: color(inkOf.flight), width: 2}},
      {...mark, yaxis: lower, x: at.flat(), y: left.flat(), hovertemplate: `${mark.hovertemplate}${fine}<extra></extra>`, marker: {size: 3.5, color: color(inkOf.flight)}},
    );
    layout.shapes.push(...one.contacts.flatMap(({time}, number) => [upper, lower].map(y => ({
      type: "line", xref: x, yref: `${y} domain`, x0: time, x1: time, y0: 0, y1: 1,
      line: {color: color(inkOf.contact), width: number === tracked.contact ? 2 : 1.2, dash: number === tracked.contact ? "solid" : "dot"},
    }))));
    if (!last) layout.xaxis.showticklabels = true;
  });
  layout.uirevision = one.name;
  return draw("track", traces, {...layout, summary: `Recording ${one.name}: ${one.summary} Contacts at ${one.contacts.map(({time}) => `${digits(time, 5)} s`).join(", ") || "no instant"}. ${
    one.refused.map(part => `Refused from ${digits(part.time[0], 4)} s to ${digits(part.time[1], 4)} s: ${part.reason}, ${part.number}`).join(". ")}`});
}

// A refused part, or one at rest, at least a frame wide; pointing at it says why.
function band(one, {time: [start, end], reason, number, rest}, [low, high], xaxis, yaxis) {
  const more = Math.max(0, one.step - (end - start)) / 2, [a, b] = [start - more, end + more];
  return {
    type: "scatter", mode: "lines", x: [a, b, b, a, a], y: [low, low, high, high, low], xaxis, yaxis, fill: "toself", fillcolor: `${color(rest ? inkOf.rest : inkOf.refused)}${rest ? "22" : "44"}`,
    line: {width: 0}, hoveron: "fills", hoverinfo: "text", text: `${plain(reason)}: ${plain(number)}`,
  };
}

// A point of the body in world axes; in space by a quaternion.
function placed([x, y, ...turn], point) {
  if (turn.length === 1) {
    const [c, s] = [Math.cos(turn[0]), Math.sin(turn[0])];
    return [c * point[0] - s * point[1], s * point[0] + c * point[1]];
  }
  const [, w, a, b, c] = turn, [p, q, r] = point;
  return [
    (1 - 2 * (b * b + c * c)) * p + 2 * (a * b - w * c) * q + 2 * (a * c + w * b) * r, 2 * (a * b + w * c) * p + (1 - 2 * (a * a + c * c)) * q + 2 * (b * c - w * a) * r,
    2 * (a * c - w * b) * p + 2 * (b * c + w * a) * q + (1 - 2 * (a * a + b * b)) * r,
  ];
}

// The body in mm about the tracked point at contact, in space as seen along y.
function drawBody() {
  const contact = current().contacts[tracked.contact];
  if (!contact) return;
  const up = page.outline.length - 1, x = contact.pose[0], y = contact.pose[up], mm = 1000;
  const outline = page.outline[0].map((gap, k) => {
    const point = placed(contact.pose, page.outline.map(row => row[k]));
    return gap === null ? [null, null] : [mm * point[0], mm * point[up]];
  });
  const reach = 1.5 * Math.max(...outline.map(point => Math.hypot(...point)));
  const floor = a => mm * (page.floor.height - y) + Math.tan(page.floor.slope) * (a + mm * x);
  const {flights} = current(), [incoming, outgoing] = contact.before < 0 ? [] : [flights[contact.before], flights[contact.before + 1]];
  const path = (flight, name, ink) => ({
    type: "scatter", mode: "lines+markers", name, x: flight.line[0].map(a => mm * (a - x)), y: flight.line[up].map(b => mm * (b - y)), hoverinfo: "name",
    line: {color: color(ink), width: 2}, marker: {symbol: "arrow", angleref: "previous", size: flight.time.map((_, k, all) => k === all.length - 1 ? 13 : 0), color: color(ink)},
  });
  const ends = [-3 * reach, 3 * reach], lowest = Math.min(...outline.filter(point => point[1] !== null).map(point => point[1]));
  return draw("body", [
    {type: "scatter", mode: "lines", name: "Body", x: outline.map(point => point[0]), y: outline.map(point => point[1]), fill: up === 1 ? "toself" : "none", fillcolor: "rgba(128,140,155,0.22)", line: {color: color("muted"), width: 1.5}, hoverinfo: "skip"},
    {type: "scatter", mode: "lines", name: "Floor", x: ends, y: ends.map(floor), line: {color: color("text"), width: 3}, hoverinfo: "name"},
    ...(incoming ? [path(incoming, "Before", "accent")] : []), ...(outgoing ? [path(outgoing, "After", "red")] : []),
    {type: "scatter", mode: "markers", name: "Tracked point", x: [0], y: [0], hoverinfo: "name", marker: {size: 8, color: color("text")}},
  ], {
    showlegend: true, margin: {l: 50, r: 15, t: 10, b: 45}, xaxis: {title: {text: "From the tracked point at contact (mm)"}, range: [-2 * reach, 2 * reach], zeroline: false},
    yaxis: {title: {text: "Height above it (mm)"}, range: [lowest - 0.25 * reach, 1.6 * reach], scaleanchor: "x", zeroline: false},
    summary: `Contact ${contact.name}${up === 1 ? ` at θ = ${digits(contact.pose[2] * 180 / Math.PI)}°` : ""}; the body's lowest point is ${digits(lowest - floor(0))} mm above the floor.`,
  });
}

// A row of cells of text, the first one its head.
function rowOf(body, cells) {
  const row = body.insertRow(), head = document.createElement("th");
  head.scope = "row";
  head.append(cells[0]);
  row.append(head);
  for (const cell of cells.slice(1)) row.insertCell().textContent = cell;
  return row;
}

function showContact(number) {
  tracked.contact = number;
  document.querySelectorAll("#contacts button").forEach((button, k) => button.setAttribute("aria-pressed", k === number));
  redraw("track", "body");
}

function showRecording(number) {
  tracked.recording = number;
  const one = current(), bodies = ["contacts", "parts"].map(id => get(id).tBodies[0]);
  get("choice").value = number;
  get("summary").textContent = `${one.name}: ${one.summary}`;
  bodies.forEach(body => body.replaceChildren());
  one.contacts.forEach(({name, cells}, k) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = name;
    button.addEventListener("click", () => showContact(k));
    rowOf(bodies[0], [button, ...cells]);
  });
  for (const {reason, number: decided, time} of one.refused) rowOf(bodies[1], [reason, decided, ...time.map(value => digits(value, 5))]);
  get("with-contacts").hidden = !one.contacts.length;
  get("with-refused").hidden = !one.refused.length;
  for (const button of document.querySelectorAll(".sketch")) button.setAttribute("aria-current", Number(button.dataset.recording) === number);
  const place = listed().indexOf(number), count = listed().length;
  get("earlier").disabled = get("later").disabled = count < 2 && place >= 0;
  showContact(0);
}

// The choice is kept in the address.
function chooseRecording(number) {
  if (!listed().includes(number)) listRecordings("");
  history.replaceState(null, "", `#recording=${encodeURIComponent(page.recordings[number].name)}`);
  showRecording(number);
}

const listed = () => [...get("choice").options].map(option => Number(option.value));

function listRecordings(filter) {
  get("filter").value = filter;
  const shown = page.recordings.map((one, k) => [one, k]).filter(([one]) => !filter || (filter === "impacts" ? one.impacts : one.reasons.includes(filter)));
  get("choice").replaceChildren(...shown.map(([one, k]) => {
    const parts = one.reasons.filter(reason => reason !== "rest").map(reason => page.reasons[reason]);
    return new Option(`${one.name}: ${one.impacts} impact${one.impacts === 1 ? "" : "s"}${parts.length ? `; ${parts.join(", ")}` : ""}`, k);
  }));
  return shown.map(([, k]) => k);
}

function filterRecordings(filter) {
  const shown = listRecordings(filter);
  chooseRecording(shown.includes(tracked.recording) ? tracked.recording : shown[0]);
}

const step = by => {
  const list = listed();
  chooseRecording(list[(list.indexOf(tracked.recording) + by + list.length) % list.length]);
};

// The recording that the address names, or null.
function ofAddress() {
  if (!location.hash.startsWith("#recording=")) return null;
  try {
    const name = decodeURIComponent(location.hash.slice("#recording=".length)), place = page.recordings.findIndex(one => one.name === name);
    return place < 0 ? null : place;
  } catch { return null; }
}

function listenToChoices() {
  get("choice").addEventListener("change", event => chooseRecording(Number(event.target.value)));
  get("filter").addEventListener("change", event => filterRecordings(event.target.value));
  get("earlier").addEventListener("click", () => step(-1));
  get("later").addEventListener("click", () => step(1));
  const shown = () => { get("recording").scrollIntoView(); get("choice").focus({preventScroll: true}); };
  for (const button of document.querySelectorAll("[data-reason]")) button.addEventListener("click", () => { filterRecordings(button.dataset.reason); shown(); });
  for (const button of document.querySelectorAll(".sketch")) button.addEventListener("click", () => { chooseRecording(Number(button.dataset.recording)); shown(); });
  addEventListener("hashchange", () => { const place = ofAddress(); if (place !== null) chooseRecording(place); });
}

async function startRecordings() {
  if (!page.recordings.length) { document.documentElement.dataset.ready = "yes"; return; }
  const [block] = await Promise.all([unpacked("block"), library()]), errors = [...document.querySelectorAll("#errors li")];
  tracked.all = JSON.parse(new TextDecoder().decode(block));
  for (const id of Object.keys(drawn)) delete drawn[id];
  const summary = errors.map(item => item.textContent).join("; ");
  Object.assign(drawn, {track: drawTrack, body: drawBody, residuals: () => show("residuals", page.figures.residuals, {}, {summary})});
  listRecordings("");
  listen();
  listenToChoices();
  showRecording(ofAddress() ?? 0);
  attend();
}

startRecordings();
