"use strict";
const $ = id => document.getElementById(id);
const view = $("view"), small = $("small"), images = new Map(), failed = new Map();
let state = {pictures: [], points: [], marks: {}, suggests: false}, at = 0, other = 0, chosen = null, past = [];
let zoom = 1, left = 0, top_ = 0;  // of the picture in the view, CSS pixels
let whole = "";  // these where all of the picture is in the view

const picture = (k = at) => state.pictures[k];
const own = (k = at) => state.marks[picture(k).name] ||= Object.create(null);
const colour = point => `hsl(${(state.points.indexOf(point) * 137.5) % 360} 85% 55%)`;
const suggested = mark => mark?.[3] === "suggested";
const unconfirmed = () => state.points.filter(point => suggested(own()[point]));
const todo = () => state.points.find(point => !own()[point] || suggested(own()[point])) ?? state.points[0] ?? null;
// Without the names that every object has: a point may be called "constructor".
const bare = (_, value) => value && Object.getPrototypeOf(value) === Object.prototype ? Object.assign(Object.create(null), value) : value;
const copy = value => JSON.parse(JSON.stringify(value), bare);

function say(text, bad = false) { $("said").textContent = text; $("said").className = bad ? "bad" : ""; }

function image(k) {
  if (!images.has(k)) {
    const loaded = new Image();
    loaded.onload = draw;
    loaded.onerror = async () => {
      const {error} = await fetch(`picture/${k}`).then(answer => answer.json()).catch(() => ({}));
      failed.set(k, error ?? `${picture(k).name} cannot be shown: the command has ended`);
      draw();
    };
    loaded.src = `picture/${k}`;
    images.set(k, loaded);
    if (images.size > 6) for (const each of images.keys()) if (each !== k && each !== at && each !== other) { images.delete(each); break; }
  }
  return images.get(k);
}

async function send(path, body) {
  const found = await fetch(path, {method: "POST", body: JSON.stringify(body)}).then(answer => answer.json()).catch(() => null);
  if (!found) throw new Error("the command has ended. Run it again, open the address that it prints, and repeat this");
  if (found.error) throw new Error(found.error);
  return found;
}

let saving = Promise.resolve(), changes = 0, stored = 0;
function save() {
  const body = copy({points: state.points, marks: state.marks}), turn = ++changes;
  saving = saving.then(async () => {
    try { const {saved, suggested, revision} = await send("marks", {...body, revision: state.revision});
      state.revision = revision; stored = turn;
      say(`${saved} ${saved === 1 ? "mark" : "marks"} saved` + (suggested ? `, ${suggested} of them suggested: confirm them (Enter) or move them` : "")); }
    catch (error) { say(`Not saved: ${error.message}`, true); }
  });
}

function change(what) { past.push([copy({points: state.points, marks: state.marks}), at]); if (past.length > 200) past.shift(); what(); save(); render(); }
function undo() {
  if (!past.length) return;
  const [last, where] = past.pop();
  Object.assign(state, last);
  if (!state.points.includes(chosen)) chosen = state.points[0] ?? null;
  save();
  if (where === at) render(); else go(where);
}

function fit() {
  const {width, height} = picture(), box = view.getBoundingClientRect();
  zoom = Math.min(box.width / width, box.height / height) * .97;
  left = (box.width - width * zoom) / 2; top_ = (box.height - height * zoom) / 2;
  whole = `${[zoom, left, top_]}`;
  draw();
}
function zoomBy(factor, x, y) {
  const box = view.getBoundingClientRect(); x ??= box.width / 2; y ??= box.height / 2;
  const next = Math.min(40, Math.max(.02, zoom * factor));
  left = x - (x - left) * next / zoom; top_ = y - (y - top_) * next / zoom; zoom = next; draw();
}

function paint(canvas, k, scale, x, y) {
  const box = canvas.getBoundingClientRect(), dense = window.devicePixelRatio || 1, pen = canvas.getContext("2d");
  canvas.width = box.width * dense; canvas.height = box.height * dense;
  pen.setTransform(dense, 0, 0, dense, 0, 0);
  const shown = image(k), {width, height} = picture(k);
  pen.imageSmoothingEnabled = scale < 4;
  if (shown.complete && shown.naturalWidth) pen.drawImage(shown, x, y, width * scale, height * scale);
  for (const point of state.points) {
    const mark = own(k)[point];
    if (!mark || mark[0] === null) continue;
    const u = x + mark[0] * scale, v = y + mark[1] * scale, large = point === chosen ? 8 : 6;
    for (const [line, ink] of [[4, "#000"], [2, colour(point)]]) {
      pen.beginPath(); pen.arc(u, v, large, 0, 7); pen.lineWidth = line; pen.strokeStyle = ink;
      pen.setLineDash(suggested(mark) ? [4, 3] : []); pen.stroke();
      if (!mark[2]) { pen.beginPath(); pen.moveTo(u - large, v + large); pen.lineTo(u + large, v - large); pen.stroke(); }
    }
    pen.setLineDash([]); pen.fillStyle = colour(point); pen.fillRect(u - 1, v - 1, 2, 2);
    pen.font = "12px sans-serif"; pen.lineWidth = 3; pen.strokeStyle = "#000"; pen.strokeText(point, u + 11, v + 4);
    pen.fillStyle = "#fff"; pen.fillText(point, u + 11, v + 4);
  }
}
function draw() {
  if (!state.pictures.length) return;
  paint(view, at, zoom, left, top_);
  $("unshown").textContent = failed.get(at) ?? "";
  const box = small.getBoundingClientRect(), {width, height} = picture(other), mark = own(other)[chosen];
  let scale = Math.min(box.width / width, box.height / height), x = (box.width - width * scale) / 2, y = (box.height - height * scale) / 2;
  if (mark && mark[0] !== null) { scale *= 3; x = box.width / 2 - mark[0] * scale; y = box.height / 2 - mark[1] * scale; }
  paint(small, other, scale, x, y);
}

function render() {
  const {name} = picture(), marks = own(), focused = document.activeElement.dataset.point;
  $("name").textContent = $("name").title = `${at + 1} of ${state.pictures.length}: ${name}`;
  $("points").replaceChildren(...state.points.map(point => {
    const row = document.createElement("li"), button = document.createElement("button"), mark = marks[point];
    button.type = "button"; button.dataset.point = point; button.setAttribute("aria-pressed", String(point === chosen));
    const dot = document.createElement("i"), text = document.createElement("span"), note = document.createElement("small");
    dot.style.background = colour(point); text.textContent = point;
    note.textContent = !mark ? "" : suggested(mark) ? "suggested" : !mark[2] ? "hidden" : `${mark[0].toFixed(1)}, ${mark[1].toFixed(1)} px`;
    button.append(dot, text, note); button.onclick = () => { chosen = point; render(); };
    row.append(button); return row;
  }));
  if (focused !== undefined) $("points").querySelector(`[data-point="${CSS.escape(focused)}"]`)?.focus();
  $("previous").disabled = at === 0; $("next").disabled = at === state.pictures.length - 1;
  $("undo").disabled = !past.length; $("remove").disabled = !marks[chosen]; $("hide").disabled = $("rename").disabled = $("drop").disabled = chosen === null;
  $("confirm").disabled = !unconfirmed().length;
  $("other").value = String(other); $("suggest").disabled = other === at;
  draw();
}

function go(to) {
  if (to < 0 || to >= state.pictures.length) return;
  if (other === to || Object.keys(own(at)).length) other = at;
  at = to; chosen = todo();
  history.replaceState(null, "", `#${at + 1}`);  // reloading stays here
  fit(); render();
}
function step(by) { const k = state.points.indexOf(chosen) + by; if (k >= 0 && k < state.points.length) { chosen = state.points[k]; render(); } }
function place(u, v) {
  const {width, height} = picture();
  if (u < 0 || v < 0 || u >= width || v >= height) return say("That is outside the picture", true);
  if (chosen === null) return say("Add a point first: give it a name below 'Points'", true);
  change(() => { own()[chosen] = [u, v, own()[chosen]?.[0] != null ? own()[chosen][2] : true, "marked"]; });
  const rest = state.points.slice(state.points.indexOf(chosen) + 1).find(point => !own()[point]);
  if (rest) { chosen = rest; render(); }
}
/** Move the mark of the chosen point, or set one in the middle of the view, by CSS pixels. */
function nudge(x, y) {
  if (chosen === null) return;
  const {width, height} = picture(), box = view.getBoundingClientRect(), mark = own()[chosen], inside = (value, most) => Math.min(Math.max(value, 0), most);
  const [u, v, visible] = mark && mark[0] !== null ? mark : [(box.width / 2 - left) / zoom, (box.height / 2 - top_) / zoom, true];
  change(() => { own()[chosen] = [inside(u + x / zoom, width), inside(v + y / zoom, height), visible, "marked"]; });
}
function hide() {
  if (chosen === null) return;
  const mark = own()[chosen];
  change(() => {
    if (mark && mark[0] === null) delete own()[chosen];
    else own()[chosen] = mark ? [mark[0], mark[1], !mark[2], "marked"] : [null, null, false, "marked"];
  });
}
function accept(all) {
  const points = all ? unconfirmed() : suggested(own()[chosen]) ? [chosen] : [];
  if (points.length) change(() => { for (const point of points) own()[point][3] = "confirmed"; });
  const next = unconfirmed()[0];
  if (next) { chosen = next; render(); }
}
function remove() { if (own()[chosen]) change(() => delete own()[chosen]); }
async function suggest() {
  if (!state.suggests || other === at) return;
  say("Looking for the points …");
  try {
    await saving;
    const {marks, warnings} = await send("suggest", {source: other, target: at});
    const missing = Object.entries(marks).filter(([point]) => !own()[point]);
    if (missing.length) change(() => { for (const [point, [u, v]] of missing) own()[point] = [u, v, true, "suggested"]; });
    await saving;
    if (missing.length) { chosen = missing[0][0]; render(); }
    say([`${missing.length} ${missing.length === 1 ? "point" : "points"} suggested: confirm (Enter) or move each`, ...warnings].join(". "), warnings.length > 0);
  } catch (error) { say(error.message, true); }
}

const fingers = new Map();  // and the mouse: where each was last
let held = null;
/** Keep what is under two fingers under them. */
function pinch(event) {
  const box = view.getBoundingClientRect();
  const middle = ([p, q]) => [(p.clientX + q.clientX) / 2 - box.left, (p.clientY + q.clientY) / 2 - box.top, Math.hypot(p.clientX - q.clientX, p.clientY - q.clientY) || 1];
  const [x, y, before] = middle([...fingers.values()]), [u, v, after] = middle([...fingers.set(event.pointerId, event).values()]);
  left += u - x; top_ += v - y;
  zoomBy(after / before, u, v);
}
view.onpointerdown = event => {
  fingers.set(event.pointerId, event);
  held = {x: event.clientX, y: event.clientY, left, top_, moved: fingers.size > 1};
  view.setPointerCapture(event.pointerId); view.focus();
};
view.onpointermove = event => {
  if (!held) return;
  if (fingers.size > 1) return pinch(event);
  const x = event.clientX - held.x, y = event.clientY - held.y;
  held.moved ||= Math.hypot(x, y) > 5;
  if (held.moved) { left = held.left + x; top_ = held.top_ + y; draw(); }
};
view.onpointerup = view.onpointercancel = event => {
  const box = view.getBoundingClientRect(), clicked = held && !held.moved && event.button === 0 && event.type === "pointerup";
  fingers.delete(event.pointerId);
  held = null;
  if (clicked) place((event.clientX - box.left - left) / zoom, (event.clientY - box.top - top_) / zoom);
};
view.onwheel = event => { event.preventDefault(); const box = view.getBoundingClientRect(); zoomBy(Math.exp(-event.deltaY / 400), event.clientX - box.left, event.clientY - box.top); };
const KEYS = {n: () => go(at + 1), p: () => go(at - 1), ArrowDown: () => step(1), ArrowUp: () => step(-1), h: hide, Enter: () => accept(false), Delete: remove, Backspace: remove,
  "+": () => zoomBy(1.3), "=": () => zoomBy(1.3), "-": () => zoomBy(1 / 1.3), 0: fit, s: suggest};
document.onkeydown = event => {
  if (["INPUT", "SELECT"].includes(event.target.tagName)) return;
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") { event.preventDefault(); undo(); return; }
  if (event.key === "Enter" && event.target.tagName === "BUTTON") return;
  const by = event.shiftKey && {ArrowLeft: [-4, 0], ArrowRight: [4, 0], ArrowUp: [0, -4], ArrowDown: [0, 4]}[event.key];
  if (by) { event.preventDefault(); nudge(...by); return; }
  if (event.key === "Enter" && event.shiftKey) { event.preventDefault(); accept(true); return; }
  const act = !event.ctrlKey && !event.metaKey && !event.altKey && KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (act) { event.preventDefault(); act(); }
};
for (const [id, act] of Object.entries({previous: KEYS.p, next: KEYS.n, out: KEYS["-"], in: KEYS["+"], whole: fit, hide, confirm: event => accept(event.shiftKey), remove, undo, suggest})) $(id).onclick = event => act(event);
/** Give a name that is typed and new to what makes a point of it. */
function named(make) {
  const name = $("new").value.trim();
  if (!name || state.points.includes(name)) return say(name ? `There is a point ${name} already` : "Give the point a name", true);
  change(() => { make(name); chosen = name; });
  $("new").value = "";
}
$("add").onsubmit = event => { event.preventDefault(); named(name => state.points.push(name)); };
$("rename").onclick = () => named(name => {
  state.points[state.points.indexOf(chosen)] = name;
  for (const marks of Object.values(state.marks)) if (marks[chosen]) { marks[name] = marks[chosen]; delete marks[chosen]; }
});
$("drop").onclick = () => change(() => {
  const k = state.points.indexOf(chosen);
  state.points.splice(k, 1);
  for (const marks of Object.values(state.marks)) delete marks[chosen];
  chosen = state.points[k] ?? state.points[k - 1] ?? null;
});
$("other").onchange = () => { other = Number($("other").value); render(); };
window.onbeforeunload = event => { if (stored < changes) event.preventDefault(); };  // the browser asks
window.onresize = () => whole === `${[zoom, left, top_]}` ? fit() : draw();  // a phone that is turned
(async () => {
  state = copy(await (await fetch("state")).json());
  at = Math.min(Math.max(Number(location.hash.slice(1)) || 1, 1), state.pictures.length) - 1;
  $("other").replaceChildren(...state.pictures.map((each, k) => { const option = document.createElement("option"); option.value = k; option.textContent = each.name; return option; }));
  $("suggest").hidden = !state.suggests;
  chosen = todo();
  fit(); render();
  say(state.points.length ? "Click the chosen point in the picture" : "Add a point: give it a name");
  document.body.dataset.ready = "yes";
})();
