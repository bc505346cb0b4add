// Strokes on the picture that say "this is the object" and "this is not"; points are shares of its sides.

const COLOURS = { foreground: "#16a34a", background: "#dc2626" };
// Of a stroke, as a share of the longer side. A point that lies nearer than this to the one before says nothing new.
const RADIUS = 0.008;
// The most pixels of a side of the sheet.
const MOST_PIXELS = 1024;

export class Strokes {
  /** `changed` is called with {foreground, background} after every stroke. */
  constructor(canvas, changed) {
    Object.assign(this, { canvas, changed, kind: "foreground", marks: [], stroke: null });
    canvas.addEventListener("pointerdown", (event) => this.begin(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => this.end());
  }

  open({ width, height }, { foreground = [], background = [] }) {
    const scale = Math.min(1, MOST_PIXELS / Math.max(width, height));
    Object.assign(this.canvas, { width: Math.round(scale * width), height: Math.round(scale * height) });
    const marks = (kind, strokes) => strokes.map(({ points }) => ({ kind, points }));
    this.marks = [...marks("foreground", foreground), ...marks("background", background)];
    this.draw();
  }

  begin(event) {
    if (!COLOURS[this.kind]) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.stroke = { kind: this.kind, points: [this.place(event)] };
    this.marks.push(this.stroke);
    this.draw();
  }

  move(event) {
    if (!this.stroke) return;
    const [x, y] = this.place(event), [lastX, lastY] = this.stroke.points.at(-1);
    if (Math.hypot(x - lastX, y - lastY) < RADIUS) return;
    this.stroke.points.push([x, y]);
    this.draw();
  }

  end() {
    if (this.stroke) this.told();
    this.stroke = null;
  }

  undo() {
    this.marks.pop();
    this.draw();
    this.told();
  }

  clear() {
    this.marks = [];
    this.draw();
    this.told();
  }

  told() {
    const of = (kind) => this.marks.filter((mark) => mark.kind === kind).map(({ points }) => ({ points, radius: RADIUS }));
    this.changed({ foreground: of("foreground"), background: of("background") });
  }

  place({ clientX, clientY }) {
    const box = this.canvas.getBoundingClientRect();
    const within = (share) => Number(Math.min(1, Math.max(0, share)).toFixed(4));
    return [within((clientX - box.left) / box.width), within((clientY - box.top) / box.height)];
  }

  draw() {
    const pen = this.canvas.getContext("2d"), { width, height } = this.canvas;
    const at = ([x, y]) => [x * width, y * height];
    pen.clearRect(0, 0, width, height);
    Object.assign(pen, { lineWidth: 2 * RADIUS * Math.max(width, height), lineCap: "round", lineJoin: "round" });
    for (const { kind, points } of this.marks) {
      pen.strokeStyle = COLOURS[kind];
      pen.beginPath();
      pen.moveTo(...at(points[0]));
      for (const point of points) pen.lineTo(...at(point));
      pen.stroke();
    }
  }
}
