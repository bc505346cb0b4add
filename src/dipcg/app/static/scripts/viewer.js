// The asset in 3D: light, floor and shadow, drawn when something has changed.
import { find, icon } from "./dom.js";
import * as state from "./state.js";
import { paint } from "./looks.js";
import { Eye } from "./eye.js";
import {
  Box3, DirectionalLight, GLTFLoader, Mesh, NeutralToneMapping, PlaneGeometry, PMREMGenerator, RoomEnvironment, Scene, ShadowMaterial,
  Vector3, VSMShadowMap, WebGLRenderer,
} from "../vendor/three.js";

const SHADOW_PIXELS = 1024;
const NO_WEBGL = "This browser cannot draw in 3D, because WebGL 2 is off. Estimates and downloads work all the same.";

const canvas = find("#viewer canvas");
const scene = new Scene();
const loader = new GLTFLoader();
const sun = new DirectionalLight(0xffffff, 1.6);
const floor = new Mesh(new PlaneGeometry(1, 1), new ShadowMaterial({ opacity: 0.28 }));
let renderer = null, eye = null, asset = null, shown = 0, waiting = false;

export function start() {
  try {
    renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
  } catch {
    find("#viewer .empty").textContent = NO_WEBGL;
    return;
  }
  renderer.toneMapping = NeutralToneMapping;
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = VSMShadowMap;
  // The light stays where it is, so only another asset has another shadow.
  renderer.shadowMap.autoUpdate = false;
  scene.environment = new PMREMGenerator(renderer).fromScene(new RoomEnvironment(), 0.03).texture;
  scene.environmentIntensity = 0.75;
  Object.assign(sun, { castShadow: true });
  Object.assign(sun.shadow, { radius: 6, blurSamples: 16, bias: -0.0005 });
  sun.shadow.mapSize.set(SHADOW_PIXELS, SHADOW_PIXELS);
  floor.rotation.x = -Math.PI / 2;
  floor.receiveShadow = true;
  scene.add(sun, sun.target, floor);
  eye = new Eye(canvas, draw);
  new ResizeObserver(draw).observe(canvas);
  find("#viewer .home").append(icon("camera-back"));
  find("#viewer .home").addEventListener("click", () => eye.home());
  state.listen((now, before) => now.colours !== before.colours && asset && repaint());
}

/** Show a GLB. The camera moves only if another asset than before was opened, to where its picture was taken. */
export async function show(glb, { opened, view }) {
  const { scene: fresh } = await loader.parseAsync(glb, "");
  find("#viewer .empty").hidden = true;
  if (!renderer) return;
  if (asset) dispose(asset);
  asset = fresh;
  scene.add(asset);
  const box = new Box3().setFromObject(asset);
  if (canvas.dataset.opened !== String(opened)) eye.aim(box, view);
  canvas.dataset.opened = opened;
  place(box);
  canvas.hidden = find("#viewer .over").hidden = false;
  repaint();
}

/** Light and floor for an asset of this size. */
function place(box) {
  const side = Math.max(...box.getSize(new Vector3()).toArray()), centre = box.getCenter(new Vector3());
  floor.position.set(centre.x, box.min.y - 0.002 * side, centre.z);
  floor.scale.setScalar(12 * side);
  sun.target.position.copy(centre);
  sun.position.copy(centre).add(new Vector3(0.9, 2.2, 1.1).multiplyScalar(side));
  const reach = 1.3 * side;
  Object.assign(sun.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.1 * side, far: 6 * side });
  sun.shadow.camera.updateProjectionMatrix();
}

function repaint() {
  shown += 1;
  let triangles = 0;
  asset.traverse((node) => {
    if (!node.isMesh) return;
    node.castShadow = node.receiveShadow = true;
    triangles += (node.geometry.index ?? node.geometry.attributes.position).count / 3;
  });
  paint(asset, state.get());
  renderer.shadowMap.needsUpdate = true;
  canvas.dataset.triangles = triangles;
  find("#viewer .triangles").textContent = `${triangles.toLocaleString("en")} triangles in this view`;
  draw();
}

function dispose(old) {
  scene.remove(old);
  old.traverse((node) => node.geometry?.dispose());
}

function draw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    const { clientWidth: width, clientHeight: height } = canvas;
    if (!asset || !width) return;
    const pixels = Math.min(devicePixelRatio, 2);
    if (canvas.width !== Math.round(width * pixels) || canvas.height !== Math.round(height * pixels)) {
      renderer.setPixelRatio(pixels);
      renderer.setSize(width, height, false);
    }
    eye.shape(width / height);
    renderer.render(scene, eye.camera);
    // What is on show, as text that differs where the picture does; the tests read it.
    canvas.dataset.drawn = `${shown} ${eye.words()}`;
  });
}
