// Starts the parts of the page, each of which a file of its own looks after.
import * as api from "./api.js";
import * as ask from "./ask.js";
import * as camera from "./camera.js";
import * as correct from "./correct.js";
import { find } from "./dom.js";
import * as download from "./download.js";
import * as estimating from "./estimating.js";
import { look, photoColours } from "./looks.js";
import * as parameters from "./parameters.js";
import * as picture from "./picture.js";
import * as preview from "./preview.js";
import * as sketch from "./sketch.js";
import * as state from "./state.js";
import * as strip from "./strip.js";
import { tell } from "./toast.js";
import * as training from "./training.js";
import * as viewer from "./viewer.js";

async function start() {
  const [about, generators] = await Promise.all([api.about(), api.generators()]);
  viewer.start();
  picture.start(about);
  for (const part of [sketch, camera, correct]) part.start(about);
  ask.start(about, generators);
  training.start(about, generators);
  strip.start();
  parameters.start(generators);
  preview.start();
  download.start(about, generators);
  estimating.start();
  looks();
  for (const close of document.querySelectorAll("dialog .close")) close.addEventListener("click", () => close.closest("dialog").close());
  document.body.classList.add("ready");
}

/** The switch for the colours of the asset. */
function looks() {
  for (const choice of document.querySelectorAll("#looks input")) {
    choice.addEventListener("change", () => state.set({ colours: choice.value }));
  }
  state.listen((now) => {
    find("#look-photo").disabled = !Object.keys(photoColours(now)).length;
    find(`#looks [value=${look(now)}]`).checked = true;
  });
}

start().catch(tell);
