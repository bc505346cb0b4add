// One sentence for the visitor at the foot of the page; screen readers speak it.
import { Problem } from "./api.js";
import { find, make } from "./dom.js";

const SHOWN_MS = 9000;

/** Show what went wrong; an error that is none of ours is a fault of the page, and the console has all of it. */
export function tell(error) {
  if (!(error instanceof Problem)) console.error(error);
  say(error.message, "wrong");
}

/** Show a sentence until it is read or closed. */
export function say(sentence, kind = "") {
  const shown = find("#toasts");
  const close = make("button", { type: "button", textContent: "×", "aria-label": "Close this message" });
  const toast = make("div", { className: `toast ${kind}` }, make("p", { textContent: sentence }), close);
  close.addEventListener("click", () => toast.remove());
  for (const same of shown.children) if (same.textContent === toast.textContent) same.remove();
  shown.append(toast);
  setTimeout(() => toast.remove(), SHOWN_MS);
}

/** A sentence for screen readers alone, such as that a result is there. */
export function announce(sentence) {
  find("#spoken").textContent = sentence;
}
