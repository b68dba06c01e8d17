// The 3D tab: mesh, tracked points, measured depth, camera and tracks of a sequence, frame by frame.

import * as THREE from "./vendor/three.module.min.js";
import { OrbitControls } from "./vendor/OrbitControls.js";
import { address, bytes, get } from "./api.js";
import { split } from "./browse.js";
import { onChange, set, state } from "./state.js";

const $ = id => document.getElementById(id);
const STATE_COLOURS = [[0.09, 0.79, 0.39], [0.95, 0.62, 0.07], [0.93, 0.27, 0.36], [0.6, 0.6, 0.65]];
const PARTS = [["mesh", "Mesh", true], ["wire", "Wireframe", false], ["points", "Tracked points", false], ["depth", "Depth", false], ["camera", "Camera", true], ["tracks", "Tracks", true]];
const FRAMES_PER_SECOND = 8, FOV = 45, UP = new THREE.Vector3(0, 0, 1);
let through = false, renderer, camera, controls = null, world, group, data, positions, sequence = "", about = null, playing = 0, drawn = -1, asked = 0;
let poses = new Map(), floor = null, cellText = "", visible = Object.fromEntries(PARTS.map(([name, , on]) => [name, on])), byState = false;

export function start(catalogue, found) {
  data = catalogue; positions = found;
  renderer = new THREE.WebGLRenderer({ antialias: true });
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  $("stage").append(renderer.domElement);
  camera = new THREE.PerspectiveCamera(45, 1, 0.005, 100);
  turnAround(UP, FOV);
  world = new THREE.Scene();
  world.add(new THREE.HemisphereLight(0xffffff, 0x777788, 2.2));
  const sun = new THREE.DirectionalLight(0xffffff, 1.6);
  sun.position.set(1, -2, 4);
  world.add(sun);
  group = new THREE.Group();
  world.add(group);
  for (const [name, text] of PARTS) {
    const label = checkbox(text, visible[name], on => { visible[name] = on; rebuild(); });
    label.firstChild.name = name;
    $("scene-parts").append(label);
  }
  $("scene-parts").append(checkbox("Colour by visibility", false, on => { byState = on; rebuild(); }));
  for (const [text, look] of [["Close", () => aim(drawn)], ["All", lookAround], ["From the camera", lookThrough]]) {
    const button = document.createElement("button");
    button.textContent = text;
    button.onclick = () => { if (about && poses.has(drawn)) { look(); rebuild(); } };
    $("scene-views").append(button);
  }
  for (const side of ["a", "b"]) $(`scene-${side}`).onclick = () => set({ of: side, frame: null });
  $("scene-frame").oninput = () => set({ frame: Number($("scene-frame").value) });
  $("play").onclick = toggle;
  new ResizeObserver(resize).observe($("stage"));
  document.addEventListener("answered", () => { if (!$("scene").hidden) rebuild(); });
  onChange(changed => { if (state.tab === "scene" && ["a", "b", "of", "frame"].some(name => changed.has(name))) wake(); });
  recolour();
}

function checkbox(text, on, act) {
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox"; box.checked = on;
  box.onchange = () => act(box.checked);
  label.append(box, text);
  return label;
}

/** Show the frame that the state names; read its sequence if it is another one. */
export async function wake() {
  const [name, own] = split(state[state.of]);
  for (const side of ["a", "b"]) $(`scene-${side}`).setAttribute("aria-pressed", String(side === state.of));
  const turn = ++asked;
  try {
    if (name !== sequence) {
      pause();
      const got = await get("scene", { frame: `${name}/0` });
      if (turn !== asked) return;
      about = unpack(got); sequence = name; poses = new Map();
      $("scene-frame").max = about.frames - 1;
      $("scene-frame").disabled = $("play").disabled = about.frames < 2;
      const tracked = $("scene-parts").querySelector("[name=tracks]");
      tracked.disabled = !about.temporal;
      tracked.checked = visible.tracks && about.temporal;
      await pose(Math.min(own, about.frames - 1));
      aim(Math.min(own, about.frames - 1));
      if (about.temporal) readAll();
    }
    const frame = Math.min(state.frame ?? own, about.frames - 1);
    await pose(frame);
    if (turn !== asked) return;
    drawn = frame;
    $("scene-frame").value = frame;
    $("scene-shown").textContent = `${frame} / ${about.frames - 1}`;
    note();
    await rebuild();
  } catch (error) {
    sequence = "";
    group.clear(); render();
    $("scene-note").textContent = `Nothing to show in 3D: ${error.message}`;
  }
}

function note() {
  const kind = about.temporal ? "an episode: tracks are the paths of points through its frames" : "independent configurations: tracks join nothing and are off";
  $("scene-note").textContent = `${sequence}, ${about.frames === 1 ? "1 frame" : `${about.frames} frames, ${kind}`}. The mesh joins ${about.points} tracked points by their material coordinates, because the dataset contains no mesh; depth is what the camera measured. Cells of the grid: ${cellText}. Drag to turn, wheel or pinch to zoom.`;
}

function unpack(got) {
  const raw = text => Uint8Array.from(atob(text), each => each.charCodeAt(0)).buffer;
  return { ...got, faces: new Uint32Array(raw(got.faces)), colours: new Uint8Array(raw(got.colours)), tracks: new Int32Array(raw(got.tracks)) };
}

async function pose(frame) {
  if (!poses.has(frame)) {
    const of = sequence || split(state[state.of])[0], count = about.points;
    const got = await bytes("pose", { frame: `${of}/${frame}` });
    poses.set(frame, { xyz: new Float32Array(got, 0, 3 * count), state: new Uint8Array(got, 12 * count, count) });
  }
  return poses.get(frame);
}

/** Read all frames of an episode in the background: tracks need them. */
async function readAll() {
  const name = sequence;
  for (let frame = 0; frame < about.frames; frame++) {
    await pose(frame);
    if (name !== sequence) return;
  }
  rebuild();
}

function aim(frame) {
  const box = new THREE.Box3().setFromArray(poses.get(frame).xyz), middle = box.getCenter(new THREE.Vector3());
  const reach = Math.max(box.getSize(new THREE.Vector3()).length(), 0.05) / Math.min(1, camera.aspect);
  turnAround(UP, FOV);
  controls.target.copy(middle);
  camera.position.set(middle.x + 0.35 * reach, middle.y - 1.0 * reach, middle.z + 0.95 * reach);
  camera.near = reach / 200; camera.far = reach * 60;
  camera.updateProjectionMatrix();
  controls.update();
  floor?.removeFromParent();
  const cell = 10 ** Math.round(Math.log10(reach / 8)), cells = Math.ceil(1.6 * reach / cell);
  floor = new THREE.GridHelper(2 * cells * cell, 2 * cells, 0x7d8a94, 0x7d8a94);
  floor.material.transparent = true; floor.material.opacity = 0.25;
  floor.rotation.x = Math.PI / 2;
  floor.position.set(middle.x, middle.y, box.min.z);
  world.add(floor);
  cellText = cell >= 0.01 ? `${Math.round(100 * cell)} cm` : `${Math.round(1000 * cell)} mm`;
}

/** Look from where the picture was taken; the picture is behind the mesh. */
function lookThrough() {
  const toWorld = cameraToWorld(), [y, z] = [1, 2].map(k => new THREE.Vector3().setFromMatrixColumn(toWorld, k));
  const from = new THREE.Vector3().setFromMatrixPosition(toWorld), reach = from.distanceTo(controls.target);
  const target = from.clone().addScaledVector(z, reach), { K } = about.cameras[drawn], [width, height] = about.size;
  const wide = Math.max(height / K[1][1], width / K[0][0] / camera.aspect); // all of the picture fits
  turnAround(y.negate(), 2 * Math.atan(wide / 2) * 180 / Math.PI);
  camera.position.copy(from);
  controls.target.copy(target);
  controls.update();
  through = true;
}

const cameraToWorld = () => new THREE.Matrix4().set(...about.cameras[drawn].world_to_camera.flat()).invert();

/** Set which way is up, which the controls read once. */
function turnAround(up, fov) {
  const target = controls?.target.clone() ?? new THREE.Vector3();
  controls?.dispose();
  camera.up.copy(up);
  camera.fov = fov;
  controls = new OrbitControls(camera, renderer.domElement);
  controls.addEventListener("change", render);
  controls.target.copy(target);
  camera.updateProjectionMatrix();
  through = false;
}

/** Look from the side, far enough to see the camera too. */
function lookAround() {
  aim(drawn);
  const centre = new THREE.Vector3().setFromMatrixPosition(cameraToWorld());
  const middle = controls.target.clone(), reach = centre.distanceTo(middle);
  controls.target.lerp(centre, 0.45);
  camera.position.set(middle.x + 1.1 * reach, middle.y - 1.2 * reach, middle.z + 0.75 * reach);
  controls.update();
}

async function rebuild() {
  if (!about || !poses.has(drawn)) return;
  const { xyz, state: seen } = poses.get(drawn), parts = [];
  const colours = new Float32Array(xyz.length);
  for (let k = 0; k < seen.length; k++) for (let c = 0; c < 3; c++)
    colours[3 * k + c] = byState ? STATE_COLOURS[seen[k]][c] : (about.colours[3 * k + c] / 255) ** 2.2;
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(xyz, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  geometry.setIndex(new THREE.BufferAttribute(about.faces, 1));
  geometry.computeVertexNormals();
  if (visible.mesh && about.faces.length) parts.push(new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ vertexColors: true, side: THREE.DoubleSide, roughness: 0.85 })));
  if (visible.wire) parts.push(new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: 0x8899aa, wireframe: true, transparent: true, opacity: 0.5 })));
  if (visible.points) parts.push(cloud(geometry, 4));
  if (visible.tracks && about.temporal) parts.push(...tracks());
  if (visible.camera) parts.push(...frustum());
  if (visible.depth) { const measured = await depth(); if (measured) parts.push(measured); }
  const point = positions()[state.of];
  if (point && split(state[state.of])[1] === drawn) parts.push(marker(point));
  free();
  group.add(...parts);
  $("stage").dataset.parts = String(parts.length);
  $("stage").dataset.frame = String(drawn);
  render();
}

function cloud(geometry, size) {
  return new THREE.Points(geometry, new THREE.PointsMaterial({ size, sizeAttenuation: false, vertexColors: true }));
}

async function depth() {
  const got = await bytes("depth", { frame: `${sequence}/${drawn}` });
  if (!got) return null;
  const count = got.byteLength / 15, geometry = new THREE.BufferGeometry();
  const rgb = Float32Array.from(new Uint8Array(got, 12 * count), each => (each / 255) ** 2.2);
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(got, 0, 3 * count), 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(rgb, 3));
  return cloud(geometry, 2.5);
}

/** Paths of points: up to this frame in full, the rest faint. */
function tracks() {
  const made = [];
  for (const point of about.tracks) {
    const colour = new THREE.Color().setRGB(...[0, 1, 2].map(c => about.colours[3 * point + c] / 255), THREE.SRGBColorSpace);
    for (const [from, to, opacity] of [[0, drawn, 1], [drawn, about.frames - 1, 0.2]]) {
      const path = [];
      for (let frame = from; frame <= to; frame++) if (poses.has(frame)) path.push(new THREE.Vector3().fromArray(poses.get(frame).xyz, 3 * point));
      if (path.length < 2) continue;
      made.push(new THREE.Line(new THREE.BufferGeometry().setFromPoints(path), new THREE.LineBasicMaterial({ color: colour, transparent: true, opacity })));
    }
  }
  return made;
}

/** The camera's pyramid, with the picture on its far plane. */
function frustum() {
  const { K } = about.cameras[drawn], [width, height] = about.size, toWorld = cameraToWorld();
  const centre = new THREE.Vector3().setFromMatrixPosition(toWorld);
  const z = (through ? 1 : 0.3) * centre.distanceTo(controls.target);
  const corner = (u, v) => new THREE.Vector3((u - K[0][2]) / K[0][0] * z, (v - K[1][2]) / K[1][1] * z, z).applyMatrix4(toWorld);
  const corners = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
  const lines = corners.flatMap((each, k) => [centre, each, each, corners[(k + 1) % 4]]);
  const wire = new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(lines), new THREE.LineBasicMaterial({ color: 0x4f8fbf }));
  const plane = new THREE.BufferGeometry().setFromPoints(corners);
  plane.setAttribute("uv", new THREE.Float32BufferAttribute([0, 1, 1, 1, 1, 0, 0, 0], 2));
  plane.setIndex([0, 2, 1, 0, 3, 2]);
  const texture = picture(`${sequence}/${drawn}`);
  const shown = new THREE.Mesh(plane, new THREE.MeshBasicMaterial({ map: texture, side: THREE.DoubleSide, depthTest: !through, depthWrite: !through }));
  if (through) shown.renderOrder = -1;
  return through ? [shown] : [wire, shown];
}

const pictures = new Map();
function picture(frame) {
  if (!pictures.has(frame)) {
    if (pictures.size > 60) { const [oldest] = pictures.keys(); pictures.get(oldest).dispose(); pictures.delete(oldest); }
    const texture = new THREE.TextureLoader().load(address("layer", { layer: "rgb", frame }), render);
    texture.colorSpace = THREE.SRGBColorSpace;
    pictures.set(frame, texture);
  }
  return pictures.get(frame);
}

function marker(place) {
  const made = new THREE.Mesh(new THREE.SphereGeometry(camera.position.distanceTo(controls.target) / 90, 20, 14), new THREE.MeshBasicMaterial({ color: state.of === "a" ? 0x00c8ff : 0x18c964, depthTest: false, transparent: true, opacity: 0.9 }));
  made.position.fromArray(place);
  made.renderOrder = 2;
  return made;
}

function free() {
  for (const each of group.children) { each.geometry?.dispose(); each.material?.dispose(); }
  group.clear();
}

export function recolour() {
  world.background = new THREE.Color(getComputedStyle($("stage")).backgroundColor);
  render();
}

function resize() {
  const { clientWidth: width, clientHeight: height } = $("stage");
  if (!width || !height) return;
  renderer.setSize(width, height, false);
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  render();
}

let due = false;
function render() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => { due = false; renderer.render(world, camera); });
}

export function step(by) {
  if (!about || !by) return;
  set({ frame: (drawn + Math.sign(by) + about.frames) % about.frames });
}

export function toggle() {
  if (playing) { pause(); return; }
  if (!about || about.frames < 2) return;
  playing = setInterval(() => step(1), 1000 / FRAMES_PER_SECOND);
  $("play").textContent = "❚❚ Pause";
}

export function pause() {
  clearInterval(playing);
  playing = 0;
  $("play").textContent = "▶ Play";
}
