// The page of one part. `window.page` tells what is shown; tests and other scripts may read it.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const element = (id) => document.getElementById(id);
const state = JSON.parse(element("state").textContent);
const TYPES = { f4: Float32Array, u4: Uint32Array, i1: Int8Array, u1: Uint8Array };

// -- reading ----------------------------------------------------------------------------------

async function unpack(compressed) {
  const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const raw = await new Response(stream).arrayBuffer();
  const length = new DataView(raw).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(raw, 4, length)));
  header.read = (place) => new TYPES[place.type](raw, 4 + length + place.at, place.count);
  return header;
}

function bytes(base64) {
  const text = atob(base64);
  const result = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) result[i] = text.charCodeAt(i);
  return result;
}

class Problem extends Error {}
let asked = null;

async function fetchPart() {
  asked?.abort();
  asked = new AbortController();
  const query = new URLSearchParams(state.sliders.map((s) => [s.name, s.value]));
  const answer = await fetch(`part?${query}`, { signal: asked.signal });
  if (!answer.ok) throw new Problem(await answer.text());
  return unpack(await answer.arrayBuffer());
}

function storedPart() {
  let index = 0;
  for (const slider of state.sliders) {
    index = index * slider.values.length + slider.values.indexOf(slider.value);
  }
  if (index in state.problems) throw new Problem(state.problems[index]);
  return unpack(bytes(element(`variant-${index}`).textContent));
}

// -- the scene --------------------------------------------------------------------------------

const canvas = element("canvas");
const renderer = new THREE.WebGLRenderer({
  canvas, antialias: true, stencil: true, preserveDrawingBuffer: true,
});
renderer.localClippingEnabled = true;
renderer.setClearColor(0xffffff);
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(30, 1, 0.01, 100);
camera.up.set(0, 0, 1);
const controls = new OrbitControls(camera, canvas);
scene.add(new THREE.HemisphereLight(0xffffff, 0xb8bcc6, 1.5));
const lamp = new THREE.DirectionalLight(0xffffff, 1.8);
scene.add(lamp, lamp.target);

const plane = new THREE.Plane(new THREE.Vector3(-1, 0, 0), 0);
const shown = { faces: [], lines: [], others: [], caps: [], cloud: null, part: null };
const hidden = new Set();
const box = new THREE.Box3();
const group = new THREE.Group();
scene.add(group);

const colourOf = (rgb) => new THREE.Color().setRGB(...rgb, THREE.SRGBColorSpace);

function attribute(part, place, size, normalized = false) {
  return new THREE.BufferAttribute(part.read(place), size, normalized);
}

function dispose() {
  group.traverse((thing) => {
    thing.geometry?.dispose();
    thing.material?.dispose();
  });
  group.clear();
  Object.assign(shown, { faces: [], lines: [], others: [], caps: [], cloud: null });
}

function build(part) {
  dispose();
  shown.part = part;
  box.makeEmpty();
  for (const face of part.faces) addFace(part, face);
  for (const place of part.edges) shown.lines.push(addLine(part, place, 0x1f2023, 1));
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
  });
  const cap = new THREE.Mesh(new THREE.PlaneGeometry(size, size), material);
  cap.renderOrder = 1.1;
  cap.onAfterRender = () => renderer.clearStencil();
  shown.cap = cap;
  shown.caps.push(cap);
  group.add(cap);
}

// -- what is shown of it ----------------------------------------------------------------------

function apply() {
  const axis = element("axis").value;
  const cut = axis !== "";
  if (cut) {
    const sign = element("flip").checked ? 1 : -1;
    const low = box.min[axis], high = box.max[axis];
    const at = low + (high - low) * Number(element("place").value);
    plane.normal.set(0, 0, 0);
    plane.normal[axis] = sign;
    plane.constant = -sign * at;
    const middle = box.getCenter(new THREE.Vector3());
    middle[axis] = at;
    shown.cap.position.copy(middle);
    shown.cap.lookAt(middle.clone().sub(plane.normal));
  }
  element("place").disabled = element("flip").disabled = !cut;
  const points = shown.cloud !== null && element("points").checked;
  for (const mesh of shown.faces) {
    mesh.visible = !points && !hidden.has(mesh.userData.name);
    mesh.material.clippingPlanes = cut ? [plane] : [];
  }
  for (const line of shown.lines) line.visible = element("edges").checked;
  for (const line of shown.others) line.visible = !hidden.has(line.userData.name);
  for (const line of [...shown.lines, ...shown.others]) line.material.clippingPlanes = cut ? [plane] : [];
  for (const thing of shown.caps) thing.visible = cut && !points;
  if (shown.cloud) {
    shown.cloud.visible = points;
    shown.cloud.material.clippingPlanes = cut ? [plane] : [];
  }
  draw();
}

function home() {
  resize();
  const centre = box.getCenter(new THREE.Vector3());
  const toward = new THREE.Vector3(1, -1, 0.8).normalize();
  const right = new THREE.Vector3().crossVectors(camera.up, toward).normalize();
  const up = new THREE.Vector3().crossVectors(toward, right);
  const high = Math.tan((camera.fov * Math.PI) / 360) * 0.92;
  let away = 0;
  for (let corner = 0; corner < 8; corner++) {
    const at = new THREE.Vector3(
      corner & 1 ? box.max.x : box.min.x, corner & 2 ? box.max.y : box.min.y,
      corner & 4 ? box.max.z : box.min.z).sub(centre);
    const needed = Math.max(Math.abs(at.dot(right)) / (high * camera.aspect), Math.abs(at.dot(up)) / high);
    away = Math.max(away, needed + at.dot(toward));
  }
  camera.position.copy(centre).addScaledVector(toward, away);
  camera.near = away / 1000;
  camera.far = away * 10;
  camera.updateProjectionMatrix();
  controls.target.copy(centre);
  controls.update();
  draw();
}

let waiting = false;
function draw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    lamp.position.copy(camera.position);
    lamp.target.position.copy(controls.target);
    renderer.render(scene, camera);
    page.frames += 1;
  });
}

function resize() {
  const { clientWidth: width, clientHeight: height } = canvas;
  renderer.setPixelRatio(window.devicePixelRatio);
  renderer.setSize(width, height, false);
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  draw();
}

// -- hovering ---------------------------------------------------------------------------------

const raycaster = new THREE.Raycaster();

function faceAt(x, y) {
  const { left, top, width, height } = canvas.getBoundingClientRect();
  raycaster.setFromCamera(
    new THREE.Vector2((2 * (x - left)) / width - 1, 1 - (2 * (y - top)) / height), camera);
  const cut = element("axis").value !== "";
  const hits = raycaster.intersectObjects(shown.faces.filter((mesh) => mesh.visible), false);
  return hits.find((hit) => !cut || plane.distanceToPoint(hit.point) >= 0)?.object ?? null;
}

function describe(face) {
  const off = face.evidence === "exact" ? "exact"
    : `${face.evidence}, within ${face.deviation.toPrecision(2)} ${shown.part.units}`;
  return `${face.name}\n${face.carrier}\n${off}\narea ${face.area.toPrecision(8)} ${shown.part.units}²`;
}

function highlight(mesh) {
  if (page.hovered === (mesh?.userData.name ?? null)) return;
  page.hovered = mesh?.userData.name ?? null;
  for (const face of shown.faces) face.material.emissive.setHex(face === mesh ? 0x333333 : 0);
  for (const row of element("sides").children) {
    row.classList.toggle("hover", row.dataset.name === page.hovered);
  }
  draw();
}

let pointer = null;
canvas.addEventListener("pointermove", (event) => {
  if (event.buttons) return;
  const first = pointer === null;
  pointer = event;
  if (!first) return;
  requestAnimationFrame(() => {
    const { clientX: x, clientY: y } = pointer;
    pointer = null;
    const mesh = faceAt(x, y);
    highlight(mesh);
    const tip = element("tip");
    tip.hidden = mesh === null;
    if (mesh) {
      tip.textContent = describe(mesh.userData);
      tip.style.left = `${Math.min(x + 14, canvas.clientWidth - 200)}px`;
      tip.style.top = `${y + 14}px`;
    }
  });
});
canvas.addEventListener("pointerleave", () => { element("tip").hidden = true; highlight(null); });

// -- the panel --------------------------------------------------------------------------------

function node(tag, text = "", properties = {}) {
  const made = Object.assign(document.createElement(tag), properties);
  if (text) made.textContent = text;
  return made;
}

function list(part) {
  element("facts").replaceChildren(
    ...part.facts.flatMap(([name, value]) => [node("dt", name), node("dd", value)]));
  const rows = part.faces.map((face, i) => row(face.name, face.carrier, face.colour, describe(face),
    () => shown.faces[i]));
  for (const other of part.others) {
    const detail = other.detail ? ` ${other.detail}` : "";
    rows.push(row(other.name, `${other.fate}${detail}`, other.colour,
      `${other.name} is no face: ${other.fate}${detail} (${other.verdict})`, () => null, !other.path));
  }
  element("sides").replaceChildren(...rows);
  element("points-label").hidden = !part.points;
}

function row(name, about, colour, title, mesh, fixed = false) {
  const tick = node("input", "", { type: "checkbox", checked: !fixed && !hidden.has(name), disabled: fixed });
  tick.setAttribute("aria-label", `show ${name}`);
  tick.addEventListener("change", () => {
    if (tick.checked) hidden.delete(name);
    else hidden.add(name);
    apply();
  });
  const swatch = node("span", "", { className: "swatch" });
  if (colour) swatch.style.background = `#${colourOf(colour).getHexString()}`;
  const line = node("li", "", { title });
  line.dataset.name = name;
  line.append(tick, swatch, node("span", name), node("small", about));
  line.addEventListener("pointerenter", () => highlight(mesh()));
  line.addEventListener("pointerleave", () => highlight(null));
  return line;
}

function addSliders() {
  element("parameters").hidden = state.sliders.length === 0;
  for (const slider of state.sliders) {
    const fixed = slider.values.length > 0;
    const input = node("input", "", { type: "range", name: slider.name });
    const [low, high, step] = fixed ? [0, slider.values.length - 1, 1]
      : [slider.low, slider.high, (slider.high - slider.low) / 200];
    Object.assign(input, { min: low, max: high, step });
    input.value = fixed ? slider.values.indexOf(slider.value) : slider.value;
    const shownValue = node("output", String(slider.value));
    input.addEventListener("input", () => {
      slider.value = fixed ? slider.values[Number(input.value)] : Number(input.value);
      shownValue.textContent = Number(slider.value.toPrecision(6));
      load();
    });
    const block = node("label", "", { className: "slider" });
    block.append(node("span", slider.name), shownValue, input, node("small", slider.about));
    element("parameters").append(block);
  }
}

// -- together ---------------------------------------------------------------------------------

const page = { ready: false, frames: 0, hovered: null, problem: null, shown, hidden, camera };
window.page = page;
let turn = 0;

async function load() {
  const mine = ++turn;
  try {
    const opening = !page.ready && state.live;
    const part = opening ? await unpack(bytes(element("variant-0").textContent))
      : state.live ? await fetchPart() : await storedPart();
    if (mine !== turn) return; // the slider has moved on
    const first = !page.ready;
    build(part);
    list(part);
    if (first) home();
    element("problem").hidden = true;
    Object.assign(page, { ready: true, problem: null, part });
    apply();
  } catch (error) {
    if (error.name === "AbortError" || mine !== turn) return;
    page.problem = error instanceof Problem ? error.message : `the page failed: ${error}`;
    element("problem").textContent = page.problem;
    element("problem").hidden = false;
    page.ready = true;
  }
}

for (const id of ["axis", "place", "flip", "edges", "points"]) element(id).addEventListener("input", apply);
element("home").addEventListener("click", home);
controls.addEventListener("change", draw);
window.addEventListener("resize", resize);
addSliders();
load();
