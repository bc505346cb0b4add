// Every parameter as a control, grouped by part; app_parameters.rows made the value.
// Sends `input` with a name and a value, and `select` with the name of a parameter to hold or to let go.
const panel = element.querySelector(".parameters");
const PATIENCE_MS = 8000; // for the answer to an edit, after which the next is sent anyway
let newest = 0; // an answer that was overtaken by a later one is left out
let built = "", asked = 0, next = null; // when the edit was sent that is not answered yet, and the edit that follows it

function make(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

// One edit at a time: while one is being built, only the last value that each parameter was given waits.
function send(name, value, final) {
  if (next && next.name !== name) flush();
  next = { name, value, final };
  if (!asked) flush();
}

function flush() {
  if (!next) return;
  const edit = next;
  [next, asked] = [null, Date.now()];
  trigger("input", edit);
  setTimeout(() => { if (asked && Date.now() - asked >= PATIENCE_MS) answered(); }, PATIENCE_MS + 50);
}

function answered() {
  asked = 0;
  flush();
}

function slider(row) {
  const id = `p-${row.name}`;
  const range = make("input", { type: "range", id, name: row.name, min: row.low, max: row.high, step: "any" });
  const number = make("input", { type: "number", min: row.low, max: row.high, step: row.step, ariaLabel: `${row.label}, as a number` });
  range.step = row.step;
  range.addEventListener("input", () => { number.value = range.value; send(row.name, Number(range.value), false); });
  range.addEventListener("change", () => send(row.name, Number(range.value), true));
  number.addEventListener("change", () => send(row.name, Number(number.value), true));
  const track = make("div", { className: "track" }, make("i", { className: "band" }), range);
  return { control: [track], side: [number, make("small", { className: "unit", textContent: row.unit })] };
}

function menu(row) {
  const choice = make("select", { id: `p-${row.name}`, name: row.name });
  row.options.forEach((option, i) => choice.append(make("option", { value: i, textContent: option })));
  choice.addEventListener("change", () => send(row.name, row.values[choice.value], true));
  return { control: [], side: [choice, make("small", { className: "unit", textContent: row.unit })] };
}

function toggle(row) {
  const box = make("input", { type: "checkbox", id: `p-${row.name}`, name: row.name });
  box.setAttribute("role", "switch");
  box.addEventListener("change", () => send(row.name, box.checked, true));
  return { control: [], side: [box] };
}

const MAKERS = { real: slider, choice: menu, switch: toggle };

function control(row) {
  const { control, side } = MAKERS[row.kind](row);
  const hold = make("button", { type: "button", className: "hold", title: "Hold this value when estimating again" });
  hold.addEventListener("click", () => trigger("select", { name: row.name }));
  const label = make("label", { htmlFor: `p-${row.name}`, textContent: row.label, title: row.name });
  const head = make("div", { className: "head" }, label, make("em", { className: "unsure" }), ...side, hold);
  const made = make("div", { className: "row" }, head, ...control, make("p", { textContent: row.doc }));
  made.dataset.name = row.name;
  return made;
}

function group(part, first) {
  const title = make("summary", {}, make("span", { textContent: part.name }), make("small", { className: "count" }));
  return make("details", { open: first }, title, ...part.rows.map(control));
}

function set(row, made) {
  made.hidden = !row.active;
  if (next && next.name === row.name) return; // what the visitor has set meanwhile stays
  const field = made.querySelector(`[name="${CSS.escape(row.name)}"]`);
  if (row.kind === "switch") field.checked = row.value;
  else if (row.kind === "choice") field.value = String(row.index);
  else if (!field.matches(":active")) field.value = row.value;
  const number = made.querySelector("input[type=number]");
  if (number) number.value = Number(row.value).toFixed(row.digits);
  const band = made.querySelector(".band");
  if (band) Object.assign(band.style, { left: `${100 * row.band[0]}%`, width: `${100 * (row.band[1] - row.band[0])}%` });
  const unsure = made.querySelector(".unsure");
  Object.assign(unsure, { textContent: row.unsure, hidden: !row.unsure, title: row.unsure ? "The picture does not tell exactly" : "" });
  const hold = made.querySelector(".hold");
  hold.textContent = row.held ? "held" : "hold";
  hold.setAttribute("aria-pressed", String(row.held));
  hold.setAttribute("aria-label", `Hold ${row.label}`);
}

function show() {
  const { parts, version } = props.value || { parts: [], version: 0 };
  if (version < newest) return;
  newest = version;
  element.querySelector(".empty").hidden = parts.length > 0;
  const names = JSON.stringify(parts.map((part) => part.rows.map((row) => row.name)));
  if (names !== built) {
    panel.replaceChildren(...parts.map((part, i) => group(part, i === 0)));
    built = names;
  }
  parts.forEach((part, i) => {
    const details = panel.children[i], active = part.rows.filter((row) => row.active).length;
    details.hidden = active === 0;
    details.querySelector(".count").textContent = `${active}`;
    part.rows.forEach((row, j) => set(row, details.querySelectorAll(".row")[j]));
  });
}

watch("value", () => {
  show();
  answered();
});
show();
