"use strict";
// The data of the page: text and numbers in one element, large arrays in another.
const page = JSON.parse(document.getElementById("data").textContent);
const trials = page.trials;

async function unpacked(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), c => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

// An array of the block: at(i, j, …) is one number.
function view(block, {offset, shape, step}) {
  const numbers = new DataView(block);
  return (...index) => {
    const place = shape.reduce((sum, size, k) => sum * size + index[k], 0);
    const whole = numbers.getInt16(2 * (offset + place), true);
    return whole === -32768 ? NaN : whole * step[index.at(-1) % step.length];
  };
}

const arrays = {};
const errors = [];  // of each model that was looked at, by trial
