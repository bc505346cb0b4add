// The picture: chosen, dropped, pasted or taken from the examples; what the model sees of it is shown beside.
import * as api from "./api.js";
import { capital, find, make, size } from "./dom.js";
import { estimate } from "./estimating.js";
import * as state from "./state.js";
import { tell } from "./toast.js";

export function start({ examples, limits }) {
  const file = find("#file"), zone = find("#drop");
  file.addEventListener("change", () => {
    use(file.files[0], limits);
    file.value = "";
  });
  for (const name of ["dragenter", "dragover"]) addEventListener(name, (event) => over(event, zone, true));
  for (const name of ["dragleave", "drop"]) addEventListener(name, (event) => over(event, zone, false));
  // A file that is dropped on the tab for generators is none of a picture.
  addEventListener("drop", (event) => find("#by-own").hidden && use(event.dataTransfer.files[0], limits));
  addEventListener("paste", (event) => use([...event.clipboardData.files].find(({ type }) => type.startsWith("image/")), limits));
  find("#examples").append(...examples.map((example) => tile(example, limits)));
  find("#examples-part").hidden = !examples.length;
  state.listen(show);
}

/** Upload a picture and estimate from it; nothing happens without a file. */
export async function use(file, limits) {
  if (!file) return;
  try {
    if (file.size > limits.picture_bytes) throw new api.Problem(`A picture may have ${size(limits.picture_bytes)}, this one has ${size(file.size)}.`);
    document.body.classList.add("uploading");
    const picture = await api.upload(file);
    look({ picture, object: {} });
  } catch (error) {
    tell(error);
  } finally {
    document.body.classList.remove("uploading");
  }
}

/** Estimate from an uploaded picture with corrections of its cut-out. */
export function look(asked) {
  state.set({ asked });
  estimate(asked);
}

function over(event, zone, entered) {
  if (![...event.dataTransfer.types].includes("Files")) return;
  event.preventDefault();
  zone.classList.toggle("over", entered);
}

function tile({ label, url }, limits) {
  const image = make("img", { src: url, alt: "", loading: "lazy" });
  const button = make("button", { type: "button", className: "tile" }, image, make("span", { textContent: capital(label) }));
  button.addEventListener("click", async () => {
    try {
      await use(await api.bytes(url), limits);
    } catch (error) {
      tell(error);
    }
  });
  return button;
}

let asked = null, sentence = "";

function show({ asked: now, results, open }) {
  const picture = now?.picture;
  find("#drop").classList.toggle("filled", Boolean(picture));
  find("#given").hidden = !picture;
  if (picture && find("#given").dataset.id !== picture.id) Object.assign(find("#given"), { src: api.pictureUrl(picture.id) }).dataset.id = picture.id;
  find("#seen").hidden = !picture;
  if (!picture || now === asked) return;
  asked = now;
  describe(now, results, open);
}

/** The cut-out with the sentence that says how it was made. */
async function describe(now) {
  try {
    const cut = await api.cutOut(now.picture.id, now.object);
    if (now !== asked) return;
    find("#seen img").src = api.pictureUrl(cut.picture.id);
    sentence = cut.sentence;
  } catch (error) {
    sentence = error.message;
  }
  find("#seen p").textContent = sentence;
}
