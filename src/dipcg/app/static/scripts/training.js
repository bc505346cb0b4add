// Your generator: a file is sent, its ranges are edited, it is learned, and then estimated with.
import * as api from "./api.js";
import { open } from "./ask.js";
import { find, make, percent, size } from "./dom.js";
import * as ranges from "./ranges.js";
import * as state from "./state.js";
import { announce, tell } from "./toast.js";

const STATES = {
  waiting: "Waits for the one before it", proposing: "Trying ranges", proposed: "Ready to be learned", learning: "Learning",
  stopping: "Stopping; what is learned is being kept", stopped: "Stopped; it goes on where it was", done: "Learned", failed: "Failed",
};
const WORKING = new Set(["waiting", "proposing", "learning", "stopping"]);
const CODE = {
  true: "Python files are taken too. They run with all rights of the server.",
  false: "Python files are refused, because they are programs. --allow-code FOLDER of dipcg serve allows them.",
};
let shown = null, leave = () => {};

export function start({ learns, takes_code: code, limits }, generators) {
  find("#own-closed").hidden = learns;
  find("#own-open").hidden = !learns;
  if (!learns) return;
  const kinds = code ? ".blend,.scad,.py" : ".blend,.scad";
  Object.assign(find("#source"), { accept: kinds });
  find("#source-kinds").textContent = `or press to choose one: ${kinds.replaceAll(",", ", ")}`;
  find("#code-note").textContent = CODE[code];
  find("#shapes").max = limits.shapes;
  find("#minutes").max = limits.minutes;
  find("#source").addEventListener("change", ({ target }) => (send(target.files[0], limits), (target.value = "")));
  const zone = find("#drop-source");
  for (const name of ["dragenter", "dragover"]) zone.addEventListener(name, (event) => (event.preventDefault(), zone.classList.add("over")));
  for (const name of ["dragleave", "drop"]) zone.addEventListener(name, () => zone.classList.remove("over"));
  zone.addEventListener("drop", (event) => (event.preventDefault(), send(event.dataTransfer.files[0], limits)));
  find("#trainings").addEventListener("change", ({ target }) => list(target.value));
  const wish = (place, event, work) => find(place).addEventListener(event, (one) => (one.preventDefault(), act(work)));
  wish("#ranges", "submit", () => api.setRanges(shown.id, ...ranges.edited()));
  wish("#learn", "submit", learn);
  wish("#stop-own", "click", () => api.stopTraining(shown.id));
  wish("#delete-own", "click", async () => (await api.deleteTraining(shown.id), (shown = null), served(generators)));
  find("#use-own").addEventListener("click", () => use(generators).catch(tell));
  list().catch(tell);
}

async function send(file, limits) {
  if (!file) return;
  await act(async () => {
    if (file.size > limits.source_bytes) throw new api.Problem(`A generator's file may have ${size(limits.source_bytes)}, this one has ${size(file.size)}.`);
    shown = await api.propose(file);
  });
}

function learn() {
  if (ranges.isEdited()) throw new api.Problem("You have edited ranges; try these first.");
  return api.learn(shown.id, find("#shapes").valueAsNumber, find("#minutes").valueAsNumber);
}

/** Ask the server for something, and show what became of it. */
async function act(work) {
  try {
    await work();
    await list(shown?.id);
  } catch (error) {
    tell(error);
  }
}

/** Show one of all trainings, and follow it while something is done for it. */
async function list(id) {
  const all = await api.trainings();
  const menu = find("#trainings");
  menu.replaceChildren(...all.map(({ id: value, name }) => make("option", { value, textContent: name.replaceAll("_", " ") })));
  menu.hidden = all.length < 2;
  leave();
  show(all.find((one) => one.id === id) ?? all.at(-1) ?? null);
  if (!shown) return;
  menu.value = shown.id;
  if (WORKING.has(shown.state)) leave = api.followTraining(shown.id, show, ({ state }) => announce(STATES[state]));
}

function show(training) {
  const before = shown;
  shown = training;
  find("#training").hidden = !training;
  if (!training) return;
  const { state: now, note, error, share } = training, working = WORKING.has(now);
  find("#training-note").textContent = error ?? (note || `${STATES[now]}.`) + (now === "learning" ? ` (${percent(share)})` : "");
  find("#training-note").classList.toggle("warning", Boolean(error));
  Object.assign(find("#training progress"), { value: share, hidden: !working });
  find("#samples").replaceChildren(...training.samples.map((url) => make("span", { className: "tile" }, make("img", { src: url, alt: "" }))));
  const same = before?.id === training.id && JSON.stringify(before.parameters) === JSON.stringify(training.parameters);
  if (!same || !find("#ranges .rows").children.length) ranges.show(training);
  const found = training.parameters.length > 0;
  find("#ranges").hidden = !found;
  find("#ranges").inert = working;
  find("#learn").hidden = working || !found;
  find("#learn button").textContent = { stopped: "Go on", done: "Learn more" }[now] ?? "Learn";
  find("#use-own").hidden = now !== "done";
  find("#stop-own").hidden = !working || now === "stopping";
}

/** The generators that are served now, in the list that all parts of the page share. */
async function served(generators) {
  generators.splice(0, generators.length, ...(await api.generators()));
  state.set(({ wanted }) => ({ wanted: generators.some(({ name }) => name === wanted) ? wanted : "" }));
}

async function use(generators) {
  await served(generators);
  state.set({ wanted: shown.name });
  open("picture");
}
