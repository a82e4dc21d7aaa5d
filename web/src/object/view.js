import {
  AmbientLight, Box2, Box3, DirectionalLight, OrthographicCamera, Quaternion, Raycaster, Scene, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { byId } from "../shared/dom.js";
import { length } from "../shared/formatting.js";
import { gripperAt, tableMesh } from "./gripper.js";
import { arrowTails, disposeMarks, graspMarks } from "./marks.js";
import { PaintedSurface } from "./surface.js";

const AMBIENT = 0.55;
const MARGIN = 1.12;
const CLICK_MOVE = 4; // pixels that the pointer may move during a click
const FROM = new Vector3(0.55, -0.75, 0.55);
const UP = new Vector3(0, 0, 1);
const [WHITE, BLACK] = [0xffffff, 0x1a1a1a];
const MAX_SCALE_BAR = 110; // pixels
const VISIBLE = 0.96; // of the picture's half width and height, for arrows and grippers
const LEAST_ZOOM = 1 / 2.4; // beside a large gripper the object must not become tiny

/** Opens the 3-D view; without WebGL it shows a message, and the rest of the page works. */
export function openView(stage) {
  try {
    return new View(stage);
  } catch {
    byId("message").textContent = "The 3-D view needs WebGL, which is not available in this browser; the values beside it are complete.";
    byId("scale").hidden = true;
    const nothing = () => {};
    return { show: nothing, paint: nothing, mark: nothing, showGrasp: nothing, reset: nothing, onPick: nothing };
  }
}

/** Corners of a box. */
function cornersOf({ min, max }) {
  const of = (axis) => [min[axis], max[axis]];
  return of("x").flatMap((x) => of("y").flatMap((y) => of("z").map((z) => new Vector3(x, y, z))));
}

/** The rectangle around points in the picture. */
function boxOf(points) {
  return new Box2().setFromPoints(points);
}

class View {
  constructor(stage) {
    this.stage = stage;
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "The coloured surface; arrow keys rotate it, plus and minus zoom");
    stage.prepend(this.canvas);
    this.scene = new Scene();
    this.camera = new OrthographicCamera();
    this.lamp = new DirectionalLight(0xffffff, Math.PI * (1 - AMBIENT));
    this.scene.add(new AmbientLight(0xffffff, Math.PI * AMBIENT), this.lamp, this.lamp.target);
    this.setUp(UP);
    this.addClickListeners();
    this.addKeyListener();
    new ResizeObserver(() => this.fit()).observe(stage);
    globalThis.grasp3dCamera = () => this.cameraMatrices();
  }

  onPick(picked) {
    this.picked = picked;
  }

  /** Sets the direction that is up, which the controls read only when they are made. */
  setUp(up) {
    this.controls?.dispose();
    this.camera.up.copy(up);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => this.draw());
  }

  show(object) {
    this.setUp(new Vector3(...(object.up ?? UP.toArray())));
    if (this.surface) {
      this.scene.remove(this.surface.mesh);
      this.surface.dispose();
    }
    if (this.table) {
      this.scene.remove(this.table);
      disposeMarks({ children: [this.table] });
    }
    this.mark([]);
    this.object = object;
    const box = new Box3().setFromArray(object.points);
    this.centre = box.getCenter(new Vector3());
    this.surface = new PaintedSurface(object, this.centre.toArray());
    this.scene.add(this.surface.mesh);
    this.table = tableMesh(object, this.centre);
    if (this.table) {
      this.scene.add(this.table);
      box.union(new Box3().setFromArray(object.gripper.table.vertices));
    }
    this.corners = cornersOf(box.translate(this.centre.clone().negate()));
    this.reset();
  }

  paint(colors, sharp) {
    this.surface.paint(colors, sharp);
    this.lightMarks = !sharp; // colour ramps begin dark
    this.mark(...this.marked);
  }

  /**
   * Draws a grasp instead of the previous one; no contacts: none. Outward normals add arrows, a
   * grasp with a pose the gripper.
   */
  mark(points, outward = null, grasp = null) {
    for (const group of [this.marks, this.gripper]) {
      if (!group) continue;
      this.scene.remove(group);
      disposeMarks(group);
    }
    this.marked = [points, outward, grasp];
    this.marks = this.gripper = null;
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    const held = grasp && gripperAt(this.object, grasp, this.centre, dark);
    if (held) {
      this.gripper = held.group;
      this.scene.add(held.group);
    }
    if (points.length) {
      const light = this.lightMarks || dark;
      const [core, rim] = light ? [WHITE, BLACK] : [BLACK, WHITE];
      const contacts = points.map((one) => new Vector3(...one).sub(this.centre));
      const normals = outward?.map((one) => new Vector3(...one));
      this.marks = graspMarks({ contacts, normals }, this.object.size, { core, rim });
      this.scene.add(this.marks);
    }
    this.draw();
  }

  /** Draws a grasp with its gripper, or with arrows, from where its fingertips are seen, and fits them in. */
  showGrasp(grasp) {
    if (grasp.toward) this.lookFrom(new Vector3(...grasp.toward));
    const held = gripperAt(this.object, grasp, this.centre, false);
    if (!held) {
      this.showArrows(grasp.points, grasp.normals);
      return;
    }
    disposeMarks(held.group);
    this.include(held.corners);
    this.mark(grasp.points, null, grasp);
  }

  /** Moves the camera away, in the same direction, if points do not fit into the picture beside the object. */
  include(points) {
    this.camera.updateMatrixWorld();
    this.camera.updateProjectionMatrix();
    const seen = (one) => one.clone().project(this.camera);
    const own = boxOf(this.corners.map(seen));
    const beside = boxOf(points.map(seen));
    if (Math.max(beside.max.x, beside.max.y, -beside.min.x, -beside.min.y) <= VISIBLE) return;
    const both = own.clone().union(beside);
    const [half, middle] = [both.getSize(new Vector2()).multiplyScalar(0.5), both.getCenter(new Vector2())];
    const most = this.camera.zoom / LEAST_ZOOM;
    const reach = Math.min(Math.max(half.x, half.y) / VISIBLE, Math.max(most, 1));
    for (const axis of ["x", "y"]) {
      middle[axis] = Math.max(own.max[axis] - reach, Math.min(own.min[axis] + reach, middle[axis]));
    }
    const target = new Vector3(middle.x, middle.y, 0).unproject(this.camera);
    const shift = target.sub(new Vector3(0, 0, 0).unproject(this.camera));
    this.camera.position.add(shift);
    this.controls.target.add(shift);
    this.camera.zoom /= Math.max(1, reach);
    this.camera.updateProjectionMatrix();
    this.controls.update();
  }

  showArrows(points, outward) {
    const contacts = points.map((one) => new Vector3(...one).sub(this.centre));
    const tails = arrowTails(contacts, outward.map((one) => new Vector3(...one)), this.object.size);
    this.camera.updateMatrixWorld();
    this.camera.updateProjectionMatrix();
    const reach = Math.max(...tails.map((one) => {
      const seen = one.clone().project(this.camera);
      return Math.max(Math.abs(seen.x), Math.abs(seen.y));
    }));
    if (reach > VISIBLE) {
      this.camera.zoom *= VISIBLE / reach;
      this.camera.updateProjectionMatrix();
    }
    this.mark(points, outward);
  }

  reset() {
    this.lookFrom(FROM.clone().applyQuaternion(new Quaternion().setFromUnitVectors(UP, this.camera.up)));
  }

  /** Looks at the whole object from a direction. */
  lookFrom(toward) {
    this.camera.position.copy(toward).setLength(3 * this.object.size);
    this.camera.zoom = 1;
    this.camera.near = 0.01 * this.object.size;
    this.camera.far = 10 * this.object.size;
    if (this.object.gripper) { // it may reach behind the camera, which is without effect on the picture
      this.camera.near = -20 * this.object.size;
      this.camera.far = 30 * this.object.size;
    }
    this.controls.target.set(0, 0, 0);
    this.fit();
    this.controls.update();
    this.draw();
  }

  fit() {
    const [width, height] = [this.stage.clientWidth || 1, this.stage.clientHeight || 1];
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
    if (!this.object) return;
    const half = (0.5 * MARGIN * this.object.size) / Math.min(1, width / height);
    Object.assign(this.camera, { left: (-half * width) / height, right: (half * width) / height, top: half, bottom: -half });
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    if (!this.surface) return;
    this.camera.updateMatrixWorld();
    this.lamp.position.set(-0.35, 0.45, 1).applyQuaternion(this.camera.quaternion);
    this.renderer.render(this.scene, this.camera);
    this.drawScale();
  }

  /** Draws a scale bar of a round length; it is valid everywhere, as there is no perspective. */
  drawScale() {
    const perPixel = (this.camera.top - this.camera.bottom) / this.camera.zoom / this.stage.clientHeight;
    const most = MAX_SCALE_BAR * perPixel;
    const power = 10 ** Math.floor(Math.log10(most));
    const round = [5, 2, 1].find((one) => one * power <= most) * power;
    const [label, bar] = byId("scale").children;
    label.textContent = length(round, this.object.unit);
    bar.style.width = `${round / perPixel}px`;
  }

  addClickListeners() {
    let down = null;
    this.canvas.addEventListener("pointerdown", (event) => {
      down = down || event.button !== 0 ? "several" : [event.clientX, event.clientY];
    });
    this.canvas.addEventListener("pointercancel", () => { down = null; });
    this.canvas.addEventListener("pointerup", (event) => {
      const isClick = Array.isArray(down) && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < CLICK_MOVE;
      down = null;
      if (isClick) this.pickAt(event.clientX, event.clientY);
    });
  }

  addKeyListener() {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    this.canvas.addEventListener("keydown", (event) => {
      const turn = turns[event.key];
      const zoom = { "+": 1.15, "-": 1 / 1.15 }[event.key];
      if (turn) this.turn(...turn);
      else if (zoom) {
        this.camera.zoom *= zoom;
        this.camera.updateProjectionMatrix();
        this.draw();
      } else return;
      event.preventDefault();
    });
  }

  turn(across, up) {
    const step = Math.PI / 18;
    const { up: above } = this.camera;
    const from = this.camera.position.clone().sub(this.controls.target);
    const distance = from.length();
    from.applyAxisAngle(above, across * step);
    const tilt = Math.min(Math.PI - 0.01, Math.max(0.01, from.angleTo(above) + up * step));
    from.projectOnPlane(above).setLength(Math.sin(tilt)).addScaledVector(above, Math.cos(tilt)).setLength(distance);
    this.camera.position.copy(this.controls.target).add(from);
    this.controls.update();
    this.draw();
  }

  /** Picks the vertex nearest to the clicked point, among the corners of the clicked face. */
  pickAt(x, y) {
    if (!this.surface) return;
    const frame = this.canvas.getBoundingClientRect();
    const at = new Vector2((2 * (x - frame.left)) / frame.width - 1, 1 - (2 * (y - frame.top)) / frame.height);
    const caster = new Raycaster();
    caster.setFromCamera(at, this.camera);
    const [hit] = caster.intersectObject(this.surface.mesh);
    if (!hit) return;
    const point = hit.point.clone().add(this.centre);
    const corners = this.object.faces.subarray(3 * hit.faceIndex, 3 * hit.faceIndex + 3);
    const distances = [...corners].map((one) => point.distanceTo(new Vector3().fromArray(this.object.points, 3 * one)));
    this.picked?.(corners[distances.indexOf(Math.min(...distances))]);
  }

  /** Camera matrices by columns, relative to the surface's centre, for scripts and tests. */
  cameraMatrices() {
    this.camera.updateMatrixWorld();
    const unproject = this.camera.matrixWorld.clone().multiply(this.camera.projectionMatrixInverse);
    return { unproject: unproject.toArray(), centre: this.centre.toArray() };
  }
}
