// Two pictures side by side: layers, the heat map, and marks for the query, the truth and the answers.

import { address, bytes, get } from "./api.js";
import { onChange, set, state } from "./state.js";

export const COLOURS = ["#ff2d78", "#3b9dff", "#ff9f1a", "#b07cff", "#00c2b2", "#e6d200", "#ff6b5e", "#8bd450"];
const TRUTH = "#18c964", QUERY = "#00c8ff", LENS = 4; // pixels of the screen per pixel of the shown picture
const METHOD_LAYERS = ["descriptors", "canonical", "error"];
const COLOURED = ["index", "descriptors", "canonical"]; // a heat map over them would hide their colours
const LAYERS = [
  ["rgb", "Colour"], ["depth", "Depth"], ["index", "Index colours"], ["mask", "Mask"],
  ["descriptors", "Descriptors"], ["canonical", "Canonical"], ["error", "Error map"],
];
export const isLayer = name => LAYERS.some(each => each[0] === name);
const $ = id => document.getElementById(id);
const sides = ["a", "b"];
export let missing = {}; // a layer or "scene" that the pair does not have -> why
let data, found = { truth: null, answers: [] }, queries = [];

const part = (side, what) => document.querySelector(`#picture-${side} ${what}`);

export function start(catalogue) {
  data = catalogue;
  $("pictures").style.setProperty("--aspect", data.size[0] / data.size[1]);
  for (const [layer, text] of LAYERS) {
    if (data.layers && !data.layers.includes(layer)) continue;
    const button = document.createElement("button");
    button.textContent = text;
    button.dataset.layer = layer;
    button.onclick = () => set({ layer });
    $("layers").append(button);
  }
  $("lens-on").onchange = () => set({ lens: $("lens-on").checked });
  $("heat-on").onchange = () => set({ heat: $("heat-on").checked });
  $("opacity").oninput = () => set({ opacity: Number($("opacity").value) });
  const frame = part("a", ".frame");
  frame.onpointermove = event => { if (!state.pinned || event.buttons) point(event); };
  frame.onpointerdown = event => {
    if (event.pointerType === "touch") { frame.setPointerCapture(event.pointerId); point(event); return; }
    const was = state.pinned;
    if (!was) point(event);
    set({ pinned: !was });
  };
  new ResizeObserver(draw).observe(frame);
  onChange(changed => {
    if (changed.has("a") || changed.has("b")) load();
    else if (changed.has("layer") || (changed.has("method") && METHOD_LAYERS.includes(state.layer))) layer();
    if (["layer", "method", "heat", "opacity", "lens"].some(name => changed.has(name))) controls();
    show(found.truth, found.answers);
  });
  load(); controls();
}

function point(event) {
  const box = part("a", ".frame").getBoundingClientRect();
  move((event.clientX - box.left) / box.width * data.size[0], (event.clientY - box.top) / box.height * data.size[1]);
}

/** Ask for the pixel at a place of the source. */
export function move(u, v) {
  const centre = (x, size) => Math.min(Math.max(Math.floor(x), 0), size - 1) + 0.5;
  set({ u: centre(u, data.size[0]), v: centre(v, data.size[1]) });
}

async function load() {
  const [a, b] = [state.a, state.b];
  for (const [side, name] of [["a", "Source"], ["b", "Target"]]) {
    const cut = state[side].lastIndexOf("/");
    part(side, "figcaption").textContent = `${name}: ${state[side].slice(0, cut)}, frame ${state[side].slice(cut + 1)}`;
  }
  missing = {}; queries = [];
  layer();
  const [lacks, got] = await Promise.all([get("missing", { a, b }), get("queries", { a, b })].map(each => each.catch(() => [])));
  if (state.a !== a || state.b !== b) return;
  missing = lacks ?? {}; queries = got;
  if (missing[state.layer]) layer();
  controls(); draw();
  document.dispatchEvent(new Event("missing"));
}

/** Why the pair or the method does not have a layer, or "". */
function lacks(name) {
  const method = data.methods[state.method];
  if (missing[name] || !METHOD_LAYERS.includes(name) || method?.[name]) return missing[name] ?? "";
  return method ? `${method.name} does not have this layer` + (method.kind === "recorded" ? ": it is recorded at the queries only" : "") : "no method is shown";
}

/** The layer of a picture: the chosen one, or the colours where there is none. */
const shown = side => lacks(state.layer) || (state.layer === "error" && side === "b") ? "rgb" : state.layer;

function layer() { for (const side of sides) put(side, shown(side)); }

function put(side, name) {
  const image = part(side, ".layer"), frame = state[side];
  const asked = METHOD_LAYERS.includes(name)
    ? { layer: name, a: state.a, b: state.b, of: side, method: state.method }
    : { layer: name, frame };
  image.onload = () => { image.classList.remove("loading"); draw(); };
  image.onerror = async () => {
    image.classList.remove("loading");
    const source = image.src, failed = await bytes("layer", asked).then(() => "", error => error.message);
    if (image.src !== source) return;
    if (failed || name === "rgb") { image.alt = `This picture cannot be shown: ${failed || "it cannot be decoded."}`; draw(); }
    else put(side, "rgb"); // the method has no such layer of this picture
  };
  image.alt = `${LAYERS.find(each => each[0] === name)[1]} of ${frame}`;
  image.classList.add("loading");
  image.src = address("layer", asked);
}

function controls() {
  const method = data.methods[state.method];
  for (const button of $("layers").children) {
    const name = button.dataset.layer;
    button.setAttribute("aria-pressed", String(name === shown("a")));
    button.title = lacks(name);
    button.disabled = Boolean(button.title);
  }
  $("heat-on").checked = state.heat;
  $("heat-on").disabled = !data.methods.some(each => each.heat);
  $("lens-on").checked = state.lens;
  $("opacity").value = state.opacity;
  $("legend").hidden = shown("a") !== "error";
  const [low, high] = data.error_scale_px;
  $("legend-text").textContent = `error of ${method?.name ?? ""}: ${low} px and less to ${high} px and more; light grey: hidden in the target`;
}

/** Show the truth and the answers of the last pixel. */
export function show(truth, answers) {
  found = { truth, answers };
  const heat = part("b", ".heat"), own = answers[state.method], lit = Boolean(state.heat && own?.heat && !COLOURED.includes(shown("b")));
  heat.onload = draw;
  if (lit) heat.src = `data:image/png;base64,${own.heat}`;
  else heat.removeAttribute("src");
  heat.style.opacity = state.opacity / 100;
  part("b", ".layer").classList.toggle("dimmed", lit);
  draw();
}

/** The truth of the point that is shown, or null. */
export const shownTruth = () => state.u === null ? null : found.truth;

function draw() {
  if (!data) return;
  for (const side of sides) {
    const canvas = part(side, "canvas"), ratio = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    if (!width) continue;
    if (canvas.width !== width * ratio) canvas.width = width * ratio;
    if (canvas.height !== height * ratio) canvas.height = height * ratio;
    const pen = canvas.getContext("2d"), scale = width / data.size[0], marks = side === "a" ? drawSource : drawTarget;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    marks(pen, place => [place[0] * scale, place[1] * scale]);
    const centre = side === "a" ? (state.u === null ? null : [state.u, state.v]) : found.truth?.place ?? found.answers[state.method]?.place;
    if (state.lens && centre) lens(pen, side, centre, scale, width, height, marks);
  }
}

/** Enlarge what is around a place, in the corner of the picture that is farthest from it. */
function lens(pen, side, centre, scale, width, height, marks) {
  const size = Math.min(190, 0.34 * width, height - 12), zoom = LENS * Math.max(scale, 0.5), reach = size / zoom;
  const left = centre[0] * scale < width / 2 ? width - size - 6 : 6, top = centre[1] * scale < height / 2 ? height - size - 6 : 6;
  const corner = [centre[0] - reach / 2, centre[1] - reach / 2];
  pen.save();
  pen.beginPath(); pen.roundRect(left, top, size, size, 6); pen.clip();
  pen.fillStyle = "#0b0d0f"; pen.fillRect(left, top, size, size);
  const heat = part("b", ".heat"), lit = side === "b" && heat.hasAttribute("src");
  if (lit) pen.filter = "brightness(.55)";
  paint(pen, part(side, ".layer"), corner, zoom, left, top);
  pen.filter = "none";
  pen.imageSmoothingEnabled = false;
  if (lit) { pen.globalAlpha = state.opacity / 100; paint(pen, heat, corner, zoom, left, top); pen.globalAlpha = 1; }
  marks(pen, place => [left + (place[0] - corner[0]) * zoom, top + (place[1] - corner[1]) * zoom]);
  pen.restore();
  pen.beginPath(); pen.roundRect(left, top, size, size, 6); pen.setLineDash([]); pen.lineWidth = 1.5; pen.strokeStyle = "rgb(255 255 255 / .75)"; pen.stroke();
}

function paint(pen, image, corner, zoom, left, top) {
  if (!image.complete || !image.naturalWidth) return;
  pen.drawImage(image, left - corner[0] * zoom, top - corner[1] * zoom, data.size[0] * zoom, data.size[1] * zoom);
}

function drawSource(pen, at) {
  if (data.methods.some(method => method.kind === "recorded")) {
    pen.fillStyle = "rgb(255 255 255 / .8)";
    pen.strokeStyle = "rgb(0 0 0 / .6)";
    pen.lineWidth = 1;
    pen.setLineDash([]);
    for (const place of queries) { dot(pen, at(place), 2.2); pen.fill(); pen.stroke(); }
  }
  found.answers.forEach((answer, k) => {
    if (answer && data.methods[k].kind === "recorded") ring(pen, at(answer.query), 6, colour(k));
  });
  if (state.u === null) return;
  const [x, y] = at([state.u, state.v]);
  ring(pen, [x, y], 9, QUERY);
  stroke(pen, QUERY, () => { for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { pen.moveTo(x + 9 * dx, y + 9 * dy); pen.lineTo(x + 15 * dx, y + 15 * dy); } });
}

function drawTarget(pen, at) {
  const truth = found.truth?.place;
  found.answers.forEach((answer, k) => {
    if (!answer) return;
    const [x, y] = at(answer.place);
    const asked = found.truth?.query; // a recorded answer may be to another point than the truth
    if (truth && Math.hypot(answer.query[0] - asked[0], answer.query[1] - asked[1]) < 1) stroke(pen, colour(k), () => { pen.moveTo(...at(truth)); pen.lineTo(x, y); }, [4, 4]);
    stroke(pen, colour(k), () => { pen.moveTo(x, y - 8); pen.lineTo(x + 8, y); pen.lineTo(x, y + 8); pen.lineTo(x - 8, y); pen.closePath(); });
  });
  for (const place of found.truth?.partners ?? []) ring(pen, at(place), 8, TRUTH, [1.5, 4]);
  if (truth) ring(pen, at(truth), 11, TRUTH, found.truth.visibility === "visible" ? [] : [4, 3]);
}

const colour = k => COLOURS[k % COLOURS.length];
function dot(pen, [x, y], radius) { pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); }
function ring(pen, place, radius, colour, dash = []) { stroke(pen, colour, () => pen.arc(...place, radius, 0, 2 * Math.PI), dash); }

/** Stroke a path in a colour, over a darker edge that shows it on any picture. */
function stroke(pen, colour, path, dash = []) {
  for (const [style, width] of [["rgb(0 0 0 / .65)", 4.5], [colour, 2.5]]) {
    pen.beginPath(); path(); pen.setLineDash(dash); pen.lineWidth = width; pen.strokeStyle = style; pen.stroke();
  }
}
