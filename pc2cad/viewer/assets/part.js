// Parts: read from the page or from the server that it came from.

const element = (id) => document.getElementById(id);
export const state = JSON.parse(element("state").textContent);
const TYPES = { f4: Float32Array, u4: Uint32Array, i1: Int8Array, u1: Uint8Array };

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

export class Problem extends Error {}
let asked = null;

async function ask(name, signal) {
  const query = new URLSearchParams(state.sliders.map((s) => [s.name, s.value]));
  const answer = await fetch(`${name}?${query}`, { signal });
  if (!answer.ok) throw new Problem(await answer.text());
  return answer;
}

export async function fetchPart() {
  asked?.abort();
  asked = new AbortController();
  return unpack(await (await ask("part", asked.signal)).arrayBuffer());
}

export function storedPart() {
  let index = 0;
  for (const slider of state.sliders) {
    index = index * slider.values.length + slider.values.indexOf(slider.value);
  }
  if (index in state.problems) throw new Problem(state.problems[index]);
  return firstPart(index);
}

export const firstPart = (index = 0) => unpack(bytes(element(`variant-${index}`).textContent));

/** Have the server write a file of the part that is shown, and keep it. */
export async function download(ending, name) {
  const data = await (await ask(`part${ending}`)).blob();
  const link = Object.assign(document.createElement("a"), {
    href: URL.createObjectURL(data), download: `${name}${ending}`,
  });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}
