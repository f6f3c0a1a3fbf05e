// The page of one part. `window.page` tells what is shown; tests and other scripts may read it.
import { box, build, camera, canvas, counted, draw, plane, shown, theme } from "pc2cad/stage";
import { Problem, fetchPart, firstPart, state, storedPart } from "pc2cad/part";
import { cut, isCut, place, showOutline, takeCoordinate } from "pc2cad/section";
import { choose, clear, hitAt, measured, showSizes, take } from "pc2cad/measure";
import { VIEWS, fit, free, home, lookFrom, resize, viewKey } from "pc2cad/views";
import { addFiles, addSliders, describe, hidden, highlight, list, node, paint, reveal, told } from "pc2cad/panel";

const element = (id) => document.getElementById(id);

// -- what is shown of it ----------------------------------------------------------------------

function apply() {
  place();
  const clipping = isCut() ? [plane] : [];
  const points = shown.cloud !== null && element("points").checked;
  for (const mesh of shown.faces) {
    mesh.visible = !points && !hidden.has(mesh.userData.name);
    mesh.material.clippingPlanes = clipping;
  }
  for (const line of shown.lines) line.visible = element("edges").checked;
  for (const line of shown.others) line.visible = !hidden.has(line.userData.name);
  for (const line of [...shown.lines, ...shown.others]) line.material.clippingPlanes = clipping;
  for (const thing of shown.caps) thing.visible = isCut() && !points;
  showOutline(isCut() && !points);
  if (shown.cloud) {
    shown.cloud.visible = points;
    shown.cloud.material.clippingPlanes = clipping;
  }
  draw();
}

function fail(message) {
  page.problem = message;
  element("problem").textContent = message;
  element("problem").hidden = false;
}

// -- pointing ---------------------------------------------------------------------------------

function tell(x, y) {
  const hit = hitAt(x, y), tip = element("tip");
  highlight(hit?.object ?? null);
  tip.hidden = hit === null;
  if (!hit) return;
  const at = hit.point.toArray().map((c) => Number(c.toPrecision(4))).join(", ");
  tip.textContent = `${describe(hit.object.userData)}\nat ${at}`;
  tip.style.left = `${Math.max(Math.min(x + 14, window.innerWidth - tip.offsetWidth - 4), 0)}px`;
  tip.style.top = `${Math.min(y + 14, window.innerHeight - tip.offsetHeight - 4)}px`;
}

let pointer = null, pressed = null;
canvas.addEventListener("pointermove", (event) => {
  if (event.buttons || event.pointerType === "touch") return;
  const first = pointer === null;
  pointer = event;
  if (!first) return;
  requestAnimationFrame(() => {
    const { clientX: x, clientY: y } = pointer;
    pointer = null;
    tell(x, y);
  });
});
canvas.addEventListener("pointerleave", (event) => {
  if (event.pointerType === "touch") return; // a finger leaves whenever it is lifted
  element("tip").hidden = true;
  highlight(null);
});
canvas.addEventListener("pointerdown", (event) => {
  canvas.focus({ preventScroll: true });
  pressed = event.isPrimary ? [event.clientX, event.clientY] : null;
});
canvas.addEventListener("pointerup", (event) => {
  if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 5) return;
  if (measured.mode) take(event.clientX, event.clientY);
  else {
    tell(event.clientX, event.clientY);
    if (told.hovered) reveal(told.hovered);
  }
});

// -- buttons and keys -------------------------------------------------------------------------

const KEYS = `drag, arrows     turn
shift, right drag, two fingers   move
wheel, pinch, + −   zoom
0 whole   f fit   1–6 front back left right top bottom
p point   d distance   t thickness   b size   Esc forget
x y z section across an axis, again for none
e edges   n light or dark   h panel   ? this list`;

const press = (id) => element(id).click();

function section(axis) {
  element("axis").value = element("axis").value === axis ? "" : axis;
  apply();
}

window.addEventListener("keydown", (event) => {
  const typing = event.target.matches?.("input:not([type=checkbox]), select, textarea");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  const { key } = event;
  if (viewKey(event)) event.preventDefault();
  else if ("xyz".includes(key)) section(key);
  else if (key === "p") choose("point");
  else if (key === "d") choose("distance");
  else if (key === "t") choose("thickness");
  else if (key === "b") press("sizes");
  else if (key === "e") press("edges");
  else if (key === "n") press("theme");
  else if (key === "h") press("fold");
  else if (key === "?") press("help");
  else if (key === "Escape") {
    choose("");
    clear();
  }
});

for (const [name, direction, up, key] of VIEWS) {
  const button = node("button", name, { type: "button", title: `from the ${name.toLowerCase()} (${key})` });
  button.dataset.view = name.toLowerCase();
  button.addEventListener("click", () => lookFrom(direction, up));
  element("views").append(button);
}
for (const button of document.querySelectorAll("[data-measure]")) {
  button.addEventListener("click", () => choose(button.dataset.measure));
}
element("clear").addEventListener("click", () => { choose(""); clear(); });
element("sizes").addEventListener("click", ({ currentTarget: button }) => {
  const wanted = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", wanted);
  showSizes(wanted);
  fit();
});
element("theme").addEventListener("click", () => { theme.dark = !theme.dark; theme.apply(); apply(); });
element("help").addEventListener("click", ({ currentTarget: button }) => {
  element("keys").hidden = !element("keys").hidden;
  button.setAttribute("aria-expanded", !element("keys").hidden);
});
element("fold").addEventListener("click", ({ currentTarget: button }) => {
  const away = document.body.classList.toggle("folded");
  button.setAttribute("aria-expanded", !away);
  fit();
});
element("keys").textContent = KEYS;

// -- together ---------------------------------------------------------------------------------

const page = {
  ready: false, problem: null, shown, hidden, camera, measured, cut, theme, box,
  get hovered() { return told.hovered; },
  get frames() { return counted.frames; },
  get middle() {
    const room = free();
    return [(room.left + room.right) / 2, (room.top + room.bottom) / 2];
  },
};
window.page = page;
let turn = 0;

async function load() {
  const mine = ++turn;
  try {
    const opening = !page.ready && state.live;
    const part = opening ? await firstPart() : state.live ? await fetchPart() : await storedPart();
    if (mine !== turn) return; // the slider has moved on
    const first = !page.ready;
    build(part);
    list(part, apply);
    paint();
    clear();
    showSizes(element("sizes").getAttribute("aria-pressed") === "true");
    if (first) home();
    element("problem").hidden = true;
    Object.assign(page, { ready: true, problem: null, part });
    apply();
  } catch (error) {
    if (error.name === "AbortError" || mine !== turn) return;
    fail(error instanceof Problem ? error.message : `the page failed: ${error}`);
    page.ready = true;
  }
}

for (const id of ["axis", "place", "flip", "edges", "points"]) element(id).addEventListener("input", apply);
element("field").addEventListener("input", () => { paint(); draw(); });
element("at").addEventListener("input", () => { takeCoordinate(); apply(); });
element("home").addEventListener("click", home);
element("fit").addEventListener("click", fit);
window.addEventListener("resize", resize);
addSliders(load);
addFiles(fail);
theme.apply();
load();
