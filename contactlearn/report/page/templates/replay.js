// Replays: the recorded body and the predicted ones at one time, with a slider.
const replayed = {recording: 0, frame: 0, all: [], timer: 0, view: 0.6}, above = 0.4;
const track = () => replayed.all[replayed.recording];
const inks = ["text", "accent", "red", "muted"];

// Points in the plane of the figure; in space as seen from a direction, from above by a little.
function flat([x, y, z]) {
  if (!z) return [x, y];
  const [c, s] = [Math.cos(replayed.view), Math.sin(replayed.view)], [up, down] = [Math.cos(above), Math.sin(above)];
  const there = (one, value) => one === null ? null : value;  // but in the gaps of an outline
  return [x.map((one, i) => there(one, c * one - s * y[i])), z.map((one, i) => there(one, up * one + down * (s * x[i] + c * y[i])))];
}

// The outline of a body at a frame, in the world.
function placed(pose, k) {
  if (pose.length === 3) {
    const [x, y, theta] = pose.map(one => one[k]), [c, s] = [Math.cos(theta), Math.sin(theta)], [a, b] = page.outline;
    return [a.map((one, i) => x + c * one - s * b[i]), a.map((one, i) => y + s * one + c * b[i])];
  }
  const [x, y, z, w, i, j, l] = pose.map(one => one[k]);
  const rows = [
    [1 - 2 * (j * j + l * l), 2 * (i * j - w * l), 2 * (i * l + w * j)],
    [2 * (i * j + w * l), 1 - 2 * (i * i + l * l), 2 * (j * l - w * i)],
    [2 * (i * l - w * j), 2 * (j * l + w * i), 1 - 2 * (i * i + j * j)],
  ];
  const [a, b, d] = page.outline;
  return [x, y, z].map((at, row) => a.map((one, n) => one === null ? null : at + rows[row][0] * one + rows[row][1] * b[n] + rows[row][2] * d[n]));
}

function drawBodies() {
  const {poses, time} = track(), names = ["Recorded", ...page.models], k = replayed.frame, d = page.outline.length;
  const reach = Math.max(...page.outline.flat().map(Math.abs)), paths = poses.map(one => one.slice(0, d));
  const span = axis => { const all = paths.flatMap(one => one[axis]); return [Math.min(...all) - 1.2 * reach, Math.max(...all) + 1.2 * reach]; };
  const ends = paths[0].map((_, axis) => span(axis)), [left, right] = ends[0];
  const ground = d === 2 ? [[left, right], [0, 0]] : [[left, right, right, left, left], [ends[1][0], ends[1][0], ends[1][1], ends[1][1], ends[1][0]], [0, 0, 0, 0, 0]];
  const floor = flat(ground), all = [floor, ...paths.map(flat)], line = {color: color("text"), width: d === 2 ? 3 : 1};
  const traces = [{type: "scatter", mode: "lines", name: "Floor", x: floor[0], y: floor[1], line, hoverinfo: "name"}];
  track().fan.forEach((fan, place) => fan.forEach(path => {
    const [x, y] = flat(path);
    traces.push({type: "scatter", mode: "lines", x, y, line: {color: `${color(inks[(page.fans[place] + 1) % inks.length])}55`, width: 1}, hoverinfo: "skip", showlegend: false});
  }));
  poses.forEach((pose, place) => {
    const ink = {color: color(inks[place % inks.length]), width: place ? 1.5 : 2.5}, [x, y] = flat(paths[place]), [a, b] = flat(placed(pose, k));
    traces.push(
      {type: "scatter", mode: "lines", x: x.slice(0, k + 1), y: y.slice(0, k + 1), line: {...ink, width: 1, dash: "dot"}, hoverinfo: "skip", showlegend: false},
      {type: "scatter", mode: "lines", name: plain(names[place]), x: a, y: b, line: ink, hoverinfo: "name"},
    );
  });
  const low = Math.min(...all.flatMap(one => one[1])) - 0.3 * reach, high = Math.max(...all.flatMap(one => one[1])) + 1.2 * reach;
  return draw("bodies", traces, {
    showlegend: true, xaxis: {title: {text: d === 2 ? "x (mm)" : "Across the view (mm)"}, range: d === 2 ? ends[0] : undefined, zeroline: false},
    yaxis: {title: {text: d === 2 ? "Height (mm)" : "Height and depth (mm)"}, range: [low, high], scaleanchor: "x", zeroline: false},
    uirevision: track().name, summary: `Recording ${track().name} at ${digits(time[k], 3)} s: ${paths.map((one, place) => `${names[place]} at ${one.map(at => digits(at[k])).join(", ")} mm`).join("; ")}.`,
  });
}

function showFrame(frame) {
  replayed.frame = frame;
  get("when").value = frame;
  get("now").textContent = `${track().time[frame].toFixed(3)} s`;
  redraw("bodies");
}

function showReplay(number) {
  stop();
  replayed.recording = number;
  get("when").max = track().time.length - 1;
  showFrame(0);
}

function stop() {
  clearInterval(replayed.timer);
  replayed.timer = 0;
  get("play").textContent = "Play";
}

function play() {
  if (replayed.timer) return stop();
  if (replayed.frame === track().time.length - 1) showFrame(0);
  get("play").textContent = "Stop";
  const stride = Math.max(1, Math.round(track().time.length / 200));
  replayed.timer = setInterval(() => {
    const next = Math.min(replayed.frame + stride, track().time.length - 1);
    showFrame(next);
    if (next === track().time.length - 1) stop();
  }, 50);
}

async function startReplay() {
  const [block] = await Promise.all([unpacked("block"), library()]);
  replayed.all = JSON.parse(new TextDecoder().decode(block));
  for (const id of Object.keys(drawn)) delete drawn[id];
  Object.assign(drawn, {errors: () => show("errors", page.figures.errors), bodies: drawBodies});
  listen();
  get("choice").addEventListener("change", event => showReplay(Number(event.target.value)));
  get("when").addEventListener("input", event => { stop(); showFrame(Number(event.target.value)); });
  get("play").addEventListener("click", play);
  get("view").addEventListener("input", event => { replayed.view = event.target.value * Math.PI / 180; redraw("bodies"); });
  showReplay(0);
  attend();
}

startReplay();
