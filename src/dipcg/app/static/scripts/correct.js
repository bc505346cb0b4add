// The dialog that corrects the cut-out: what is the object and what is not, a crop, and how it is cut.
import * as api from "./api.js";
import { Crop } from "./crop.js";
import { find, settled } from "./dom.js";
import { look } from "./picture.js";
import * as state from "./state.js";
import { Strokes } from "./strokes.js";
import { tell } from "./toast.js";

const dialog = find("#correct"), stage = find("#stage");
// The corrections that are being made, as the API takes them.
let object = {}, stop = null, crop = null, strokes = null;

export function start() {
  crop = new Crop(find("#crop"), (sides) => change({ crop: sides }));
  strokes = new Strokes(find("#strokes"), (marks) => change(marks));
  find("#open-correct").addEventListener("click", open);
  find("#use-cut").addEventListener("click", use);
  find("#undo-mark").addEventListener("click", () => strokes.undo());
  find("#clear-marks").addEventListener("click", clear);
  for (const tool of document.querySelectorAll("#tools input")) tool.addEventListener("change", () => pick(tool.value));
  find("#how").addEventListener("change", ({ target }) => change({ how: target.value }));
  find("#difference").addEventListener("input", ({ target }) => change({ difference: Number(target.value) }));
  find("#mask").addEventListener("change", ({ target }) => mask(target.files[0]));
}

function open() {
  const { asked } = state.get();
  object = structuredClone(asked.object ?? {});
  stage.style.aspectRatio = `${asked.picture.width} / ${asked.picture.height}`;
  stage.style.setProperty("--shape", asked.picture.width / asked.picture.height);
  find("#stage img").src = api.pictureUrl(asked.picture.id);
  strokes.open(asked.picture, object);
  crop.open(object.crop);
  find("#how").value = object.how ?? "auto";
  find("#difference").value = object.difference ?? 14;
  find("#tools input").checked = true;
  pick("foreground");
  dialog.showModal();
  change({});
}

/** The tool is "foreground", "background" or "crop". */
function pick(tool) {
  strokes.kind = tool;
  stage.dataset.tool = tool;
}

function change(corrections) {
  object = { ...object, ...corrections };
  find("#difference-part").hidden = object.how !== "by colour";
  find("#mask-part").hidden = object.how !== "mask";
  find("#undo-mark").disabled = !(object.foreground?.length || object.background?.length);
  preview();
}

/** What the corrections make of the picture; of several answers the newest is shown. */
const preview = settled(async () => {
  if (object.how === "mask" && !object.mask) return told("Add a mask: a picture that is light where the object is.");
  stop?.abort();
  const mine = (stop = new AbortController());
  try {
    const cut = await api.cutOut(state.get().asked.picture.id, object, mine.signal);
    find("#cut img").src = api.pictureUrl(cut.picture.id);
    told(cut.sentence);
  } catch (error) {
    if (!api.calledOff(error)) told(error.message);
  }
}, 150);

const told = (sentence) => (find("#cut p").textContent = sentence);

async function mask(file) {
  if (!file) return;
  try {
    change({ mask: (await api.upload(file)).id });
  } catch (error) {
    tell(error);
  }
}

function clear() {
  object = {};
  strokes.clear();
  crop.open();
  find("#how").value = "auto";
  change({});
}

function use() {
  dialog.close();
  look({ ...state.get().asked, object });
}
