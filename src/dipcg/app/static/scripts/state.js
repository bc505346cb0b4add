// What the visitor has on the table: one plain object, kept over a reload; listeners hear of every change.
import { settled } from "./dom.js";

const KEY = "dipcg";
const EMPTY = {
  // The picture, words or nothing that the panel on the left holds: {picture: {id, width, height}, object} or {text}.
  asked: null,
  // The generator that the visitor named, or "" to have it recognised.
  wanted: "",
  // Results of estimates by a number of the page's own, as `open` and the steps to undo name them.
  results: {},
  // The asset on show: {generator, params, first, result, chosen, held, view, opened}.
  open: null,
  before: [],
  after: [],
  // The parameter whose slider is being dragged: one drag is one step to undo.
  moving: "",
  // The estimate that is under way: {id, result, seen}.
  job: null,
  // How the viewer colours the asset, and the choices of the download.
  colours: "photo",
  download: { format: ".glb", detail: "standard", faces: "", texture: "" },
  // Which parts of the parameters are folded open, by generator and part.
  unfolded: {},
};

let state = { ...EMPTY, ...restored() };
const listeners = new Set();
const keep = settled(() => {
  try {
    sessionStorage.setItem(KEY, JSON.stringify(state));
  } catch {
    // A browser that keeps nothing, or has no room, still works until the reload.
  }
}, 150);

export const get = () => state;

/** Change some entries; `change` is an object, or a function of the state that returns one. */
export function set(change) {
  const before = state;
  state = { ...state, ...(typeof change === "function" ? change(state) : change) };
  for (const listener of listeners) listener(state, before);
  keep();
}

/** Call `listener(state, before)` after every change, and once now with an empty state before. */
export function listen(listener) {
  listeners.add(listener);
  listener(state, EMPTY);
}

function restored() {
  try {
    return JSON.parse(sessionStorage.getItem(KEY)) ?? {};
  } catch {
    return {};
  }
}
