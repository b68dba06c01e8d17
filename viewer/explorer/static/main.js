// Starts the page: reads the dataset, opens what the address names, and listens to keys.

import { get, opening } from "./api.js";
import * as browse from "./browse.js";
import * as pictures from "./pictures.js";
import * as readout from "./readout.js";
import { onChange, read, set, state, write } from "./state.js";

const $ = id => document.getElementById(id);
const KEYS = [
  ["n  p", "next and previous pair"], ["x", "swap source and target"], ["← ↑ → ↓", "move the point by 1 px, with Shift by 10"],
  ["Enter", "pin or release the point"], ["1 to 7", "layers"], ["h", "heat map on or off"], ["m", "next method"], ["z", "magnifier on or off"],
  ["v", "pictures or 3D"], ["space", "play, in 3D"], ["t", "light or dark"], ["?", "this help"],
];
let data, scene = null;

async function main() {
  theme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
  data = await get("dataset");
  $("title").textContent = data.title;
  document.title = `${data.title} · Pliant`;
  onChange(write);
  set(given());
  browse.start(data); pictures.start(data); readout.start(data);
  wire();
  await fill();
  document.body.dataset.ready = "yes";
}

/** What an empty address shows: the first pair, else the first two frames of the first sequence, else its frame and one of another sequence of its tier. */
function first() {
  if (data.pairs.length) {
    const [, , a, frameA, b, frameB] = data.pairs[0];
    return { a: `${data.sequences[a][0]}/${frameA}`, b: `${data.sequences[b][0]}/${frameB}` };
  }
  const [name, tier, , , frames] = data.sequences[0];
  const other = data.sequences.find((each, k) => k && each[1] === tier);
  return { a: `${name}/0`, b: frames > 1 || !other ? `${name}/${Math.min(1, frames - 1)}` : `${other[0]}/0` };
}

/** Where no point is named: that of a query of the pair, else one on the object, else the middle of the picture. */
async function fill() {
  const { a, b } = state;
  if (state.u !== null) return;
  const queries = await get("queries", { a, b }).catch(() => []);
  const found = await opening(queries, { a, b }) ?? await get("start", { frame: a }).catch(() => null) ?? data.size.map(side => side / 2);
  if (state.u === null && state.a === a) pictures.move(...found);
}

/** What the address names, without what the dataset does not have. */
function given() {
  const next = read(first());
  const tier = frame => {
    const [name, index] = browse.split(frame);
    return data.sequences.find(each => each[0] === name && Number.isInteger(index) && index >= 0 && index < each[4])?.[1];
  };
  if (!tier(next.a) || tier(next.a) !== tier(next.b)) Object.assign(next, first(), { u: null, v: null });
  const inside = (x, size) => x !== null && x >= 0 && x < size;
  if (!inside(next.u, data.size[0]) || !inside(next.v, data.size[1])) next.u = next.v = null;
  if (!data.methods[next.method]) next.method = 0;
  if (!pictures.isLayer(next.layer)) next.layer = "rgb";
  if (next.tab !== "scene") next.tab = "compare";
  return next;
}

function theme(name) {
  document.documentElement.dataset.theme = name;
  $("theme").textContent = name === "dark" ? "Light" : "Dark";
  scene?.recolour();
}

async function tab() {
  for (const name of ["compare", "scene"]) {
    $(name).hidden = state.tab !== name;
    $(`tab-${name}`).setAttribute("aria-selected", String(state.tab === name));
  }
  if (state.tab !== "scene") { scene?.pause(); return; }
  if (!scene) {
    const found = await import("./scene.js"); // three.js is read when it is needed
    try { found.start(data, readout.positions); }
    catch (error) { $("scene-note").textContent = `This browser cannot show 3D: ${error.message}`; return; }
    scene = found;
  }
  scene.wake();
}

function nextMethod() {
  const usable = [...data.methods.keys()];
  if (usable.length) set({ method: usable[(usable.indexOf(state.method) + 1) % usable.length] });
}

function wire() {
  $("tab-compare").onclick = () => set({ tab: "compare" });
  $("tab-scene").onclick = () => set({ tab: "scene" });
  $("theme").onclick = () => {
    const chosen = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    localStorage.setItem("theme", chosen);
    theme(chosen);
  };
  $("previous").onclick = () => browse.step(-1);
  $("next").onclick = () => browse.step(1);
  $("swap").onclick = swap;
  $("help-open").onclick = () => $("help").showModal();
  for (const [key, text] of KEYS) {
    const name = document.createElement("dt"), about = document.createElement("dd");
    for (const each of key.split(/\s+/)) {
      if (each === "to") { name.append(" to "); continue; }
      name.append(Object.assign(document.createElement("kbd"), { textContent: each }), " ");
    }
    about.textContent = text;
    $("keys").append(name, about);
  }
  if (matchMedia("(max-width: 56rem)").matches) $("browse").open = false;
  onChange(changed => { if (changed.has("tab")) tab(); });
  document.addEventListener("missing", () => {
    $("tab-scene").title = pictures.missing.scene ?? "";
    $("tab-scene").disabled = Boolean(pictures.missing.scene);
    if (pictures.missing.scene) set({ tab: "compare" });
    else if (!scene) tab(); // as the address says
  });
  window.addEventListener("hashchange", () => set(given()));
  document.addEventListener("keydown", keydown);
}

/** Exchange the pictures; the true place becomes the point, where the target shows it. */
function swap() {
  const truth = pictures.shownTruth();
  set({ a: state.b, b: state.a, u: null, v: null, pinned: false });
  if (truth?.visibility === "visible") pictures.move(...truth.place);
}

function keydown(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || $("help").open) return;
  const field = event.target.closest?.("input, select, textarea");
  if (field && (event.key.startsWith("Arrow") || field.tagName === "SELECT" || event.key === " ")) return;
  const by = event.shiftKey ? 10 : 1;
  const moves = { ArrowLeft: [-by, 0], ArrowRight: [by, 0], ArrowUp: [0, -by], ArrowDown: [0, by] };
  const layers = [...$("layers").children];
  const actions = {
    n: () => browse.step(1), p: () => browse.step(-1), x: swap,
    h: () => set({ heat: !state.heat }), z: () => set({ lens: !state.lens }), m: nextMethod, t: () => $("theme").click(),
    v: () => $(state.tab === "scene" ? "tab-compare" : "tab-scene").click(),
    "?": () => $("help").showModal(),
  };
  if (state.tab === "scene") {
    actions[" "] = () => scene?.toggle();
    if (moves[event.key] && !event.target.closest?.("button")) actions[event.key] = () => scene?.step(moves[event.key][0]);
  } else if (moves[event.key]) {
    const move = () => pictures.move(state.u + moves[event.key][0], state.v + moves[event.key][1]);
    actions[event.key] = () => state.u === null ? fill() : move();
  } else if (event.key === "Enter" && event.target.closest?.(".frame")) {
    actions.Enter = () => set({ pinned: !state.pinned });
  } else if (layers[Number(event.key) - 1] && !layers[Number(event.key) - 1].disabled) {
    actions[event.key] = () => set({ layer: layers[Number(event.key) - 1].dataset.layer });
  }
  if (!actions[event.key] || (event.key === " " && event.target.closest?.("button"))) return;
  event.preventDefault();
  actions[event.key]();
}

main().catch(error => {
  $("title").textContent = `The page could not be loaded: ${error.message}`;
  document.body.dataset.ready = "failed";
});
