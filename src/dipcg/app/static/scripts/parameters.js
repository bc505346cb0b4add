// Every parameter of the open asset as a control, grouped by part, with what the picture leaves open.
import { capital, find, icon, make } from "./dom.js";
import { control } from "./controls.js";
import { again } from "./estimating.js";
import { band, doubt, grain, isActive, parts, shortUnit, spelt } from "./space.js";
import * as state from "./state.js";
import { drawn, held, redone, reset, undone } from "./work.js";

const panel = find("#parameters .parts");
const wide = matchMedia("(min-width: 700px)");

export function start(generators) {
  const spaceOf = (name) => generators.find((one) => one.name === name);
  for (const [id, does] of [["#undo", undone], ["#redo", redone], ["#reset", reset]]) {
    find(id).addEventListener("click", () => state.set(does));
  }
  find("#random").addEventListener("click", () => state.set((now) => drawn(now, spaceOf(now.open?.generator || now.wanted) ?? generators[0])));
  find("#again").addEventListener("click", again);
  addEventListener("keydown", keys);
  state.listen((now, before) => {
    const space = spaceOf(now.open?.generator);
    if (now.open?.generator !== before.open?.generator) build(space, now);
    if (space && (now.open !== before.open || now.results !== before.results)) fill(space, now);
    find("#undo").disabled = !now.before.length;
    find("#redo").disabled = !now.after.length;
    find("#reset").disabled = !now.open || now.open.params === now.open.first;
    find("#again").disabled = !now.open || !(now.results[now.open.result] ?? now.asked);
  });
}

function keys(event) {
  if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || event.target.matches("textarea, input[type=number]")) return;
  event.preventDefault();
  state.set(event.shiftKey ? redone : undone);
}

function build(space, { unfolded }) {
  find("#parameters .empty").hidden = Boolean(space);
  find("#edits").hidden = false;
  panel.replaceChildren(...(space ? parts(space.parameters).map((part, number) => group(space, part, number, unfolded)) : []));
}

/** A part that folds; the page remembers which ones are open. On a phone all are folded at first. */
function group({ name: generator }, [name, parameters], number, unfolded) {
  const key = `${generator}/${name}`;
  const title = make("summary", {}, make("span", { textContent: capital(name.replaceAll("_", " ")) }), make("small", { className: "count" }));
  const made = make("details", { open: unfolded[key] ?? (wide.matches && number === 0), className: "part" }, title, ...parameters.map(row));
  made.addEventListener("toggle", () => state.set((now) => ({ unfolded: { ...now.unfolded, [key]: made.open } })));
  return made;
}

function row(parameter) {
  const hold = make("button", { type: "button", className: "hold", title: "Hold this value in the next estimate" }, icon("open"), icon("closed"));
  hold.setAttribute("aria-label", `Hold ${parameter.label}`);
  hold.addEventListener("click", () => state.set((now) => held(now, parameter.name)));
  const made = control(parameter);
  const label = make("label", { htmlFor: `p-${parameter.name}`, textContent: capital(parameter.label) });
  const unsure = make("em", { className: "unsure", title: "The picture leaves this open" });
  const told = parameter.doc === parameter.label ? "" : parameter.doc;
  const doc = [told, shortUnit(parameter) ? "" : parameter.unit].filter(Boolean).join(" · ");
  const head = make("div", { className: "head" }, label, unsure, ...made.beside, hold);
  const line = doc ? make("p", { className: "doc", textContent: doc, title: doc }) : null;
  return make("div", { className: "row", data: { name: parameter.name } }, head, line, ...made.below);
}

function fill(space, { open, results, moving }) {
  const sure = results[open.result] ?? {};
  for (const part of panel.children) {
    const rows = [...part.querySelectorAll(".row")];
    for (const made of rows) {
      const parameter = space.parameters.find(({ name }) => name === made.dataset.name);
      made.hidden = !isActive(space.parameters, parameter.name, open.params);
      value(made, parameter, open, sure, moving);
    }
    const active = rows.filter((made) => !made.hidden).length;
    part.hidden = !active;
    find(".count", part).textContent = active;
  }
}

function value(made, parameter, { params, held: kept }, sure, moving) {
  const { name, kind, options } = parameter, now = params[name], isHeld = kept.includes(name);
  const field = find(".field", made), number = find("input[type=number]", made);
  const known = isHeld ? {} : sure;
  if (field.type === "checkbox") field.checked = now;
  else if (kind === "choice") menu(field, options, now, known.probabilities?.[name]);
  else if (moving !== name || !field.matches(":active")) field.value = now;
  if (number && !number.matches(":focus")) number.value = Number(now).toFixed(grain(parameter).digits);
  if (number) stretch(find(".band", made), band(parameter, now, known.spread?.[name] ?? 0));
  const unsure = doubt(parameter, now, known);
  find(".unsure", made).textContent = unsure;
  made.classList.toggle("doubtful", Boolean(unsure));
  find(".hold", made).setAttribute("aria-pressed", String(isHeld));
}

/** The options with the probabilities of the result that is open. */
function menu(field, options, now, chances) {
  options.forEach(({ value, label }, place) => {
    const chance = chances?.[spelt(value)];
    field.options[place].textContent = chance === undefined ? label : `${label} · ${Math.round(100 * chance)} %`;
  });
  field.selectedIndex = options.findIndex(({ value }) => value === now);
}

function stretch(made, [low, high]) {
  made.style.left = `${100 * low}%`;
  made.style.width = `${100 * (high - low)}%`;
}
