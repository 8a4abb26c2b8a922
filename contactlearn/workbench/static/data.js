"use strict";
// The data of the page as the server sends them; the figures of the report, which come after, draw them.
let page = {models: [], fitted: [], effects: [], regions: [], switches: [{}], yardstick: 0, arrays: {}};
let trials = null;
let errors = [];  // of the law alone and of the model, by trial
const arrays = {};

const sizes = (D = trials.space.parts.length) => Object.entries({v_post: D, wrench: D, error: 1, parts: D});  // numbers of a trial
const outcomes = {};  // of the law alone and of the model, one trial after the other

const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
