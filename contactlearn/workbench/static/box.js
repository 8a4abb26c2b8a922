// The box of the map as numbers: the ends of the window along each axis, for the keyboard.
function showBox() {
  const place = get("box");
  if (!place || !trials) return;
  const wanted = `${trials.source} ${state.across} ${state.up}`;
  if (place.dataset.of !== wanted) {
    place.dataset.of = wanted;
    place.replaceChildren(...[state.across, state.up].map(boxEnds));
  }
  for (const input of place.querySelectorAll("input")) {
    if (input === document.activeElement) continue;  // while somebody writes
    const {variable, end, most} = input.dataset, value = page.windows?.find(one => one.variable === variable)?.[end];
    input.value = value === undefined || value === Number(most) ? "" : Number(value.toPrecision(4));
  }
}

// "v_x from … to …"; an end that is left empty is that of the data, and a key moves it by a twentieth of them.
function boxEnds(k) {
  const {name, label, values} = trials.variables[k], part = document.createElement("span");
  const ends = values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  const step = 10 ** Math.floor(Math.log10((ends[1] - ends[0]) / 10 || 1));
  const inputs = ["low", "high"].map((end, j) => {
    const input = document.createElement("input");
    Object.assign(input, {type: "number", step, placeholder: digits((j ? Math.ceil : Math.floor)(ends[j] / step) * step)});
    Object.assign(input.dataset, {variable: name, end, most: ends[j]});
    input.setAttribute("aria-label", `${label}, ${j ? "highest" : "lowest"}`);
    input.addEventListener("change", selectBox);
    return input;
  });
  part.append(`${label} from `, inputs[0], " to ", inputs[1]);
  return part;
}

function selectBox() {
  const inputs = [...get("box").querySelectorAll("input")];
  act("boxed", "", [inputs.slice(0, 2), inputs.slice(2)].filter(pair => pair.some(one => one.value !== "")).map(pair => {
    const [low, high] = pair.map(one => Number(one.value === "" ? one.dataset.most : one.value));
    return {variable: pair[0].dataset.variable, low: Math.min(low, high), high: Math.max(low, high)};
  }));
}
