// The panel: facts, the tree of sides and bodies, sliders, files.
import { colourBy, colourOf, draw, shown } from "pc2cad/stage";
import { Problem, download, state } from "pc2cad/part";

const element = (id) => document.getElementById(id);
export const hidden = new Set();
export const told = { hovered: null };

export function node(tag, text = "", properties = {}) {
  const made = Object.assign(document.createElement(tag), properties);
  if (text) made.textContent = text;
  return made;
}

export function describe(face) {
  const off = face.evidence === "exact" ? "exact"
    : `${face.evidence}, within ${face.deviation.toPrecision(2)} ${shown.part.units}`;
  return `${face.name}\n${face.carrier}\n${off}\narea ${face.area.toPrecision(8)} ${shown.part.units}²`;
}

export function highlight(mesh) {
  const name = mesh?.userData.name ?? null;
  if (told.hovered === name) return;
  told.hovered = name;
  for (const face of shown.faces) face.material.emissive.setHex(face === mesh ? 0x333333 : 0);
  for (const row of element("sides").querySelectorAll("li[data-name]")) {
    row.classList.toggle("hover", row.dataset.name === name);
  }
  draw();
}

// -- the tree ---------------------------------------------------------------------------------

/** Fill the panel with a part; `changed` is called when something is hidden or shown. */
export function list(part, changed) {
  element("facts").replaceChildren(
    ...part.facts.flatMap(([name, value]) => [node("dt", name), node("dd", value)]));
  element("unit").textContent = part.units;
  element("how").textContent = `on triangles within ${Number(part.deflection.toPrecision(2))} ${part.units}`;
  const branches = new Map(); // body -> side -> its rows
  const put = (body, side, row) => {
    const sides = branches.get(body) ?? branches.set(body, new Map()).get(body);
    sides.set(side, [...(sides.get(side) ?? []), row]);
  };
  const several = part.faces.some((face) => face.name.includes(":"));
  part.faces.forEach((face, i) => {
    const cut = face.name.lastIndexOf(":");
    const body = several ? (cut < 0 ? "other faces" : face.name.slice(0, cut)) : "faces";
    put(body, face.side, leaf(face.name, cut < 0 ? face.name : face.name.slice(cut + 1), face.carrier, face.colour,
      describe(face), () => shown.faces[i], changed));
  });
  for (const other of part.others) {
    const detail = other.detail ? ` ${other.detail}` : "";
    put("no faces", other.side, leaf(other.name, other.name, `${other.fate}${detail}`, other.colour,
      `${other.name} is no face: ${other.fate}${detail} (${other.verdict})`, () => null, changed, !other.path));
  }
  element("sides").replaceChildren(...[...branches].map(([body, sides]) => branch(body, body,
    [...sides].flatMap(([side, rows]) => rows.length > 1 ? branch(`${body}, ${side}`, side, rows) : rows))));
  element("points-label").hidden = !part.points;
  listFields(part);
}

/** Offer the fields of a part; one that was chosen stays, where the part has it. */
function listFields(part) {
  const select = element("field"), chosen = select.value;
  element("field-label").hidden = !part.fields.length;
  select.replaceChildren(node("option", "side", { value: "" }), ...part.fields.map(({ name }) => node("option", name)));
  select.value = part.fields.some(({ name }) => name === chosen) ? chosen : "";
}

/** Colour the faces by what is chosen, and show its scale. */
export function paint() {
  const name = element("field").value, part = shown.part;
  colourBy(name);
  const field = part.fields.find((each) => each.name === name);
  element("scale").hidden = !field;
  if (!field) return;
  const stops = part.scale.filter((_, i) => i % 15 === 0).map((rgb) => `rgb(${rgb.map((c) => Math.round(255 * c)).join(" ")})`);
  element("ramp").style.background = `linear-gradient(to right, ${stops.join(", ")})`;
  element("low").textContent = Number(field.low.toPrecision(5));
  element("high").textContent = Number(field.high.toPrecision(5));
}

const folded = new Map(); // branches that were folded or unfolded; those of a side's pieces are folded first

function branch(key, name, rows) {
  const leaves = rows.flatMap((row) => row.dataset.name ? [row] : [...row.querySelectorAll("li[data-name]")]);
  const ticks = leaves.map((each) => each.querySelector("input"));
  const shut = folded.get(key) ?? key !== name;
  const all = node("input", "", { type: "checkbox" });
  all.setAttribute("aria-label", `show all of ${name}`);
  const free = ticks.filter((tick) => !tick.disabled);
  const tell = () => {
    const on = free.filter((tick) => tick.checked).length;
    Object.assign(all, { checked: on > 0 && on === free.length, indeterminate: on > 0 && on < free.length, disabled: !free.length });
  };
  all.addEventListener("change", () => {
    for (const tick of free) if (tick.checked !== all.checked) tick.click();
  });
  for (const tick of free) tick.addEventListener("change", tell);
  tell();
  const inner = node("ul", "", { hidden: shut });
  inner.append(...rows);
  const opener = node("button", shut ? "▸" : "▾", { type: "button", className: "opener" });
  opener.setAttribute("aria-expanded", !shut);
  opener.setAttribute("aria-label", `fold ${name}`);
  opener.addEventListener("click", () => {
    inner.hidden = !inner.hidden;
    folded.set(key, inner.hidden);
    opener.textContent = inner.hidden ? "▸" : "▾";
    opener.setAttribute("aria-expanded", !inner.hidden);
  });
  const line = node("div", "", { className: "row" });
  line.append(opener, all, node("span", name), node("small", String(leaves.length)));
  const item = node("li");
  item.append(line, inner);
  return item;
}

function leaf(key, name, about, colour, title, mesh, changed, fixed = false) {
  const tick = node("input", "", { type: "checkbox", checked: !fixed && !hidden.has(key), disabled: fixed });
  tick.setAttribute("aria-label", `show ${key}`);
  tick.addEventListener("change", () => {
    if (tick.checked) hidden.delete(key);
    else hidden.add(key);
    changed();
  });
  const swatch = node("span", "", { className: "swatch" });
  if (colour) swatch.style.background = `#${colourOf(colour).getHexString()}`;
  const line = node("div", "", { className: "row" });
  line.append(tick, swatch, node("span", name), node("small", about));
  const item = node("li", "", { title });
  item.dataset.name = key;
  item.append(line);
  item.addEventListener("pointerenter", () => highlight(mesh()));
  item.addEventListener("pointerleave", () => highlight(null));
  return item;
}

/** Bring a side's row into sight. */
export function reveal(name) {
  const row = [...element("sides").querySelectorAll("li[data-name]")].find((each) => each.dataset.name === name);
  for (let shut = row?.closest("ul[hidden]"); shut; shut = row.closest("ul[hidden]")) {
    shut.previousElementSibling.querySelector(".opener").click();
  }
  row?.scrollIntoView({ block: "nearest" });
}

// -- sliders and files ------------------------------------------------------------------------

export function addSliders(load) {
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

export function addFiles(fail) {
  element("files").hidden = state.files.length === 0;
  for (const ending of state.files) {
    const button = node("button", ending.slice(1).toUpperCase(), { type: "button" });
    button.dataset.file = ending;
    button.addEventListener("click", async () => {
      button.disabled = true;
      try {
        await download(ending, state.name);
      } catch (error) {
        fail(error instanceof Problem ? error.message : `no file came: ${error}`);
      }
      button.disabled = false;
    });
    element("files").append(button);
  }
}
