// A small viewer for light meshes: drawn as render.py draws, and it keeps its camera when the mesh is edited.
// `element` is the component, `props.value` what app_viewer.scene made, `watch` calls back when that changes.
const canvas = element.querySelector("canvas");
const gl = canvas.getContext("webgl2", { antialias: true, alpha: true });
const camera = { azimuth: 30, elevation: 20, distance: 2.5, zoom: 1 };
const frame = { centre: [0, 0, 0], side: 1, opened: null };
let buffers = null;

const VERTEX = `#version 300 es
uniform mat4 toCamera, projection; in vec3 position; out vec3 seen;
void main() { vec4 at = toCamera * vec4(position, 1); seen = at.xyz; gl_Position = projection * at; }`;
const FRAGMENT = `#version 300 es
precision highp float; uniform vec3 colour; in vec3 seen; out vec4 result;
void main() {
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
  float light = 0.34 + 0.62 * max(dot(normal, normalize(vec3(0.5, 0.8, 0.6))), 0.0)
              + 0.24 * max(dot(normal, normalize(vec3(-0.8, 0.2, 0.5))), 0.0);
  result = vec4(sqrt(clamp(colour * colour * light, 0.0, 1.0)), 1);
}`;

function shader(kind, text) {
  const made = gl.createShader(kind);
  gl.shaderSource(made, text);
  gl.compileShader(made);
  return made;
}

function program() {
  const made = gl.createProgram();
  gl.attachShader(made, shader(gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(made, shader(gl.FRAGMENT_SHADER, FRAGMENT));
  gl.linkProgram(made);
  return made;
}

function bytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
}

function load(scene) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const position = gl.createBuffer(), index = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, position);
  gl.bufferData(gl.ARRAY_BUFFER, bytes(scene.vertices), gl.STATIC_DRAW);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, index);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, bytes(scene.faces), gl.STATIC_DRAW);
  const place = gl.getAttribLocation(drawing, "position");
  gl.enableVertexAttribArray(place);
  gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
  if (buffers) [buffers.position, buffers.index].forEach((old) => gl.deleteBuffer(old)), gl.deleteVertexArray(buffers.array);
  buffers = { array, position, index, parts: scene.parts, loaded: (buffers ? buffers.loaded : 0) + 1 };
}

// Rows of the matrix from the world to the camera, as camera.world_to_camera has them.
function axes() {
  const a = camera.azimuth * Math.PI / 180, e = camera.elevation * Math.PI / 180;
  const right = [Math.cos(a), Math.sin(a), 0];
  const back = [Math.sin(a) * Math.cos(e), -Math.cos(a) * Math.cos(e), Math.sin(e)];
  const up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0]];
  return [right, up, back];
}

function toCamera() {
  const rows = axes(), far = camera.distance * frame.side, matrix = new Float32Array(16);
  rows.forEach((row, i) => {
    row.forEach((value, j) => (matrix[4 * j + i] = value));
    matrix[12 + i] = -row.reduce((sum, value, j) => sum + value * frame.centre[j], 0) - (i === 2 ? far : 0);
  });
  matrix[15] = 1;
  return matrix;
}

function projection() {
  const aspect = canvas.width / canvas.height, far = camera.distance * frame.side;
  const slope = 0.72 / camera.distance / camera.zoom, near = Math.max(far - 2 * frame.side, 0.05 * far), end = far + 4 * frame.side;
  const [x, y] = aspect > 1 ? [slope * aspect, slope] : [slope, slope / aspect];
  return new Float32Array([1 / x, 0, 0, 0, 0, 1 / y, 0, 0, 0, 0, -(end + near) / (end - near), -1, 0, 0, (-2 * end * near) / (end - near), 0]);
}

function draw() {
  if (!gl) return;
  const scale = Math.min(window.devicePixelRatio || 1, 2);
  canvas.width = Math.max(1, canvas.clientWidth * scale);
  canvas.height = Math.max(1, canvas.clientHeight * scale);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  if (!buffers) return;
  gl.enable(gl.DEPTH_TEST);
  gl.useProgram(drawing);
  gl.bindVertexArray(buffers.array);
  gl.uniformMatrix4fv(gl.getUniformLocation(drawing, "toCamera"), false, toCamera());
  gl.uniformMatrix4fv(gl.getUniformLocation(drawing, "projection"), false, projection());
  for (const part of buffers.parts) {
    gl.uniform3fv(gl.getUniformLocation(drawing, "colour"), part.colour);
    gl.drawElements(gl.TRIANGLES, part.count, gl.UNSIGNED_INT, 4 * part.first);
  }
  canvas.dataset.drawn = [...Object.values(camera), ...toCamera(), buffers.loaded].map((x) => Number(x).toFixed(4)).join(" ");
}

// A newly opened asset is seen from its own camera; an edited one from where the visitor left it.
function aim(scene) {
  const outgrown = scene.side > 1.25 * frame.side || scene.side < 0.6 * frame.side;
  if (scene.opened !== frame.opened) Object.assign(camera, scene.view, { zoom: 1 });
  if (scene.opened !== frame.opened || outgrown) Object.assign(frame, { centre: scene.centre, side: scene.side });
  frame.opened = scene.opened;
}

let newest = 0; // an answer that was overtaken by a later one is left out

function show() {
  const scene = props.value;
  if (scene && scene.version < newest) return;
  newest = scene ? scene.version : newest;
  element.querySelector(".empty").hidden = Boolean(scene);
  canvas.hidden = !scene;
  if (!scene || !gl) return;
  aim(scene);
  load(scene);
  draw();
  canvas.dataset.faces = scene.parts.reduce((sum, part) => sum + part.count / 3, 0);
}

function turn(right, up) {
  camera.azimuth -= right;
  camera.elevation = Math.min(89, Math.max(-89, camera.elevation + up));
  draw();
}

function zoom(factor) {
  camera.zoom = Math.min(6, Math.max(0.4, camera.zoom * factor));
  draw();
}

const held = new Map(); // pointers on the canvas: two of them zoom
canvas.addEventListener("pointerdown", (event) => {
  held.set(event.pointerId, event);
  canvas.setPointerCapture(event.pointerId);
});
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => held.delete(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  const before = held.get(event.pointerId);
  if (!before) return;
  if (held.size === 1) turn((event.clientX - before.clientX) * 0.5, (event.clientY - before.clientY) * 0.4);
  const other = [...held.values()].find((pointer) => pointer.pointerId !== event.pointerId);
  const apart = (a, b) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY) || 1;
  if (other) zoom(apart(event, other) / apart(before, other));
  held.set(event.pointerId, event);
});
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(-event.deltaY / 600));
}, { passive: false });
const KEYS = {
  ArrowLeft: () => turn(10, 0), ArrowRight: () => turn(-10, 0), ArrowUp: () => turn(0, 10), ArrowDown: () => turn(0, -10),
  "+": () => zoom(1.2), "=": () => zoom(1.2), "-": () => zoom(1 / 1.2),
};
canvas.addEventListener("keydown", (event) => {
  if (!KEYS[event.key]) return;
  event.preventDefault();
  KEYS[event.key]();
});

const drawing = gl && program();
if (!gl) element.querySelector(".empty").textContent = "This browser cannot draw in 3D (WebGL 2 is off). Estimating and downloading work.";
new ResizeObserver(draw).observe(canvas);
watch("value", show);
show();
