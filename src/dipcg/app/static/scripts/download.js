// The file of the open asset: its size is shown before it is saved, and the command that makes it again.
import * as api from "./api.js";
import { capital, find, make, settled, size } from "./dom.js";
import { look, photoColours } from "./looks.js";
import { command } from "./space.js";
import * as state from "./state.js";
import { announce, say, tell } from "./toast.js";

// So long after the last change the file is made, ready to be saved. Texture maps take long and are made when asked for.
const SETTLED_MS = 900;
const NOTHING = "There is nothing to download yet: add a picture, or press Random.";
// Sides of texture maps, in pixels.
const SIDES = [512, 1024, 2048];
const FIELDS = ["format", "detail", "faces", "texture"];
let ready = { key: "", result: null }, making = null;

export function start({ formats, textures, details, limits }, generators) {
  menu("#format", formats.map((value) => [value, value.slice(1).toUpperCase()]));
  menu("#detail", details.map((value) => [value, capital(value)]));
  if (!details.includes(state.get().download.detail)) state.set((now) => ({ download: { ...now.download, detail: details[0] } }));
  menu("#texture", [["", "None"], ...SIDES.filter((side) => side <= limits.texture).map((side) => [side, `${side} px`])]);
  find("#faces").max = limits.faces;
  for (const name of FIELDS) find(`#${name}`).addEventListener("change", ({ target }) => choose(name, target));
  find("#download").addEventListener("click", save);
  find("#copy").addEventListener("click", copy);
  const soon = settled(prepare, SETTLED_MS);
  state.listen((now, before) => {
    for (const name of FIELDS) find(`#${name}`).value = now.download[name];
    const { format } = now.download;
    find("#detail").disabled = find("#faces").disabled = format === ".json";
    find("#texture").disabled = !textures.includes(format);
    if (now.open?.params === before.open?.params && now.download === before.download && now.colours === before.colours) return;
    find("#command").textContent = now.open ? command(generators.find(({ name }) => name === now.open.generator), request()) : "";
    find("#file-size").textContent = "";
    if (now.open && !request().texture) soon();
  });
}

function menu(id, options) {
  find(id).replaceChildren(...options.map(([value, textContent]) => make("option", { value, textContent })));
}

function choose(name, field) {
  if (!field.checkValidity()) return say(`The number of triangles lies between ${field.min} and ${field.max}.`, "wrong");
  return state.set((now) => ({ download: { ...now.download, [name]: field.value } }));
}

function request() {
  const now = state.get(), { open, download: { format, detail, faces, texture } } = now;
  const wanted = { generator: open.generator, params: open.params, format, detail };
  if (faces && !find("#faces").disabled) wanted.faces = Number(faces);
  if (texture && !find("#texture").disabled) wanted.texture = Number(texture);
  if (look(now) === "photo") wanted.colours = photoColours(now);
  return wanted;
}

/** The file of what is open now, made once; a file that is no longer wanted is called off. */
function prepare() {
  const wanted = request(), key = JSON.stringify(wanted);
  if (ready.key === key) return Promise.resolve(show(ready.result));
  if (making?.key === key) return making.result;
  making?.stop.abort();
  const stop = new AbortController();
  making = { key, stop, result: made(wanted, key, stop.signal) };
  return making.result;
}

async function made(wanted, key, signal) {
  find("#file-size").textContent = "Preparing the file …";
  try {
    const result = await api.follow(await api.startAsset(wanted), () => {}, signal);
    ready = { key, result };
    return show(result);
  } catch (error) {
    find("#file-size").textContent = "";
    if (!api.calledOff(error)) tell(error);
    return null;
  } finally {
    if (making?.key === key) making = null;
  }
}

function show(result) {
  const triangles = result.triangles ? `${result.triangles.toLocaleString("en")} triangles · ` : "";
  find("#file-size").textContent = triangles + size(result.bytes);
  return result;
}

async function save() {
  if (!state.get().open) return say(NOTHING, "wrong");
  const button = find("#download");
  button.classList.add("busy");
  try {
    const result = await prepare();
    if (result) await store(result);
  } catch (error) {
    // The server forgets a file after an hour; the next press makes it again.
    ready = { key: "", result: null };
    tell(error);
  } finally {
    button.classList.remove("busy");
  }
}

async function store({ file, name }) {
  const href = URL.createObjectURL(await api.bytes(file));
  make("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60_000);
}

function copy() {
  // Selecting helps on pages without the clipboard, which are those not served from this machine or over HTTPS.
  getSelection().selectAllChildren(find("#command"));
  navigator.clipboard?.writeText(find("#command").textContent).then(() => announce("The command is copied."), () => {});
}
