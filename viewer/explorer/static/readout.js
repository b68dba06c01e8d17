// Asks for the truth and the answers of the pixel, and writes them into the table.

import { get, Latest } from "./api.js";
import { COLOURS, show } from "./pictures.js";
import { onChange, set, state } from "./state.js";

const $ = id => document.getElementById(id);
const STATES = { visible: "visible", self_occluded: "hidden by the object itself", occluded: "hidden by another object", out_of_frame: "outside the picture" };
let data, truth = null, answers = [], askTruth, askMethod = [], rows = [];

export function start(catalogue) {
  data = catalogue;
  const header = cells("truth", null, "truth");
  rows = data.methods.map((method, k) => cells(method.name, k, method.kind));
  $("answers").tBodies[0].replaceChildren(header.row, ...rows.map(each => each.row));
  answers = data.methods.map(() => null);
  askTruth = new Latest(async where => {
    const got = await get("truth", where).catch(error => ({ failed: error.message }));
    if (same(where)) { truth = got; write(header); }
  });
  askMethod = data.methods.map((_, k) => new Latest(async where => {
    const got = await get("answer", { ...where, method: k }).catch(error => ({ failed: error.message }));
    if (same(where)) { answers[k] = got; rows[k].row.classList.remove("busy"); write(header); }
  }));
  onChange(changed => {
    if (changed.has("a") || changed.has("b")) warm();
    if (["a", "b", "u", "v"].some(name => changed.has(name))) ask(header);
    if (changed.has("method") || changed.has("heat") || changed.has("opacity") || changed.has("pinned")) write(header);
  });
  warm(); ask(header); write(header);
}

let preparing = "";
/** Let live methods compute the features of both pictures before the pointer moves. */
async function warm() {
  const where = { a: state.a, b: state.b };
  const current = () => where.a === state.a && where.b === state.b;
  for (const [k, method] of data.methods.entries()) {
    if (method.kind !== "live" || !current()) continue;
    preparing = `${method.name} computes its features of the two pictures.`;
    hint();
    await get("warm", { ...where, method: k }).catch(() => null);
  }
  if (current()) { preparing = ""; hint(); }
}

function hint() { if (state.u === null) $("status").textContent = `Move over the source picture, or touch it. ${preparing}`; }

/** The world positions of the point in both frames, for the 3D tab. */
export function positions() { return truth && !truth.failed ? { a: truth.xyz_a, b: truth.xyz_b } : { a: null, b: null }; }

const asked = () => ({ a: state.a, b: state.b, u: state.u, v: state.v });
const same = where => Object.entries(asked()).every(([name, value]) => where[name] === value);

function ask(header) {
  if (state.u === null) {
    truth = null; answers = data.methods.map(() => null);
    write(header);
    return;
  }
  rows.forEach((row, k) => row.row.classList.toggle("busy", data.methods[k].kind === "live"));
  askTruth.ask(asked());
  data.methods.forEach((method, k) => { askMethod[k].ask(asked()); });
}

function cells(name, k, kind) {
  const row = document.createElement("tr"), head = document.createElement("th"), mark = document.createElement("i"), about = document.createElement("small");
  head.scope = "row";
  mark.className = k === null ? "mark truth" : "mark method";
  if (k !== null) mark.style.background = COLOURS[k % COLOURS.length];
  about.textContent = k === null ? "" : ` ${kind}`;
  head.append(mark, name, about);
  const made = { row, k };
  row.append(head);
  for (const column of ["shown", "place", "error", "visible", "confidence", "sigma", "familiarity", "material", "ms"]) {
    made[column] = document.createElement("td");
    row.append(made[column]);
  }
  if (k !== null) {
    const radio = Object.assign(document.createElement("input"), { type: "radio", name: "method", value: k });
    radio.setAttribute("aria-label", `Show the heat map of ${name}`);
    radio.onchange = () => set({ method: k });
    made.radio = radio;
    made.shown.append(radio);
  }
  return made;
}

const number = (value, digits = 1) => value === null || value === undefined ? "–" : value.toFixed(digits);
const share = value => value === null || value === undefined ? "–" : `${Math.round(100 * value)} %`;
const pixel = place => place ? `${number(place[0])}, ${number(place[1])}` : "–";
const material = values => values && Object.keys(values).length ? Object.entries(values).map(([name, value]) => `${name === "theta" ? "θ" : name} ${value.toFixed(3)}`).join(", ") : "–";

function write(header) {
  const known = truth && !truth.failed ? truth : null;
  const usable = answers.map(each => each && !each.failed && state.u !== null ? each : null);
  header.place.textContent = pixel(known?.place);
  header.visible.textContent = known?.visibility ? (known.visibility === "visible" ? "yes" : "no") : "–";
  header.material.textContent = material(known?.material);
  rows.forEach((row, k) => {
    const answer = usable[k];
    if (row.radio) row.radio.checked = state.method === k;
    row.place.textContent = pixel(answer?.place);
    row.error.textContent = number(answer?.error_px);
    row.visible.textContent = share(answer?.visible);
    row.confidence.textContent = share(answer?.confidence);
    row.confidence.title = answer?.confidence_is ?? "";
    row.sigma.textContent = number(answer?.sigma_px);
    row.familiarity.textContent = number(answer?.familiarity, 2);
    row.material.textContent = material(answer?.material);
    row.ms.textContent = data.methods[k].kind === "live" ? number(answer?.ms, 0) : "–";
  });
  status(known, usable);
  show(known, usable);
  document.dispatchEvent(new Event("answered"));
}

function status(known, usable) {
  const wrong = [truth, ...answers].find(each => each?.failed)?.failed;
  const warning = usable.flatMap(answer => answer?.warnings ?? [])[0];
  let text = "";
  if (state.u === null) text = `Move over the source picture, or touch it. ${preparing}`;
  else if (known) text = `The point is ${STATES[known.visibility] ?? "not known"} in the target.` + (known.origin === "query" ? " Truth of the nearest query." : "");
  else if (truth === null) text = usable.some(Boolean) ? "The truth of this point is not known." : "No object here: move over it.";
  if (state.pinned) text += " Pinned: click again to release.";
  if (warning) text += ` ${warning}`;
  if (wrong) text = wrong;
  $("status").textContent = text;
  $("status").classList.toggle("warn", Boolean(warning || wrong));
}
