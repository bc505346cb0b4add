// A rectangle on the picture whose corners can be dragged, or moved with the arrow keys: what is kept of the picture.
import { find, make } from "./dom.js";

// The least that is left of a side, and how far a key moves a corner.
const LEAST = 0.08, KEY = 0.02;
const WHOLE = { left: 0, right: 0, top: 0, bottom: 0 };
const OPPOSITE = { left: "right", right: "left", top: "bottom", bottom: "top" };
const CORNERS = [["left", "top"], ["right", "top"], ["left", "bottom"], ["right", "bottom"]];

export class Crop {
  /** `changed` is called with what is cut away at each side, as shares of the picture. */
  constructor(element, changed) {
    Object.assign(this, { element, changed, sides: { ...WHOLE } });
    this.frame = find(".frame", element);
    for (const corner of CORNERS) this.frame.append(this.handle(corner));
    this.drag(this.frame, (by) => this.shift(by));
  }

  open(sides = WHOLE) {
    this.sides = { ...WHOLE, ...sides };
    this.draw();
  }

  handle([across, along]) {
    const made = make("button", { type: "button", className: `corner ${across} ${along}`, "aria-label": `Corner at the ${along} ${across} of the crop; arrow keys move it` });
    const move = ([x, y]) => this.set({ [across]: this.sides[across] + (across === "left" ? x : -x), [along]: this.sides[along] + (along === "top" ? y : -y) });
    this.drag(made, move);
    made.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-KEY, 0], ArrowRight: [KEY, 0], ArrowUp: [0, -KEY], ArrowDown: [0, KEY] }[event.key];
      if (!by) return;
      event.preventDefault();
      move(by);
      this.changed(this.sides);
    });
    return made;
  }

  /** Calls `move` with the way of a pointer as shares of the picture. */
  drag(element, move) {
    let from = null;
    element.addEventListener("pointerdown", (event) => {
      if (event.target !== element) return;
      element.setPointerCapture(event.pointerId);
      from = event;
    });
    element.addEventListener("pointermove", (event) => {
      if (!from) return;
      const box = this.element.getBoundingClientRect();
      move([(event.clientX - from.clientX) / box.width, (event.clientY - from.clientY) / box.height]);
      from = event;
    });
    for (const name of ["pointerup", "pointercancel"]) {
      element.addEventListener(name, () => {
        if (from) this.changed(this.sides);
        from = null;
      });
    }
  }

  /** Move the whole rectangle as far as the picture allows. */
  shift([x, y]) {
    const { left, right, top, bottom } = this.sides;
    const across = Math.min(right, Math.max(-left, x)), down = Math.min(bottom, Math.max(-top, y));
    this.set({ left: left + across, right: right - across, top: top + down, bottom: bottom - down });
  }

  set(sides) {
    for (const [side, share] of Object.entries(sides)) {
      this.sides[side] = Math.max(0, Math.min(share, 1 - LEAST - (sides[OPPOSITE[side]] ?? this.sides[OPPOSITE[side]])));
    }
    this.draw();
  }

  draw() {
    for (const [side, share] of Object.entries(this.sides)) this.frame.style[side] = `${100 * share}%`;
  }
}
