// A sheet to draw on: dark lines on white, sent as a PNG.
const canvas = element.querySelector("canvas"), pen = canvas.getContext("2d");
let last = null, drawn = false;

function clear() {
  pen.fillStyle = "#fff";
  pen.fillRect(0, 0, canvas.width, canvas.height);
  Object.assign(pen, { strokeStyle: "#222", lineWidth: 5, lineCap: "round", lineJoin: "round" });
  drawn = false;
}

function place(event) {
  const box = canvas.getBoundingClientRect();
  return [((event.clientX - box.left) / box.width) * canvas.width, ((event.clientY - box.top) / box.height) * canvas.height];
}

function line(event) {
  if (!last) return;
  pen.beginPath();
  pen.moveTo(...last);
  last = place(event);
  pen.lineTo(...last);
  pen.stroke();
  drawn = true;
}

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  last = place(event);
  line(event);
});
canvas.addEventListener("pointermove", line);
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (last = null));
element.querySelector(".clear").addEventListener("click", clear);
element.querySelector(".use").addEventListener("click", () => trigger("select", { picture: drawn ? canvas.toDataURL("image/png") : "" }));
clear();
