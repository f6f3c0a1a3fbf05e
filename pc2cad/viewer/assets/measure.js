// Measuring: points, distances, the wall's thickness, the size of the whole; labels in the picture.
import * as THREE from "three";
import { afterDrawing, box, camera, canvas, draw, inkColour, scene, shown } from "pc2cad/stage";
import { keeps, short } from "pc2cad/section";

const element = (id) => document.getElementById(id);
const raycaster = new THREE.Raycaster();
const REACH = 9; // pixels from a corner or an edge in which it is meant
export const measured = { mode: "", first: null, results: [] };
const drawn = new THREE.Group(), sizes = new THREE.Group();
const labels = []; // {span, point}
scene.add(drawn, sizes);

function aim(x, y) {
  camera.updateMatrixWorld();
  const { left, top, width, height } = canvas.getBoundingClientRect();
  raycaster.setFromCamera(
    new THREE.Vector2((2 * (x - left)) / width - 1, 1 - (2 * (y - top)) / height), camera);
}

const visible = () => shown.faces.filter((mesh) => mesh.visible);

/** The first point of a face under a place of the window, null where there is none. */
export function hitAt(x, y) {
  aim(x, y);
  raycaster.near = 0;
  return raycaster.intersectObjects(visible(), false).find((hit) => keeps(hit.point)) ?? null;
}

const onScreen = (point) => {
  const at = point.clone().project(camera);
  return [((1 + at.x) / 2) * window.innerWidth, ((1 - at.y) / 2) * window.innerHeight];
};

/** The point that is meant: a corner or a place of an edge that is near, else the face's point. */
function meant(x, y) {
  const hit = hitAt(x, y);
  const depth = (point) => point.clone().project(camera).z;
  const front = hit ? depth(hit.point) + 2e-4 : Infinity;
  let best = null;
  for (const line of shown.lines.filter((each) => each.visible)) {
    const path = line.geometry.attributes.position, last = path.count - 1;
    let before = null;
    for (let i = 0; i <= last; i++) {
      const point = new THREE.Vector3().fromBufferAttribute(path, i), at = onScreen(point);
      const end = i === 0 || i === last;
      const tries = end ? [[point, Math.hypot(at[0] - x, at[1] - y) / 1.5, "corner"]] : [];
      if (before) tries.push(between(before, [point, at], x, y));
      before = [point, at];
      for (const [place, off, kind] of tries) {
        if (off < (best?.off ?? REACH) && depth(place) <= front && keeps(place)) best = { point: place, off, name: kind };
      }
    }
  }
  if (best) return best;
  return hit && { point: hit.point, name: hit.object.userData.name };
}

/** The nearest place of a piece of an edge, and how far from the pointer it is. */
function between([a, from], [b, to], x, y) {
  const along = [to[0] - from[0], to[1] - from[1]];
  const square = along[0] ** 2 + along[1] ** 2;
  const share = square ? ((x - from[0]) * along[0] + (y - from[1]) * along[1]) / square : 0;
  const t = Math.min(Math.max(share, 0), 1);
  const off = Math.hypot(from[0] + t * along[0] - x, from[1] + t * along[1] - y);
  return [a.clone().lerp(b, t), off, "edge"];
}

/** Thickness at a point of a face: along the normal of its triangle to where the solid ends. */
function thickness(hit) {
  const inward = hit.face.normal.clone().negate();
  const size = box.getSize(new THREE.Vector3()).length();
  raycaster.set(hit.point.clone().addScaledVector(inward, 1e-6 * size), inward);
  raycaster.near = 0;
  const other = raycaster.intersectObjects(shown.faces, false)[0];
  return other ?? null;
}

/** Take a point for what is being measured; true where one was taken. */
export function take(x, y) {
  const { units } = shown.part;
  if (measured.mode === "thickness") {
    const hit = hitAt(x, y), other = hit && thickness(hit);
    if (!other) return false;
    const value = hit.point.distanceTo(other.point);
    add({ kind: "thickness", value, from: hit.point, to: other.point,
      text: `thickness ${short(value, 5)} ${units}\nfrom ${hit.object.userData.name} to ${other.object.userData.name}` });
    return true;
  }
  const found = meant(x, y);
  if (!found) return false;
  const { point, name } = found;
  if (measured.mode === "point") {
    add({ kind: "point", value: point.toArray(), from: point,
      text: `${point.toArray().map((c) => short(c, 5)).join(", ")}\non ${name}` });
  } else if (!measured.first) {
    measured.first = point;
    mark(point);
  } else {
    const value = measured.first.distanceTo(point), by = point.clone().sub(measured.first);
    add({ kind: "distance", value, from: measured.first, to: point,
      text: `distance ${short(value, 5)} ${units}\nΔ ${by.toArray().map((c) => short(c, 4)).join(", ")}` });
    measured.first = null;
  }
  draw();
  return true;
}

function add(result) {
  measured.results.push(result);
  mark(result.from);
  if (result.to) {
    mark(result.to);
    line(drawn, [result.from, result.to], getComputedStyle(document.documentElement).getPropertyValue("--mark"));
  }
  const middle = result.to ? result.from.clone().lerp(result.to, 0.5) : result.from;
  label(drawn, middle, result.text.split("\n")[0].replace(/^\w+ (?=[\d.])/, ""), "point");
  const row = Object.assign(document.createElement("li"), { textContent: result.text });
  element("measurements").append(row);
  element("measured").hidden = false;
  draw();
}

function line(group, points, colour) {
  const geometry = new THREE.BufferGeometry().setFromPoints(points);
  const made = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: colour, depthTest: false }));
  made.renderOrder = 20;
  group.add(made);
}

function mark(point) {
  const geometry = new THREE.BufferGeometry().setFromPoints([point]);
  const colour = getComputedStyle(document.documentElement).getPropertyValue("--mark");
  const made = new THREE.Points(geometry, new THREE.PointsMaterial({ color: colour, size: 6, sizeAttenuation: false, depthTest: false }));
  made.renderOrder = 21;
  drawn.add(made);
}

function label(group, point, text, kind = "") {
  const span = Object.assign(document.createElement("span"), { textContent: text, className: kind });
  element("labels").append(span);
  labels.push({ span, point, group });
}

function empty(group) {
  for (const thing of group.children) {
    thing.geometry.dispose();
    thing.material.dispose();
  }
  group.clear();
  for (let i = labels.length - 1; i >= 0; i--) {
    if (labels[i].group !== group) continue;
    labels[i].span.remove();
    labels.splice(i, 1);
  }
}

export function clear() {
  empty(drawn);
  Object.assign(measured, { first: null, results: [] });
  element("measurements").replaceChildren();
  element("measured").hidden = true;
  draw();
}

/** Begin to measure, or end it where it was being done. */
export function choose(mode) {
  measured.mode = measured.mode === mode ? "" : mode;
  measured.first = null;
  for (const button of document.querySelectorAll("[data-measure]")) {
    button.setAttribute("aria-pressed", button.dataset.measure === measured.mode);
  }
  canvas.classList.toggle("measuring", measured.mode !== "");
}

/** Show or hide the size of the whole: its box, with its three lengths. */
export function showSizes(wanted) {
  empty(sizes);
  if (wanted) {
    const { min, max } = box, colour = inkColour();
    const corner = (i) => new THREE.Vector3(i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z);
    for (let i = 0; i < 8; i++) {
      for (const bit of [1, 2, 4]) if (!(i & bit)) line(sizes, [corner(i), corner(i | bit)], colour);
    }
    for (const thing of sizes.children) Object.assign(thing.material, { transparent: true, opacity: 0.35, depthTest: true });
    for (const [from, to, axis] of [[0, 1, "x"], [1, 3, "y"], [3, 7, "z"]]) {
      const a = corner(from), b = corner(to);
      label(sizes, a.clone().lerp(b, 0.5), `${axis} ${short(b[axis] - a[axis], 5)} ${shown.part.units}`);
    }
  }
  draw();
}

afterDrawing(() => {
  for (const { span, point } of labels) {
    const [x, y] = onScreen(point);
    span.style.left = `${x}px`;
    span.style.top = `${y}px`;
  }
});
