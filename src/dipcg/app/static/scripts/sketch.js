// A sheet to draw on: dark lines on white, used as a picture.
import { find } from "./dom.js";
import { use } from "./picture.js";
import { say } from "./toast.js";

const EMPTY = "The sketch is empty: draw the outline and the main edges first.";
const canvas = find("#sheet"), pen = canvas.getContext("2d");
let last = null, strokes = [];

export function start({ limits }) {
  clear();
  canvas.addEventListener("pointerdown", begin);
  canvas.addEventListener("pointermove", line);
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (last = null));
  find("#use-sketch").addEventListener("click", () => finish(limits));
  find("#undo-stroke").addEventListener("click", () => {
    strokes = strokes.slice(0, -1);
    redraw();
  });
  find("#clear-sketch").addEventListener("click", clear);
}

function clear() {
  strokes = [];
  redraw();
}

function redraw() {
  pen.fillStyle = "#fff";
  pen.fillRect(0, 0, canvas.width, canvas.height);
  Object.assign(pen, { strokeStyle: "#222", lineWidth: 5, lineCap: "round", lineJoin: "round" });
  for (const stroke of strokes) stroke.forEach((point, i) => segment(stroke[Math.max(0, i - 1)], point));
}

function segment(from, to) {
  pen.beginPath();
  pen.moveTo(...from);
  pen.lineTo(...to);
  pen.stroke();
}

function begin(event) {
  canvas.setPointerCapture(event.pointerId);
  last = place(event);
  strokes = [...strokes, [last]];
  segment(last, last);
}

function line(event) {
  if (!last) return;
  const to = place(event);
  segment(last, to);
  strokes.at(-1).push(to);
  last = to;
}

function place({ clientX, clientY }) {
  const box = canvas.getBoundingClientRect();
  return [((clientX - box.left) / box.width) * canvas.width, ((clientY - box.top) / box.height) * canvas.height];
}

function finish(limits) {
  if (!strokes.length) return say(EMPTY, "wrong");
  canvas.toBlob((blob) => use(blob, limits), "image/png");
}
