// The section: a plane across an axis, the cap on it, its outline, and what is read off it.
import * as THREE from "three";
import { box, inkColour, plane, scene, shown } from "pc2cad/stage";

const element = (id) => document.getElementById(id);
export const short = (value, digits = 6) => String(Number(value.toPrecision(digits)));
let outline = null;

const axis = () => element("axis").value;
export const isCut = () => axis() !== "";
export const keeps = (point) => !isCut() || plane.distanceToPoint(point) >= 0;

/** Put the plane where the controls say; return its coordinate, null for none. */
export function place() {
  if (outline) {
    scene.remove(outline);
    outline.geometry.dispose();
    outline.material.dispose();
    outline = null;
  }
  for (const id of ["place", "flip", "at"]) element(id).disabled = !isCut();
  element("cut").hidden = !isCut();
  if (!isCut()) return null;
  const sign = element("flip").checked ? 1 : -1;
  const low = box.min[axis()], high = box.max[axis()];
  const at = low + (high - low) * Number(element("place").value);
  plane.normal.set(0, 0, 0);
  plane.normal[axis()] = sign;
  plane.constant = -sign * at;
  const middle = box.getCenter(new THREE.Vector3());
  middle[axis()] = at;
  shown.cap.position.copy(middle);
  shown.cap.lookAt(middle.clone().sub(plane.normal));
  if (document.activeElement !== element("at")) element("at").value = short(at);
  trace(at);
  return at;
}

/** Take the place from its coordinate. */
export function takeCoordinate() {
  const low = box.min[axis()], high = box.max[axis()];
  const share = (Number(element("at").value) - low) / (high - low || 1);
  element("place").value = Math.min(Math.max(share, 0), 1);
}

/** Draw the outline, and say how long it is and what it holds. */
function trace(at) {
  const k = "xyz".indexOf(axis()), p = (k + 1) % 3, q = (k + 2) % 3;
  const ends = [];
  let area = 0, length = 0;
  for (const { geometry } of shown.faces) {
    const points = geometry.attributes.position.array, corners = geometry.index.array;
    for (let t = 0; t < corners.length; t += 3) {
      const [entry, exit] = crossing(points, corners, t, k, at);
      if (!entry) continue;
      ends.push(...entry, ...exit);
      length += Math.hypot(exit[p] - entry[p], exit[q] - entry[q]);
      area += (entry[p] * exit[q] - entry[q] * exit[p]) / 2;
    }
  }
  const { units } = shown.part;
  element("cut").textContent = `area ${short(Math.abs(area))} ${units}², outline ${short(length)} ${units}`;
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(ends, 3));
  outline = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: inkColour() }));
  outline.renderOrder = 8;
  outline.visible = shown.cap.visible;
  scene.add(outline);
  Object.assign(cut, { area: Math.abs(area), length, at });
}

/** What the last section measured. */
export const cut = { area: 0, length: 0, at: 0 };

/** Where a triangle goes through the plane, as it is turned: from its far side to its near one. */
function crossing(points, corners, t, k, at) {
  const above = [0, 1, 2].map((i) => points[3 * corners[t + i] + k] >= at);
  if (above[0] === above[1] && above[1] === above[2]) return [null, null];
  let entry = null, exit = null;
  for (let i = 0; i < 3; i++) {
    const j = (i + 1) % 3;
    if (above[i] === above[j]) continue;
    const a = 3 * corners[t + i], b = 3 * corners[t + j];
    const share = (at - points[a + k]) / (points[b + k] - points[a + k]);
    const found = [0, 1, 2].map((m) => points[a + m] + share * (points[b + m] - points[a + m]));
    if (above[j]) entry = found;
    else exit = found;
  }
  return [entry, exit];
}

export const showOutline = (visible) => { if (outline) outline.visible = visible; };
