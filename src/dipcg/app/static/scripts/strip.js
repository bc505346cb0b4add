// The candidates, each from its estimated camera, beside the picture as the model saw it.
import * as api from "./api.js";
import { find, make, percent } from "./dom.js";
import * as state from "./state.js";
import { opened } from "./work.js";

export function start() {
  state.listen((now, before) => {
    const result = now.results[now.open?.result];
    if (result !== before.results[before.open?.result]) fill(result, now.open);
    mark(now.open);
  });
}

/** The best guess comes first; the others follow by how well they match the picture. */
function order({ candidates, ranked }) {
  const numbers = [...candidates.keys()];
  if (!ranked) return numbers;
  return [0, ...numbers.slice(1).sort((one, other) => (candidates[other].agreement ?? 0) - (candidates[one].agreement ?? 0))];
}

function fill(result, open) {
  find("#candidates-part").hidden = !result;
  if (!result) return find("#candidates").replaceChildren();
  const picture = result.picture && make("div", { className: "tile photo" }, image(api.pictureUrl(result.picture), "What the model sees"), make("span", { textContent: "Your picture" }));
  find("#candidates").replaceChildren(...[picture, ...order(result).map((number, place) => tile(result, number, place, open))].filter(Boolean));
  find("#candidates-note").textContent = note(result);
  find("#doubt").textContent = result.doubt ?? "";
}

function tile(result, number, place) {
  const { thumbnail, agreement } = result.candidates[number];
  const words = place === 0 ? "Best guess" : agreement ? `${percent(agreement)} match` : `Candidate ${place + 1}`;
  const picture = thumbnail ? image(thumbnail, "") : make("i", { className: "blank" });
  const button = make("button", { type: "button", className: "tile", data: { number } }, picture, make("span", { textContent: words }));
  button.setAttribute("aria-label", `Candidate ${place + 1}: ${words}`);
  button.addEventListener("click", () => state.set((now) => pick(now, number)));
  return button;
}

function pick(now, number) {
  const step = opened(now, now.open.result, number, now.open.held);
  return { ...step, open: { ...step.open, picked: true } };
}

/** A picture that leaves its place empty once the server has forgotten it. */
function image(src, alt) {
  const made = make("img", { src, alt });
  made.addEventListener("error", () => made.replaceWith(make("i", { className: "blank" })));
  return made;
}

function note({ candidates, ranked, picture }) {
  const count = candidates.length;
  if (count === 1) return ranked ? "All candidates are alike." : "The best guess; others follow.";
  if (!ranked) return `${count} candidates; they are being compared with your picture.`;
  const rule = picture ? "the best guess first, then by how well they match the picture" : "the one that fits your words best first";
  return `${count} different candidates, ${rule}.`;
}

function mark(open) {
  for (const button of find("#candidates").querySelectorAll("button")) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.number) === open?.chosen));
  }
}
