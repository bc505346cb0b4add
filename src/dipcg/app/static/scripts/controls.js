// A control for one parameter: a slider with a number, a menu, or a switch. What it is set to becomes an edit.
import { capital, make } from "./dom.js";
import { grain, isSwitch, shortUnit } from "./space.js";
import * as state from "./state.js";
import { edited } from "./work.js";

const edit = (name, value, final) => state.set((now) => edited(now, name, value, final));

/** The elements beside the label of a parameter, and those below it. */
export function control(parameter) {
  if (isSwitch(parameter)) return toggle(parameter);
  return parameter.kind === "choice" ? menu(parameter) : slider(parameter);
}

const unit = (parameter) => make("small", { className: "unit", textContent: shortUnit(parameter) });
const named = ({ name }) => ({ id: `p-${name}`, name, className: "field" });

function slider(parameter) {
  const { name, label, low, high } = parameter, { step, digits } = grain(parameter);
  const range = make("input", { ...named(parameter), type: "range", min: low, max: high });
  const number = make("input", { type: "number", min: low, max: high, step, "aria-label": `${capital(label)} as a number` });
  // The step is set after the ends, so that the browser does not move them; "any" keeps every digit of a value.
  range.step = "any";
  const rounded = () => Number(Number(range.value).toFixed(digits));
  range.addEventListener("input", () => edit(name, rounded(), false));
  range.addEventListener("change", () => edit(name, rounded(), true));
  range.addEventListener("keydown", (event) => press(event, range, step));
  number.addEventListener("change", () => typed(number, parameter, digits));
  const track = make("div", { className: "track" }, make("i", { className: "band" }), range);
  return { beside: [make("span", { className: "number" }, number, unit(parameter))], below: [track] };
}

/** Arrow keys move by one step; a slider without steps of its own would move by a hundredth of its length. */
function press(event, range, step) {
  const moves = { ArrowRight: step, ArrowUp: step, ArrowLeft: -step, ArrowDown: -step };
  if (!(event.key in moves)) return;
  event.preventDefault();
  range.value = Number(range.value) + moves[event.key] * (event.shiftKey ? 10 : 1);
  range.dispatchEvent(new Event("change"));
}

/** A number that was typed is brought between the ends; what is no number is left out. */
function typed(number, { name, low, high }, digits) {
  const given = number.value !== "", before = state.get().open.params[name];
  const value = given ? Math.min(high, Math.max(low, Number(number.value))) : before;
  number.value = value.toFixed(digits);
  edit(name, value, true);
}

function menu(parameter) {
  const { name, options } = parameter;
  const choice = make("select", named(parameter), ...options.map((option) => make("option", { textContent: option.label })));
  choice.addEventListener("change", () => edit(name, options[choice.selectedIndex].value, true));
  return { beside: [choice], below: [] };
}

function toggle(parameter) {
  const box = make("input", { ...named(parameter), type: "checkbox", role: "switch" });
  box.addEventListener("change", () => edit(parameter.name, box.checked, true));
  return { beside: [box], below: [] };
}
