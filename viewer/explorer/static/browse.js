// The list of pairs: filters, order, and measuring a live method pair by pair.

import { get } from "./api.js";
import { onChange, set, state } from "./state.js";

const $ = id => document.getElementById(id);
const MOST = 300; // rows that are drawn at first
let data, shown = [], limit = MOST, stop = false;

export function start(catalogue) {
  data = catalogue;
  options($("tier"), [["", "all"], ...Object.keys(data.tiers).map(name => [name, name])]);
  const splits = [...new Set(data.pairs.map(pair => pair[0]))];
  options($("split"), [["", "all"], ...splits.map(name => [name, name])]);
  const sequences = data.sequences.map(each => [each[0], each[0]]);
  options($("sequence-a"), sequences);
  options($("sequence-b"), sequences);
  for (const name of ["tier", "split", "sequence", "sort"]) $(name).onchange = () => set({ [name]: $(name).value });
  for (const side of ["a", "b"]) {
    $(`sequence-${side}`).onchange = () => choose(side, $(`sequence-${side}`).value, 0);
    $(`frame-${side}`).oninput = () => choose(side, $(`sequence-${side}`).value, $(`frame-${side}`).value);
  }
  $("measure").onclick = measure;
  $("free").open = $("previous").disabled = $("next").disabled = !data.pairs.length;
  onChange(changed => {
    if (["tier", "split", "sequence", "sort"].some(name => changed.has(name))) list();
    if (changed.has("a") || changed.has("b")) current();
    if (changed.has("method")) { offer(); draw(); }
  });
  sorts(); list(); current(); offer();
}

export function options(select, entries) {
  select.replaceChildren(...entries.map(([value, text]) => new Option(text, value)));
}

/** Show a frame on one side; the other side stays, or follows to the same tier. */
function choose(side, sequence, frame) {
  const other = side === "a" ? "b" : "a";
  const tier = name => data.sequences.find(each => each[0] === name)[1];
  const changes = { [side]: `${sequence}/${frame}` };
  if (tier(sequence) !== tier(state[other].split("/")[0])) changes[other] = `${sequence}/0`;
  set({ ...changes, u: null, v: null, pinned: false });
}

function sorts() {
  const entries = [["", "as in the file"]];
  data.methods.forEach((method, k) => {
    if (!method.errors.some(error => error !== null)) return;
    entries.push([`worst:${k}`, `${method.name}: largest error first`], [`best:${k}`, `${method.name}: smallest error first`]);
  });
  options($("sort"), entries);
}

/** The error that the list shows: of the order's method, else of the chosen one, else of any. */
function errorsShown() {
  const sorted = state.sort.split(":")[1];
  const wanted = [sorted === undefined ? null : Number(sorted), state.method, ...data.methods.keys()];
  const k = wanted.find(each => each !== null && data.methods[each]?.errors.some(error => error !== null));
  const { name, answered } = data.methods[k] ?? {};
  $("errors-of").textContent = k === undefined ? "" : `RMSE of ${name}` + (answered < 1 ? `, ${Math.floor(100 * answered)} % answered` : "");
  return data.methods[k]?.errors ?? null;
}

function list() {
  const fits = each => (!state.tier || each[1] === state.tier) && (!state.split || each[2] === state.split);
  options($("sequence"), [["", "all"], ...data.sequences.filter(fits).map(each => [each[0], each[0]])]);
  for (const name of ["tier", "split", "sequence", "sort"]) {
    $(name).value = state[name];
    if ($(name).value !== state[name]) { set({ [name]: "" }); return; } // not of this tier, or of this dataset
  }
  shown = data.pairs.map((_, k) => k).filter(k => {
    const [split, , a, , b] = data.pairs[k];
    const [source, target] = [data.sequences[a], data.sequences[b]];
    return (!state.tier || source[1] === state.tier) && (!state.split || split === state.split)
      && (!state.sequence || source[0] === state.sequence || target[0] === state.sequence);
  });
  const [order, of] = state.sort.split(":");
  if (of !== undefined) {
    const errors = data.methods[Number(of)]?.errors ?? [];
    const sign = order === "worst" ? -1 : 1;
    shown.sort((x, y) => (errors[x] === null) - (errors[y] === null) || sign * (errors[x] - errors[y]));
  }
  limit = MOST;
  draw();
}

function draw() {
  $("count").textContent = `${shown.length.toLocaleString("en")} of ${data.pairs.length.toLocaleString("en")}`;
  const errors = errorsShown();
  const rows = shown.slice(0, limit).map(k => {
    const [split, number, a, frameA, b, frameB, queries] = data.pairs[k];
    const button = document.createElement("button");
    button.dataset.pair = k;
    const name = document.createElement("b"), error = document.createElement("span"), about = document.createElement("small");
    const [source, target] = [data.sequences[a], data.sequences[b]];
    name.textContent = a === b ? `${source[0]}, ${frameA} → ${frameB}` : `${source[0]} → ${ending(source[0], target[0])}`;
    error.textContent = errors && errors[k] !== null ? `${errors[k].toFixed(1)} px` : "";
    const frames = a === b || source[4] + target[4] === 2 ? [] : [`frame ${frameA} → ${frameB}`];
    about.textContent = [`${split} ${number}`, ...frames, shapes(source[3], target[3]), `${queries} ${queries === 1 ? "query" : "queries"}`].filter(Boolean).join(" · ");
    button.append(name, error, about);
    button.onclick = () => open(k);
    const item = document.createElement("li");
    item.append(button);
    return item;
  });
  if (shown.length > limit) {
    const more = document.createElement("button");
    more.textContent = `Show ${Math.min(MOST, shown.length - limit)} more`;
    more.onclick = () => { limit += MOST; draw(); };
    const item = document.createElement("li");
    item.append(more);
    rows.push(item);
  }
  $("pairs").replaceChildren(...rows);
  mark();
}

const shapes = (first, second) => first === second ? first : [first, second].filter(Boolean).join(" → ");

/** The second name without the words that both begin with. */
function ending(first, second) {
  const words = second.split("-"), known = first.split("-");
  let same = 0;
  while (same < words.length - 1 && words[same] === known[same]) same++;
  return words.slice(same).join("-");
}

export function open(k) {
  const [, , a, frameA, b, frameB] = data.pairs[k];
  set({ a: `${data.sequences[a][0]}/${frameA}`, b: `${data.sequences[b][0]}/${frameB}`, u: null, v: null, pinned: false });
}

/** Go so many pairs on in the list, around its ends. */
export function step(by) {
  if (!shown.length) return;
  const at = shown.indexOf(index());
  open(shown[at < 0 ? 0 : (at + by + shown.length) % shown.length]);
}

function key(k) {
  const [, , a, frameA, b, frameB] = data.pairs[k];
  return `${data.sequences[a][0]}/${frameA} ${data.sequences[b][0]}/${frameB}`;
}

/** Number of the pair that is shown, or -1 for two frames that are no pair of the queries. */
export function index() {
  const wanted = `${state.a} ${state.b}`;
  return data.pairs.findIndex((_, k) => key(k) === wanted);
}

function mark() {
  const now = String(index());
  for (const button of document.querySelectorAll("#pairs button")) button.setAttribute("aria-current", String(button.dataset.pair === now));
  const row = document.querySelector('#pairs [aria-current="true"]'), list = $("pairs");
  if (!row) return;
  const top = row.offsetTop - list.offsetTop;
  if (top < list.scrollTop || top + row.offsetHeight > list.scrollTop + list.clientHeight) list.scrollTop = top - list.clientHeight / 3;
}

function current() {
  mark();
  for (const side of ["a", "b"]) {
    const [name, frame] = split(state[side]);
    const sequence = data.sequences.find(each => each[0] === name);
    $(`sequence-${side}`).value = name;
    $(`frame-${side}`).max = sequence[4] - 1;
    $(`frame-${side}`).value = frame;
    $(`frame-${side}`).disabled = sequence[4] < 2;
    $(`shown-${side}`).textContent = `${frame} / ${sequence[4] - 1}`;
  }
}

export function split(frame) {
  const at = frame.lastIndexOf("/");
  return [frame.slice(0, at), Number(frame.slice(at + 1))];
}

function offer() {
  const method = data.methods[state.method];
  $("measure").hidden = method?.kind !== "live" || !data.pairs.length;
  if (method) $("measure").textContent = `Measure ${method.name} on these pairs`;
}

/** Ask a live method for the queries of every pair of the list, until it is stopped. */
async function measure() {
  if ($("measure").dataset.running) { stop = true; return; }
  const k = state.method, method = data.methods[k], pairs = [...shown];
  $("measure").dataset.running = "yes";
  stop = false;
  let done = 0;
  for (const pair of pairs) {
    if (stop) break;
    const [a, b] = key(pair).split(" ");
    try { method.errors[pair] = await get("error", { a, b, method: k }); } catch { method.errors[pair] = null; }
    $("measure").textContent = `Stop: ${++done} of ${pairs.length} pairs`;
  }
  delete $("measure").dataset.running;
  sorts(); offer();
  set({ sort: `worst:${k}` });
  list();
}
