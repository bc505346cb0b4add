// A picture from the camera of this machine, in a dialog with a button that takes it.
import { find } from "./dom.js";
import { use } from "./picture.js";
import { say } from "./toast.js";

const NO_CAMERA = "No camera can be used: allow it in the browser, or choose a file.";
const dialog = find("#camera"), video = find("#camera video");
let stream = null;

export function start({ limits }) {
  find("#use-camera").addEventListener("click", open);
  find("#shoot").addEventListener("click", () => shoot(limits));
  dialog.addEventListener("close", () => stream?.getTracks().forEach((track) => track.stop()));
}

async function open() {
  try {
    stream = await navigator.mediaDevices.getUserMedia({ video: { facingMode: "environment" } });
  } catch {
    return say(NO_CAMERA, "wrong");
  }
  video.srcObject = stream;
  dialog.showModal();
}

function shoot(limits) {
  const sheet = Object.assign(document.createElement("canvas"), { width: video.videoWidth, height: video.videoHeight });
  sheet.getContext("2d").drawImage(video, 0, 0);
  sheet.toBlob((blob) => use(blob, limits), "image/jpeg", 0.92);
  dialog.close();
}
