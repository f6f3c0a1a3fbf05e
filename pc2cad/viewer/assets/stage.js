// The scene: what is drawn, the camera, the light, and when to draw.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

export const canvas = document.getElementById("canvas");
export const renderer = new THREE.WebGLRenderer({
  canvas, antialias: true, stencil: true, preserveDrawingBuffer: true,
});
renderer.localClippingEnabled = true;
renderer.autoClear = false;
export const scene = new THREE.Scene();
// without perspective, lengths in the picture can be compared
export const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, -100, 100);
camera.up.set(0, 0, 1);
export const controls = new OrbitControls(camera, canvas);
scene.add(new THREE.HemisphereLight(0xffffff, 0xb8bcc6, 1.5));
const lamp = new THREE.DirectionalLight(0xffffff, 1.8);
scene.add(lamp, lamp.target);

export const plane = new THREE.Plane(new THREE.Vector3(-1, 0, 0), 0);
export const shown = { faces: [], lines: [], others: [], caps: [], cloud: null, part: null };
export const box = new THREE.Box3();
const group = new THREE.Group();
scene.add(group);

export const colourOf = (rgb) => new THREE.Color().setRGB(...rgb, THREE.SRGBColorSpace);
export const inkColour = () => getComputedStyle(document.documentElement).getPropertyValue("--ink");

function attribute(part, place, size, normalized = false) {
  return new THREE.BufferAttribute(part.read(place), size, normalized);
}

/** Put a part in the place of what is shown. */
export function build(part) {
  group.traverse((thing) => {
    thing.geometry?.dispose();
    thing.material?.dispose();
  });
  group.clear();
  Object.assign(shown, { faces: [], lines: [], others: [], caps: [], cloud: null, part });
  box.makeEmpty();
  for (const face of part.faces) addFace(part, face);
  for (const place of part.edges) shown.lines.push(addLine(part, place, inkColour(), 1));
  for (const other of part.others) {
    if (other.path) {
      const line = addLine(part, other.path, colourOf(other.colour), 3);
      line.userData = other;
      shown.others.push(line);
    }
  }
  if (part.points) addCloud(part);
  addCap();
}

function addFace(part, face) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", attribute(part, face.positions, 3));
  geometry.setAttribute("normal", attribute(part, face.normals, 4, true));
  geometry.setIndex(attribute(part, face.triangles, 1));
  geometry.computeBoundingBox();
  geometry.computeBoundingSphere();
  box.union(geometry.boundingBox);
  const material = new THREE.MeshPhongMaterial({
    color: colourOf(face.colour), side: THREE.DoubleSide, shininess: 25, specular: 0x222222,
    polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  });
  const mesh = new THREE.Mesh(geometry, material);
  mesh.renderOrder = 6;
  mesh.userData = face;
  shown.faces.push(mesh);
  group.add(mesh);
  // what lies behind the section but not before it is cut: the cap is drawn there
  for (const [side, operation] of [
    [THREE.BackSide, THREE.IncrementWrapStencilOp],
    [THREE.FrontSide, THREE.DecrementWrapStencilOp],
  ]) {
    const count = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({
      side, depthWrite: false, depthTest: false, colorWrite: false, stencilWrite: true,
      stencilFunc: THREE.AlwaysStencilFunc, stencilFail: operation, stencilZFail: operation,
      stencilZPass: operation, clippingPlanes: [plane],
    }));
    count.renderOrder = 1;
    shown.caps.push(count);
    group.add(count);
  }
}

function addLine(part, place, colour, width) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", attribute(part, place, 3));
  geometry.computeBoundingBox();
  box.union(geometry.boundingBox);
  const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: colour, linewidth: width }));
  line.renderOrder = 7;
  group.add(line);
  return line;
}

function addCloud(part) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", attribute(part, part.points.positions, 3));
  geometry.setAttribute("color", attribute(part, part.points.colours, 4, true));
  const material = new THREE.PointsMaterial({ size: 1.5, sizeAttenuation: false, vertexColors: true });
  shown.cloud = new THREE.Points(geometry, material);
  group.add(shown.cloud);
}

function addCap() {
  const size = 2 * box.getSize(new THREE.Vector3()).length();
  const material = new THREE.MeshPhongMaterial({
    color: 0xd9c58f, side: THREE.DoubleSide, stencilWrite: true, stencilRef: 0,
    stencilFunc: THREE.NotEqualStencilFunc, stencilFail: THREE.ReplaceStencilOp,
    stencilZFail: THREE.ReplaceStencilOp, stencilZPass: THREE.ReplaceStencilOp,
    polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  });
  const cap = new THREE.Mesh(new THREE.PlaneGeometry(size, size), material);
  cap.renderOrder = 1.1;
  cap.onAfterRender = () => renderer.clearStencil();
  shown.cap = cap;
  shown.caps.push(cap);
  group.add(cap);
}

/** Colour the faces by a field, or by themselves where no field is named. */
export function colourBy(name) {
  const scale = (shown.part.scale ?? []).map(colourOf);
  for (const { geometry, material, userData: face } of shown.faces) {
    const place = name ? face.fields?.[name] : null;
    if (place) {
      const steps = shown.part.read(place), colours = new Float32Array(3 * steps.length);
      steps.forEach((step, i) => scale[step].toArray(colours, 3 * i));
      geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
    }
    material.vertexColors = Boolean(place);
    material.color.copy(place ? new THREE.Color(1, 1, 1) : name ? new THREE.Color(0.27, 0.29, 0.32) : colourOf(face.colour));
    material.needsUpdate = true;
  }
}

// -- drawing ----------------------------------------------------------------------------------

const after = [];
/** Have a function called after every picture. */
export const afterDrawing = (action) => after.push(action);
export const counted = { frames: 0 };
let waiting = false;

export function draw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    lamp.position.copy(camera.position);
    lamp.target.position.copy(controls.target);
    renderer.clear();
    renderer.render(scene, camera);
    for (const action of after) action();
    counted.frames += 1;
  });
}
controls.addEventListener("change", draw);

export const theme = {
  dark: matchMedia("(prefers-color-scheme: dark)").matches,
  apply() {
    document.documentElement.classList.toggle("dark", theme.dark);
    renderer.setClearColor(theme.dark ? 0x16181c : 0xffffff);
    for (const line of shown.lines) line.material.color.set(inkColour());
    document.getElementById("theme").textContent = theme.dark ? "Light" : "Dark";
    draw();
  },
};
