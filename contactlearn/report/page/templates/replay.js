// Replays: the recorded body and the predicted ones at one time, with a slider.
const replayed = {recording: 0, frame: 0, all: [], timer: 0};
const track = () => replayed.all[replayed.recording];
const inks = ["text", "accent", "red", "muted"];

function drawBodies() {
  const {poses, time} = track(), names = ["Recorded", ...page.models], k = replayed.frame;
  const reach = Math.max(...page.outline.flat().map(Math.abs)), all = axis => poses.flatMap(one => one[axis]);
  const traces = poses.flatMap(([x, y, theta], place) => {
    const [c, s] = [Math.cos(theta[k]), Math.sin(theta[k])], ink = color(inks[place % inks.length]), [a, b] = page.outline;
    const line = {color: ink, width: place ? 1.5 : 2.5};
    return [
      {type: "scatter", mode: "lines", x: x.slice(0, k + 1), y: y.slice(0, k + 1), line: {...line, width: 1, dash: "dot"}, hoverinfo: "skip", showlegend: false},
      {type: "scatter", mode: "lines", name: plain(names[place]), x: a.map((one, i) => x[k] + c * one - s * b[i]), y: a.map((one, i) => y[k] + s * one + c * b[i]), line, hoverinfo: "name"},
    ];
  });
  const across = [Math.min(...all(0)) - 1.2 * reach, Math.max(...all(0)) + 1.2 * reach];
  traces.push({type: "scatter", mode: "lines", name: "Floor", x: across, y: [0, 0], line: {color: color("text"), width: 3}, hoverinfo: "name"});
  return draw("bodies", traces, {
    showlegend: true, xaxis: {title: {text: "x (mm)"}, range: across, zeroline: false},
    yaxis: {title: {text: "Height (mm)"}, range: [-0.3 * reach, Math.max(...all(1)) + 1.2 * reach], scaleanchor: "x", zeroline: false},
    uirevision: track().name, summary: `Recording ${track().name} at ${digits(time[k], 3)} s: ${poses.map(([x, y], place) => `${names[place]} at ${digits(x[k])}, ${digits(y[k])} mm`).join("; ")}.`,
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
  showReplay(0);
  attend();
}

startReplay();
