// The ranges of a generator that is learned: each parameter with its limits, and whether it is held as in the file.
import { find, make } from "./dom.js";

let parameters = [], sent = "";

export function show(training) {
  parameters = training.parameters;
  find("#ranges .rows").replaceChildren(...parameters.map(row));
  const left = Object.entries(training.left_out).map(([name, why]) => `${name}: ${why}`);
  find("#ranges .left-out").textContent = [...training.notes, left.length ? `Left out: ${left.join("; ")}.` : ""].filter(Boolean).join(" ");
  sent = JSON.stringify(edited());
}

/** Whether something was edited and not sent yet. */
export const isEdited = () => JSON.stringify(edited()) !== sent;

/** The edited ranges by name, and the names of parameters that are held, as the API takes them. */
export function edited() {
  const rows = parameters.map((one) => [one, find(`#ranges [data-range="${CSS.escape(one.name)}"]`)]);
  const held = ([, place]) => !find("[type=checkbox]", place).checked;
  const ends = ([, place]) => [...place.querySelectorAll("[type=number]")].map(({ valueAsNumber }) => valueAsNumber);
  const changed = rows.filter((one) => one[0].low !== null && !held(one) && String(ends(one)) !== String([one[0].low, one[0].high]));
  // Edits of before that are still wanted are sent again, since all are sent at once.
  const before = rows.filter((one) => one[0].edited && !held(one) && !changed.includes(one));
  return [Object.fromEntries([...changed, ...before].map((one) => [one[0].name, ends(one)])), rows.filter(held).map(([{ name }]) => name)];
}

function row(parameter) {
  const { name, value, unit, why, doc, options, held } = parameter;
  const used = make("input", { type: "checkbox", checked: !held, id: `use-${name}` });
  const words = make("label", { htmlFor: used.id, textContent: name.replaceAll("_", " "), title: `${doc}; ${value} ${unit} in the file` });
  const ends = parameter.low === null ? [make("span", { className: "unit", textContent: options.map(said).join(", ") })] : numbers(parameter);
  const made = make("div", { className: "range", data: { range: name } }, make("div", { className: "head" }, used, words), make("div", { className: "ends" }, ...ends));
  if (why) made.append(make("p", { className: "note", textContent: why }));
  used.addEventListener("change", () => made.classList.toggle("held", !used.checked));
  made.classList.toggle("held", held);
  return made;
}

function numbers({ name, low, high, lowest, highest, unit }) {
  const limits = { min: lowest ?? undefined, max: highest ?? undefined, step: "any", required: true, inputMode: "decimal" };
  const end = (value, label) => make("input", { type: "number", ...limits, value: Number(value.toPrecision(7)), "aria-label": `${label} ${name}` });
  return [end(low, "Lowest"), make("span", { textContent: "to" }), end(high, "Highest"), make("span", { className: "unit", textContent: unit })];
}

const said = (option) => ({ true: "yes", false: "no" })[option] ?? String(option);
