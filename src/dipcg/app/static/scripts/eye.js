// The camera of the viewer: it starts where the picture was taken, and mouse, fingers and keys move it.
import { OrbitControls, PerspectiveCamera, Vector3 } from "../vendor/three.js";

const RADIANS = Math.PI / 180;
// Where an asset without a picture is seen from (docs/conventions.md says what the numbers mean).
const OPEN_FROM = { azimuth_deg: 30, elevation_deg: 20, distance: 2.5 };
// Half of what the camera sees, in sides of the asset, at its distance.
const HALF = 0.78;
// Moves of a key: degrees, and the factor of the distance.
const TURN = 10, ZOOM = 1.2;
const TOP = 89;

export class Eye {
  constructor(canvas, draw) {
    this.camera = new PerspectiveCamera();
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", draw);
    this.seen = null;
    // One finger scrolls the page up and down and turns the asset; two zoom.
    canvas.style.touchAction = "pan-y";
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  /** Look at a box from a view of the API, or from the usual place. */
  aim(box, view) {
    this.seen = { box: box.clone(), view: { ...OPEN_FROM, ...view } };
    this.home();
  }

  /** Back to where the camera was aimed at first. */
  home() {
    const { box, view } = this.seen;
    const size = box.getSize(new Vector3()), side = Math.max(size.x, size.y, size.z);
    box.getCenter(this.controls.target);
    const far = view.distance * side;
    this.half = HALF / view.distance;
    Object.assign(this.camera, { near: 0.02 * side, far: far + 30 * side });
    Object.assign(this.controls, { minDistance: 0.4 * side, maxDistance: 4 * far });
    this.place(view.azimuth_deg * RADIANS, view.elevation_deg * RADIANS, far);
  }

  /** Put the camera at an azimuth from the front (glTF's +Z), an elevation and a distance from the target. */
  place(azimuth, elevation, distance) {
    const flat = Math.cos(elevation) * distance;
    const offset = new Vector3(Math.sin(azimuth) * flat, Math.sin(elevation) * distance, Math.cos(azimuth) * flat);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.controls.dispatchEvent({ type: "change" });
  }

  /** Keep all of the asset in sight in a canvas of this shape. */
  shape(aspect) {
    const vertical = aspect > 1 ? this.half : this.half / aspect;
    Object.assign(this.camera, { aspect, fov: (2 * Math.atan(vertical)) / RADIANS });
    this.camera.updateProjectionMatrix();
  }

  key(event) {
    const azimuth = this.controls.getAzimuthalAngle(), distance = this.controls.getDistance();
    const elevation = Math.PI / 2 - this.controls.getPolarAngle();
    const turned = (right, up) => this.place(azimuth + right * RADIANS, Math.min(TOP * RADIANS, Math.max(-TOP * RADIANS, elevation + up * RADIANS)), distance);
    const keys = {
      ArrowLeft: () => turned(-TURN, 0), ArrowRight: () => turned(TURN, 0), ArrowUp: () => turned(0, TURN), ArrowDown: () => turned(0, -TURN),
      "+": () => this.place(azimuth, elevation, distance / ZOOM), "-": () => this.place(azimuth, elevation, distance * ZOOM), Home: () => this.home(),
    };
    keys["="] = keys["+"];
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }

  words() {
    return [...this.camera.position.toArray(), this.camera.fov].map((value) => value.toFixed(4)).join(" ");
  }
}
