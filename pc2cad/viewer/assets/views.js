// Where the part is seen from: fitting, standard views, the axes in the corner, keys.
import * as THREE from "three";
import { afterDrawing, box, camera, canvas, controls, draw, renderer, shown } from "pc2cad/stage";

const panel = document.getElementById("panel");
const tools = document.querySelector("nav");
/** name, direction to the eye, upward direction, key */
export const VIEWS = [
  ["Front", [0, -1, 0], [0, 0, 1], "1"], ["Back", [0, 1, 0], [0, 0, 1], "2"],
  ["Left", [-1, 0, 0], [0, 0, 1], "3"], ["Right", [1, 0, 0], [0, 0, 1], "4"],
  ["Top", [0, 0, 1], [0, 1, 0], "5"], ["Bottom", [0, 0, -1], [0, -1, 0], "6"],
];
const WHOLE = new THREE.Vector3(1, -1, 0.8).normalize();
let half = 1; // half the height that fits into the window

/** The part of the window that the panel and the tools leave free, in pixels. */
export function free() {
  const { innerWidth: width, innerHeight: height } = window;
  const top = tools.getBoundingClientRect().bottom + 4;
  if (document.body.classList.contains("folded")) return { left: 0, top, right: width, bottom: height };
  const at = panel.getBoundingClientRect();
  return at.left > 1 ? { left: 0, top, right: at.left, bottom: height }
    : { left: 0, top, right: width, bottom: at.top };
}

export function resize() {
  const { innerWidth: width, innerHeight: height } = window;
  renderer.setPixelRatio(window.devicePixelRatio);
  renderer.setSize(width, height, false);
  const room = free();
  // the middle of the free part is the middle of the picture
  const x = width / 2 - (room.left + room.right) / 2, y = height / 2 - (room.top + room.bottom) / 2;
  camera.setViewOffset(width, height, x, y, width, height);
  const unit = half / Math.max((room.bottom - room.top) / 2, 1);
  camera.left = -(camera.right = (unit * width) / 2);
  camera.bottom = -(camera.top = (unit * height) / 2);
  camera.updateProjectionMatrix();
  draw();
}

/** The rectangle that the part takes, as the camera sees it. */
function extent() {
  const m = camera.matrixWorldInverse.elements;
  const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
  const seen = [...shown.faces, ...shown.others].map(({ geometry }) => geometry.attributes.position.array);
  if (document.getElementById("sizes").getAttribute("aria-pressed") === "true") {
    const { min, max } = box;
    seen.push([0, 1, 2, 3, 4, 5, 6, 7].flatMap(
      (i) => [i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z]));
  }
  for (const at of seen) {
    for (let i = 0; i < at.length; i += 3) {
      for (const k of [0, 1]) {
        const where = m[k] * at[i] + m[4 + k] * at[i + 1] + m[8 + k] * at[i + 2] + m[12 + k];
        if (where < low[k]) low[k] = where;
        if (where > high[k]) high[k] = where;
      }
    }
  }
  return { low, high };
}

/** Show the whole part from the present direction, as large as the free part of the window lets it. */
export function fit() {
  const centre = box.getCenter(new THREE.Vector3());
  const size = box.getSize(new THREE.Vector3()).length() || 1;
  const toward = camera.position.clone().sub(controls.target).normalize();
  controls.target.copy(centre);
  camera.position.copy(centre).addScaledVector(toward, size);
  camera.near = -20 * size;
  camera.far = 20 * size;
  camera.lookAt(centre);
  camera.updateMatrixWorld();
  const { low, high } = extent();
  const aside = new THREE.Vector3((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0).applyQuaternion(camera.quaternion);
  controls.target.add(aside);
  camera.position.add(aside);
  const room = free();
  const aspect = Math.max(room.right - room.left, 1) / Math.max(room.bottom - room.top, 1);
  half = 0.53 * Math.max(high[1] - low[1], (high[0] - low[0]) / aspect, 1e-9 * size);
  camera.zoom = 1;
  resize();
  controls.update();
}

export function lookFrom(direction, up = [0, 0, 1]) {
  // the controls turn about z: from above and below, the direction is a hair's breadth off it
  const toward = new THREE.Vector3(...direction).normalize();
  if (Math.abs(toward.z) === 1) toward.addScaledVector(new THREE.Vector3(...up), -1e-4);
  camera.position.copy(controls.target).add(toward);
  fit();
}

export const home = () => lookFrom(WHOLE.toArray());

// -- axes in the corner -----------------------------------------------------------------------

const corner = new THREE.Scene();
const eye = new THREE.OrthographicCamera(-1.5, 1.5, 1.5, -1.5, -3, 3);
const labels = document.getElementById("labels");
const AXES = [["x", 0xd64541, [1, 0, 0]], ["y", 0x2e9e4f, [0, 1, 0]], ["z", 0x3b6fd4, [0, 0, 1]]].map(
  ([name, colour, along]) => {
    const direction = new THREE.Vector3(...along);
    corner.add(new THREE.ArrowHelper(direction, new THREE.Vector3(), 1, colour, 0.32, 0.18));
    const label = Object.assign(document.createElement("span"), { textContent: name, className: "axis" });
    label.style.color = `#${colour.toString(16).padStart(6, "0")}`;
    labels.append(label);
    return { direction, label };
  });
const SIZE = 92; // pixels

afterDrawing(() => {
  const room = free();
  const ratio = renderer.getPixelRatio(), { innerHeight: height } = window;
  const at = [room.left + 6, height - room.bottom + 6];
  eye.quaternion.copy(camera.quaternion);
  eye.updateMatrixWorld();
  renderer.setViewport(at[0], at[1], SIZE, SIZE);
  renderer.clearDepth();
  renderer.render(corner, eye);
  renderer.setViewport(0, 0, canvas.width / ratio, canvas.height / ratio);
  for (const { direction, label } of AXES) {
    const tip = direction.clone().multiplyScalar(1.22).project(eye);
    label.style.left = `${at[0] + ((1 + tip.x) / 2) * SIZE}px`;
    label.style.top = `${height - at[1] - ((1 + tip.y) / 2) * SIZE}px`;
  }
});

// -- keys -------------------------------------------------------------------------------------

const ROTATE = Math.PI / 24;

/** Turn by two angles about the target, about z and towards it. */
function turn(across, upward) {
  const offset = camera.position.clone().sub(controls.target);
  const round = new THREE.Spherical().setFromVector3(offset.clone().set(offset.x, offset.z, -offset.y));
  round.theta += across;
  round.phi = Math.min(Math.max(round.phi + upward, 1e-4), Math.PI - 1e-4);
  const back = new THREE.Vector3().setFromSpherical(round);
  camera.position.copy(controls.target).add(new THREE.Vector3(back.x, -back.z, back.y));
  controls.update();
  draw();
}

function move(x, y) {
  const step = (0.1 * half) / camera.zoom;
  const by = new THREE.Vector3(x * step, y * step, 0).applyQuaternion(camera.quaternion);
  camera.position.add(by);
  controls.target.add(by);
  controls.update();
  draw();
}

function zoom(factor) {
  camera.zoom *= factor;
  camera.updateProjectionMatrix();
  draw();
}

/** What a key does to the view; true where it does anything. */
export function viewKey(event) {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const view = VIEWS.find(([, , , key]) => key === event.key);
  if (event.key in arrows) {
    const [x, y] = arrows[event.key];
    if (event.shiftKey) move(x, y);
    else turn(-x * ROTATE, -y * ROTATE);
  } else if (view) lookFrom(view[1], view[2]);
  else if (event.key === "0") home();
  else if (event.key === "f") fit();
  else if (event.key === "+" || event.key === "=") zoom(1.2);
  else if (event.key === "-") zoom(1 / 1.2);
  else return false;
  return true;
}
