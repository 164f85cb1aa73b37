// Viewer of a page of results: the body at its outputs, colored by a field, and curves.
//
// The page has its data as JSON, see packing.py: outputs, and bodies (simulated, and if there are
// measured fields also measured and difference) with cells, motions and fields, whose arrays are
// compressed pieces. A vertex lies between two nodes of the cells (surfaces: at one), so that cuts
// follow the motion as surfaces do; nodes, motions and values are textures.
import {
  BufferAttribute, BufferGeometry, DataTexture, DoubleSide, FloatType, GLSL3, LineSegments, Mesh, MOUSE,
  OrthographicCamera, RedFormat, RGBAFormat, Scene, ShaderMaterial, TOUCH, Vector2, Vector3, Vector4,
  WebGLRenderer, WebGLRenderTarget,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { colorOf, digits, plot, ticks } from "./plot.js";

const byId = (id) => document.getElementById(id);
const data = JSON.parse(byId("data").textContent);
const asked = new URLSearchParams(location.hash.slice(1)); // a view, as in page.html#field=damage&output=3
const WIDTH = 2048; // of textures
const LOST = 65535; // code of a value that is no number
const NONE = 1e38; // what stands for it in a texture
const BESIDE = 150; // width of the legend, beside which the body is, in pixels

// ---------------------------------------------------------------- data

// The array of a piece, component after component.
const unpacked = new Map();
function piece(number) {
  if (!unpacked.has(number)) unpacked.set(number, unpack(...data.pieces[number]));
  return unpacked.get(number);
}

async function unpack(type, components, text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = +type[1];
  const count = planes.length / size;
  const whole = size === 2 ? new Uint16Array(count) : new Uint32Array(count);
  let sum = 0;
  for (let k = 0; k < count; k++) {
    let change = planes[k] | (planes[count + k] << 8);
    if (size === 4) change |= (planes[2 * count + k] << 16) | (planes[3 * count + k] << 24);
    whole[k] = sum = (sum + change) >>> 0;
  }
  const array = type === "f4" ? new Float32Array(whole.buffer) : whole;
  array.components = components;
  return array;
}

// Real values from the codes of a piece and the ends of their range.
async function real([number, low, high]) {
  const codes = await piece(number);
  if (codes instanceof Float32Array) return codes; // made here
  const values = new Float32Array(codes.length);
  for (let k = 0; k < codes.length; k++)
    values[k] = codes[k] === LOST ? NaN : low + ((high - low) * codes[k]) / (LOST - 1);
  values.components = codes.components;
  return values;
}

const component = (array, k, axis) => (axis < array.components ? array[axis * (array.length / array.components) + k] : 0);

// Keep an array that is made here as a piece; return its entry with the ends of its range.
let made = 0;
function keep(array, components = 1) {
  array.components = components;
  unpacked.set(--made, Promise.resolve(array));
  let [low, high] = [Infinity, -Infinity];
  for (const value of array)
    if (!Number.isNaN(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
  return low > high ? null : [made, low, high];
}

// Bodies of squares, of solids cubes, at the places of measured displacements, colored by these
// and by their differences from the simulated ones.
const CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
const SIDES = [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
async function measuredBodies(entry) {
  const at = await piece(entry.places);
  const d = at.components;
  const count = at.length / d;
  const sides = SIDES.slice(0, d === 2 ? 1 : 6);
  const corners = CORNERS.slice(0, 2 ** d);
  // The width is the median distance of some places from their neighbors along the axes of a grid.
  const some = Array.from({ length: Math.min(count, 200) }, (_, k) => Math.floor((k * count) / Math.min(count, 200)));
  const widths = some.map((one) => {
    const away = Float32Array.from({ length: count }, (_, k) =>
      Math.hypot(...Array.from({ length: d }, (_, axis) => at[axis * count + k] - at[axis * count + one]))).sort();
    return away[Math.min(2 * d, count - 1)];
  });
  const width = widths.sort((one, other) => one - other)[widths.length >> 1] || 1;
  const [nodes, faces, owners] = [new Float32Array(d * count * corners.length), new Uint32Array(4 * count * sides.length), new Uint32Array(count * sides.length)];
  for (let k = 0; k < count; k++) {
    corners.forEach((corner, c) => {
      for (let axis = 0; axis < d; axis++)
        nodes[axis * count * corners.length + k * corners.length + c] = at[axis * count + k] + (corner[axis] - 0.5) * width;
    });
    sides.forEach((side, s) => {
      owners[k * sides.length + s] = k;
      side.forEach((c, corner) => (faces[corner * owners.length + k * sides.length + s] = k * corners.length + c));
    });
  }
  const state = { nodes: keep(nodes, d)[0], faces: [keep(faces, 4)[0]], owners: keep(owners)[0], cells: [], lines: null };
  const bodies = {};
  const states = [];
  for (const kind of ["measured", "difference"]) {
    const fields = {};
    for (let axis = 0; axis <= d; axis++) {
      const name = axis ? `displacement_${axis}` : "displacement";
      const symbol = axis ? `u${"₁₂₃"[axis - 1]}` : "|u|";
      fields[name] = { symbol: `${symbol} ${kind}`, label: data.length ? `${symbol} ${kind} (${data.length})` : `${symbol} ${kind}`, parts: [] };
    }
    bodies[kind] = { dimension: d, point: "place", places: entry.places, numbers: keep(Uint32Array.from({ length: count }, (_, k) => k))[0], states, fields };
  }
  for (const vectors of entry.states) {
    const parts = await Promise.all(vectors.map(real));
    for (const [k, kind] of ["measured", "difference"].entries()) {
      const own = parts.slice(k * d, (k + 1) * d);
      const size = Float32Array.from({ length: count }, (_, one) => Math.hypot(...own.map((part) => part[one])));
      [size, ...own].forEach((part, axis) => Object.values(bodies[kind].fields)[axis].parts.push(keep(part)));
    }
    const moved = new Float32Array(nodes.length);
    for (let k = 0; k < moved.length; k++) {
      const axis = Math.floor(k / (count * corners.length));
      moved[k] = parts[axis][Math.floor((k % (count * corners.length)) / corners.length)] || 0;
    }
    states.push({ ...state, moved: keep(moved, d) });
  }
  return bodies;
}

// The name of the field of a component.
const baseOf = (name) => name.replace(/_[123]{1,2}$/, "");

// The ends of the scale of colors, as those of drawn pictures (limits_of of figures.py): symmetric
// for values of both signs, and not below 1e-4 of the greatest component, which may be noise.
function limitsOf(name) {
  const ends = (one) => body.fields[one].parts.flatMap((part) => (part ? part.slice(1) : []));
  const all = Object.keys(body.fields).filter((one) => baseOf(one) === baseOf(name));
  const greatest = Math.max(...all.flatMap(ends).map(Math.abs), 1e-300);
  const [low, high] = ends(name).length ? [Math.min(...ends(name)), Math.max(...ends(name))] : [0, 1];
  const size = Math.max(-low, high);
  if (Math.min(-low, high) > 0.02 * size && size > 1e-4 * greatest) return [-size, size];
  return [low, low + Math.max(high - low, 1e-4 * greatest)];
}

// ---------------------------------------------------------------- what is shown

const shown = { source: "simulated", field: "", output: data.outputs.length - 1, scale: 1, fixed: null };
let body, field, state; // entries of the data
let places, numbers, values; // arrays of the body's points
let nodes, moved; // arrays of its nodes in this state
let probes = []; // places of points in the arrays
let turn = 0; // of the newest request: older ones are dropped

const uniforms = {
  places: { value: null }, moved: { value: null }, values: { value: null }, colors: { value: null },
  scale: { value: 1 }, range: { value: new Vector2(0, 1) }, cut: { value: new Vector4(0, 0, 0, 1) },
  flat2: { value: true }, picking: { value: false }, hidden: { value: false },
};
const HEAD = "precision highp float; precision highp int; precision highp sampler2D;";
const vertexShader = `${HEAD}
uniform sampler2D places, moved, values; uniform float scale;
in uint a, b, cell; in float share;
out vec3 rest, view; flat out float value; flat out uint number;
vec4 entry(sampler2D list, uint k) { return texelFetch(list, ivec2(int(k) % ${WIDTH}, int(k) / ${WIDTH}), 0); }
void main() {
  rest = mix(entry(places, a).xyz, entry(places, b).xyz, share);
  value = entry(values, cell).x; number = cell;
  vec4 seen = modelViewMatrix * vec4(rest + scale * mix(entry(moved, a).xyz, entry(moved, b).xyz, share), 1.0);
  view = seen.xyz; gl_Position = projectionMatrix * seen;
}`;
const fragmentShader = `${HEAD}
uniform sampler2D colors; uniform vec2 range; uniform vec4 cut; uniform bool flat2, picking, hidden;
in vec3 rest, view; flat in float value; flat in uint number; out vec4 color;
void main() {
  if (dot(cut.xyz, rest) > cut.w || (hidden && value > 1e37)) discard;
  if (picking) { uint k = number + 1u; color = vec4(k & 255u, k >> 8 & 255u, k >> 16 & 255u, 255u) / 255.0; return; }
  vec3 of = value > 1e37 ? vec3(0.8) : texture(colors, vec2((value - range.x) / (range.y - range.x) * 63.0 / 64.0 + 0.5 / 64.0, 0.5)).rgb;
  float light = flat2 ? 1.0 : 0.6 + 0.4 * abs(normalize(cross(dFdx(view), dFdy(view))).z);
  color = vec4(of * light, 1.0);
}`;
const lineShader = `${HEAD}
uniform vec4 cut, ink; in vec3 rest; out vec4 color;
void main() { if (dot(cut.xyz, rest) > cut.w) discard; color = ink; }`;

const material = (own = {}, shader = fragmentShader) =>
  new ShaderMaterial({
    glslVersion: GLSL3, vertexShader, fragmentShader: shader, side: DoubleSide,
    uniforms: { ...uniforms, ...own }, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  });
const ink = (tone, own = {}) => material({ ink: { value: new Vector4(tone, tone, tone, 1) }, ...own }, lineShader);

let renderer, camera, controls;
const scene = new Scene();
const parts = {}; // surface, section, outline, edges, rest
const target = () => new WebGLRenderTarget(1, 1);
let pixel;

function start() {
  const canvas = byId("view");
  renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  renderer.setClearColor(0xffffff, 1);
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  pixel = target();
  camera = new OrthographicCamera();
  parts.surface = new Mesh(new BufferGeometry(), material());
  parts.section = new Mesh(new BufferGeometry(), material({ cut: { value: new Vector4(0, 0, 0, 1) } }));
  parts.outline = new LineSegments(new BufferGeometry(), ink(0.2));
  parts.edges = new LineSegments(new BufferGeometry(), ink(0.35));
  parts.rest = new LineSegments(new BufferGeometry(), ink(0.6, { scale: { value: 0 } }));
  for (const part of Object.values(parts)) {
    part.frustumCulled = false; // its places are in textures
    scene.add(part);
  }
  controls = new OrbitControls(camera, canvas);
  controls.zoomToCursor = true;
  controls.screenSpacePanning = true;
  controls.addEventListener("change", draw);
  controls.addEventListener("start", () => (camera.userData.own = true));
  new ResizeObserver(() => {
    if (!values) return;
    if (camera.userData.own) resize();
    else fit(camera.userData.axis);
    draw();
  }).observe(byId("stage"));
}

function texture(array, count, components) {
  const height = Math.max(1, Math.ceil(count / WIDTH));
  const width = components === 1 ? 1 : 4;
  const list = new Float32Array(WIDTH * height * width);
  for (let k = 0; k < count; k++)
    for (let axis = 0; axis < components; axis++) {
      const value = array[axis * count + k];
      list[width * k + axis] = Number.isNaN(value) ? (width === 1 ? NONE : 0) : value;
    }
  const made = new DataTexture(list, WIDTH, height, width === 1 ? RedFormat : RGBAFormat, FloatType);
  made.needsUpdate = true;
  return made;
}

function put(name, made) {
  uniforms[name].value?.dispose();
  uniforms[name].value = made;
}

// A geometry of vertices given by lists of nodes, shares and cells.
function fill(part, a, b, share, cell) {
  const geometry = new BufferGeometry();
  const unsigned = (list) => new BufferAttribute(list instanceof Uint32Array ? list : Uint32Array.from(list), 1);
  geometry.setAttribute("a", unsigned(a));
  geometry.setAttribute("b", unsigned(b));
  geometry.setAttribute("share", new BufferAttribute(Float32Array.from(share ?? new Float32Array(a.length)), 1));
  geometry.setAttribute("cell", unsigned(cell ?? new Uint32Array(a.length)));
  geometry.setDrawRange(0, a.length);
  part.geometry.dispose();
  part.geometry = geometry;
  part.visible = a.length > 0;
}

// Polygons of a state: nodes at their corners, one array per block, and their cells.
async function facesOf(state) {
  const blocks = await Promise.all(state.faces.map(piece));
  const owners = state.owners === null ? null : await piece(state.owners);
  return { blocks, owners };
}

// Triangles of the polygons, and on demand their edges.
async function geometry(state) {
  const { blocks, owners } = await facesOf(state);
  const most = blocks.reduce((sum, block) => sum + (block.length / block.components) * 3 * (block.components - 2), 0);
  const [corners, cells] = [new Uint32Array(most), new Uint32Array(most)];
  let [size, number] = [0, 0];
  for (const block of blocks) {
    const count = block.length / block.components;
    for (let k = 0; k < count; k++, number++)
      for (let corner = 1; corner + 1 < block.components; corner++) {
        const [one, other] = [block[corner * count + k], block[(corner + 1) * count + k]];
        if (one === other) continue; // a corner that is repeated
        corners.set([block[k], one, other], size);
        cells.fill(owners ? owners[k] : number, size, size + 3);
        size += 3;
      }
  }
  const list = corners.subarray(0, size);
  fill(parts.surface, list, list, null, cells.subarray(0, size));
  const outline = await pairs(state.lines);
  fill(parts.outline, outline, outline);
  parts.edges.userData = { ends: null };
}

async function edges() {
  if (parts.edges.userData.ends || !byId("edges").checked) return;
  const ends = [];
  for (const block of (await facesOf(state)).blocks) {
    const count = block.length / block.components;
    for (let corner = 0; corner < block.components; corner++)
      for (let k = 0; k < count; k++) {
        const next = ((corner + 1) % block.components) * count + k;
        if (block[corner * count + k] !== block[next]) ends.push(block[corner * count + k], block[next]);
      }
  }
  parts.edges.userData.ends = Uint32Array.from(ends);
  fill(parts.edges, parts.edges.userData.ends, parts.edges.userData.ends);
}

// Nodes at the ends of the lines of a piece, one after the other; none without a piece.
async function pairs(number) {
  const lines = number === null ? new Uint32Array() : await piece(number);
  const half = lines.length / 2;
  return Uint32Array.from(lines, (_, k) => lines[(k % 2) * half + (k >> 1)]);
}

// The outline of the undeformed body, of the first state.
async function resting() {
  const ends = await pairs(body.states[0].lines);
  fill(parts.rest, ends, ends);
}

// ---------------------------------------------------------------- cuts of solids

// Tetrahedra of a hexahedron in the order of VTK.
const SIX = [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]];

async function section() {
  const chosen = byId("cut").value;
  const plane = uniforms.cut.value;
  plane.set(0, 0, 0, 1);
  if (chosen !== "" && body.dimension === 3) {
    const normal = new Vector3();
    if (chosen === "view") camera.getWorldDirection(normal).negate();
    else normal.setComponent(+chosen, 1);
    let [low, high] = [Infinity, -Infinity];
    for (let k = 0; k < nodes.length / 3; k++) {
      const at = normal.x * component(nodes, k, 0) + normal.y * component(nodes, k, 1) + normal.z * component(nodes, k, 2);
      [low, high] = [Math.min(low, at), Math.max(high, at)];
    }
    const place = low + (high - low) * (+byId("at").value + 1e-6); // beside the nodes of a lattice
    const sign = byId("flip").checked ? -1 : 1;
    plane.set(sign * normal.x, sign * normal.y, sign * normal.z, sign * place);
  }
  const [a, b, share, cell] = [[], [], [], []];
  if (plane.lengthSq() > plane.w ** 2) {
    const height = new Float32Array(nodes.length / 3);
    for (let k = 0; k < height.length; k++)
      height[k] = plane.x * component(nodes, k, 0) + plane.y * component(nodes, k, 1) + plane.z * component(nodes, k, 2) - plane.w;
    let number = 0;
    for (const block of await Promise.all(state.cells.map(piece))) {
      const count = block.length / block.components;
      const splits = block.components === 8 ? SIX : [[0, 1, 2, 3]];
      for (let k = 0; k < count; k++, number++) {
        let [above, below] = [false, false];
        for (let corner = 0; corner < block.components; corner++)
          if (height[block[corner * count + k]] > 0) above = true;
          else below = true;
        if (!(above && below)) continue;
        for (const split of splits) {
          const corners = split.map((corner) => block[corner * count + k]);
          const [up, down] = [corners.filter((one) => height[one] > 0), corners.filter((one) => height[one] <= 0)];
          if (!up.length || !down.length) continue;
          const pairs = up.length === 2
            ? [[up[0], down[0]], [up[0], down[1]], [up[1], down[1]], [up[1], down[0]]]
            : up.flatMap((one) => down.map((other) => [one, other]));
          for (const corner of pairs.length === 4 ? [0, 1, 2, 0, 2, 3] : [0, 1, 2]) {
            const [one, other] = pairs[corner];
            a.push(one);
            b.push(other);
            share.push(height[one] / (height[one] - height[other]));
            cell.push(number);
          }
        }
      }
    }
  }
  fill(parts.section, a, b, share, cell);
}

// ---------------------------------------------------------------- the view

function resize() {
  const { clientWidth: width, clientHeight: height } = byId("stage");
  const { half } = camera.userData;
  const ratio = width / Math.max(height, 1);
  renderer.setSize(width, height, false);
  Object.assign(camera, { left: -half * ratio, right: half * ratio, top: half, bottom: -half });
  camera.setViewOffset(width, height, BESIDE / 2, 0, width, height);
}

// The box of the body in its first, middle and last state, without the few nodes of cells that
// flew off: they would make the body a dot.
let box;
async function boxOf({ states, dimension }) {
  const along = [[], [], []];
  for (const number of [0, states.length >> 1, states.length - 1]) {
    const [at, way] = await Promise.all([piece(states[number].nodes), real(states[number].moved)]);
    const count = at.length / dimension;
    for (let k = 0; k < count; k++) along.forEach((places, axis) => places.push(component(at, k, axis) + component(way, k, axis)));
  }
  box = [new Vector3(), new Vector3()];
  along.forEach((places, axis) => {
    const sorted = Float64Array.from(places).sort();
    const few = Math.floor(0.005 * sorted.length);
    let [low, high] = [sorted[0], sorted.at(-1)];
    const [from, to] = [sorted[few], sorted.at(-1 - few)];
    if (high - low > 2 * (to - from) && to > from) [low, high] = [from, to];
    box[0].setComponent(axis, low);
    box[1].setComponent(axis, high);
  });
}

// Look at the whole body, in all outputs, from the front right or along an axis.
function fit(axis = null) {
  const [low, high] = box;
  const middle = low.clone().add(high).multiplyScalar(0.5);
  const radius = low.distanceTo(high) / 2 || 1;
  const flat = body.dimension === 2;
  const [turned, raised] = [(-58 * Math.PI) / 180, (22 * Math.PI) / 180];
  const from = flat
    ? new Vector3(0, 0, 1)
    : axis === null
      ? new Vector3(Math.cos(raised) * Math.cos(turned), Math.cos(raised) * Math.sin(turned), Math.sin(raised))
      : new Vector3().setComponent(axis, axis === 1 ? -1 : 1);
  camera.up.set(0, flat || axis === 2 ? 1 : 0, flat || axis === 2 ? 0 : 1);
  camera.position.copy(middle).addScaledVector(from, 10 * radius);
  camera.zoom = 1;
  Object.assign(camera, { near: 0.01 * radius, far: 40 * radius });
  controls.target.copy(middle);
  controls.enableRotate = !flat;
  controls.mouseButtons = { LEFT: flat ? MOUSE.PAN : MOUSE.ROTATE, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
  controls.touches = { ONE: flat ? TOUCH.PAN : TOUCH.ROTATE, TWO: TOUCH.DOLLY_PAN };
  controls.update();
  camera.updateMatrixWorld();
  const { clientWidth: width, clientHeight: height } = byId("stage");
  const room = Math.max(width - BESIDE, 50) / Math.max(height, 1);
  let half = 0;
  for (let corner = 0; corner < 8; corner++) {
    const seen = new Vector3(...["x", "y", "z"].map((name, k) => ((corner >> k) & 1 ? high : low)[name]));
    seen.applyMatrix4(camera.matrixWorldInverse);
    half = Math.max(half, Math.abs(seen.y), Math.abs(seen.x) / room);
  }
  camera.userData = { half: 1.06 * half || 1, axis, own: false };
  resize();
  draw();
}

function draw() {
  if (!values) return;
  renderer.render(scene, camera);
  mark();
}

function show3(part, visible) {
  parts[part].visible = visible && (parts[part].geometry.drawRange.count || 0) > 0;
}

function lines() {
  show3("outline", true);
  show3("edges", byId("edges").checked);
  show3("rest", byId("rest").checked);
}

// The number of the cell at a place in the stage, -1 for none.
function pick(x, y) {
  const { clientWidth: width, clientHeight: height } = byId("stage");
  const { offsetX } = camera.view; // that of the whole view
  const seen = ["outline", "edges", "rest"].filter((part) => parts[part].visible);
  for (const part of seen) parts[part].visible = false;
  camera.setViewOffset(width, height, offsetX + x, y, 1, 1);
  uniforms.picking.value = true;
  renderer.setRenderTarget(pixel);
  renderer.setClearColor(0, 0);
  renderer.clear();
  renderer.render(scene, camera);
  const found = new Uint8Array(4);
  renderer.readRenderTargetPixels(pixel, 0, 0, 1, 1, found);
  renderer.setRenderTarget(null);
  renderer.setClearColor(0xffffff, 1);
  uniforms.picking.value = false;
  camera.setViewOffset(width, height, offsetX, 0, width, height);
  for (const part of seen) parts[part].visible = true;
  return found[3] ? found[0] + 256 * found[1] + 65536 * found[2] - 1 : -1;
}

const unitOf = () => field.label.slice(field.symbol.length + 2, -1); // "u₂ (cm)"
const withUnit = (text, unit) => (unit ? `${text} ${unit}` : text);
const placeOf = (cell) =>
  `(${Array.from({ length: body.dimension }, (_, axis) => digits(component(places, cell, axis))).join(", ")})`;

function words(cell) {
  const value = values[cell];
  return `${body.point ?? "point"} ${numbers[cell]} at ${withUnit(placeOf(cell), data.length)}\n` +
    `${field.symbol} = ${Number.isNaN(value) ? "no value" : withUnit(digits(value, 5), unitOf())}`;
}

function hover(x, y) {
  const cell = values ? pick(x, y) : -1;
  const tip = byId("tip");
  tip.hidden = cell < 0;
  if (cell < 0) return;
  tip.textContent = words(cell);
  const { clientWidth: width } = byId("stage");
  tip.style.left = `${Math.min(x + 14, width - tip.offsetWidth - 4)}px`;
  tip.style.top = `${Math.max(y - tip.offsetHeight - 8, 4)}px`;
}

// Where the middle of a cell is in the view, in pixels of the stage.
async function where(cell) {
  const now = state;
  const { blocks, owners } = await facesOf(now);
  let begin = 0;
  for (const block of blocks) {
    const count = block.length / block.components;
    const k = owners ? owners.indexOf(cell) : cell - begin;
    if (k >= 0 && k < count) {
      const middle = new Vector3();
      for (let corner = 0; corner < block.components; corner++) {
        const node = block[corner * count + k];
        for (let axis = 0; axis < 3; axis++) {
          const at = component(nodes, node, axis) + shown.scale * component(moved, node, axis);
          middle.setComponent(axis, middle.getComponent(axis) + at / block.components);
        }
      }
      middle.project(camera);
      const { clientWidth: width, clientHeight: height } = byId("stage");
      return now === state ? [((middle.x + 1) / 2) * width, ((1 - middle.y) / 2) * height] : null;
    }
    begin += count;
  }
  return null;
}

// Circles at the probes.
async function mark() {
  const found = await Promise.all(probes.map(where));
  document.querySelectorAll(".probe").forEach((one) => one.remove());
  found.forEach((place, number) => {
    if (!place) return;
    const circle = document.createElement("div");
    circle.className = "probe";
    circle.style.cssText = `left:${place[0]}px;top:${place[1]}px;border-color:${colorOf(number)}`;
    byId("stage").append(circle);
  });
}

// ---------------------------------------------------------------- legend and range

const colors = Object.fromEntries(
  Object.entries(data.maps).map(([name, text]) => [
    name,
    Uint8Array.from({ length: text.length / 2 }, (_, k) => parseInt(text.slice(2 * k, 2 * k + 2), 16)),
  ]),
);

function colorMap() {
  const found = colors[byId("map").value];
  const list = new Uint8Array(256);
  for (let k = 0; k < 64; k++) list.set([...found.subarray(3 * k, 3 * k + 3), 255], 4 * k);
  const made = new DataTexture(list, 64, 1);
  made.magFilter = made.minFilter = 1006; // linear
  made.needsUpdate = true;
  put("colors", made);
}

function legend(canvas, ratio = devicePixelRatio) {
  const [width, height] = [BESIDE, 300];
  Object.assign(canvas, { width: width * ratio, height: height * ratio });
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  const found = colors[byId("map").value];
  const [top, tall, left] = [28, height - 44, width - 76];
  for (let k = 0; k < tall; k++) {
    const color = Math.round(63 * (1 - k / tall));
    pen.fillStyle = `rgb(${found.subarray(3 * color, 3 * color + 3).join()})`;
    pen.fillRect(left, top + k, 16, 1.5);
  }
  pen.strokeStyle = "#555";
  pen.lineWidth = 0.7;
  pen.strokeRect(left, top, 16, tall);
  pen.fillStyle = "#222";
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "right";
  pen.fillText(field.label, width - 4, 16, width - 4);
  pen.textAlign = "left";
  const { x: low, y: high } = uniforms.range.value;
  for (const value of ticks(low, high, 6)) {
    const y = top + tall * (1 - (value - low) / (high - low));
    pen.fillRect(left + 16, y, 4, 0.8);
    pen.fillText(digits(value), left + 24, y + 4);
  }
}

function range() {
  const [low, high] = shown.fixed ?? limitsOf(shown.field);
  uniforms.range.value.set(low, high > low ? high : low + 1e-12 + Math.abs(low) * 1e-6);
  byId("low").value = +low.toPrecision(6);
  byId("high").value = +high.toPrecision(6);
  legend(byId("legend"));
}

// ---------------------------------------------------------------- changes of the view

const option = (value, text, parent) => {
  const made = document.createElement("option");
  made.value = value;
  made.textContent = text;
  parent.append(made);
};

// The menu of fields, components under the name of their field.
function menu() {
  const select = byId("field");
  select.replaceChildren();
  const groups = {};
  for (const name of Object.keys(body.fields)) {
    const base = baseOf(name);
    if (base === name) option(name, name.replaceAll("_", " "), select);
    else {
      groups[base] ??= Object.assign(document.createElement("optgroup"), { label: base.replaceAll("_", " ") });
      option(name, name.replaceAll("_", " "), groups[base]);
    }
  }
  select.append(...Object.values(groups));
  if (!(shown.field in body.fields)) shown.field = Object.keys(body.fields)[0];
  select.value = shown.field;
}

async function newBody() {
  body = data.bodies[shown.source];
  [places, numbers] = await Promise.all([piece(body.places), piece(body.numbers)]);
  uniforms.flat2.value = body.dimension === 2;
  uniforms.hidden.value = shown.source !== "simulated";
  byId("cuts").hidden = !body.states[0].cells.length;
  byId("faces").hidden = body.dimension === 2;
  byId("resting").hidden = body.dimension === 3;
  if (body.dimension === 2) byId("cut").value = "";
  menu();
  newField();
}

function newField() {
  field = body.fields[shown.field];
  shown.fixed = null;
  const limits = limitsOf(shown.field);
  const signed = limits[0] === -limits[1];
  byId("map").value = Object.keys(data.maps)[signed ? 1 : 0];
  colorMap();
}

// Show the chosen output, field and motion.
async function show() {
  const mine = ++turn;
  const next = body.states[shown.output];
  const part = field.parts[shown.output];
  const [newNodes, newMoved, newValues] = await Promise.all([
    piece(next.nodes), real(next.moved), part ? real(part) : new Float32Array(numbers.length).fill(NaN),
  ]);
  if (mine !== turn) return;
  const same = state && JSON.stringify([state.faces, state.nodes]) === JSON.stringify([next.faces, next.nodes]);
  [state, nodes, moved, values] = [next, newNodes, newMoved, newValues];
  const count = nodes.length / nodes.components;
  if (!same) {
    put("places", texture(nodes, count, nodes.components));
    await geometry(state);
    await resting();
  }
  if (!same || byId("cut").value) await section();
  put("moved", texture(moved, count, moved.components));
  put("values", texture(values, values.length, 1));
  uniforms.scale.value = shown.scale;
  byId("title").textContent = data.outputs[shown.output];
  byId("output").value = shown.output;
  await edges();
  lines();
  range();
  draw();
}

async function probed() {
  const parts_ = await Promise.all(field.parts.map((part) => (part ? real(part) : null)));
  const x = Object.values(data.axes)[byId("axis").selectedIndex] ?? data.numbers;
  const series = probes.map((cell, number) => ({
    name: `${body.point ?? "point"} ${numbers[cell]} at ${placeOf(cell)}`, color: colorOf(number), x,
    y: parts_.map((part) => (part && !Number.isNaN(part[cell]) ? part[cell] : null)),
  }));
  plot(byId("probes"), series, byId("axis").value || "output", field.label, (text) => (byId("probesaid").textContent = text || (probes.length ? "" : "Click a point of the body to see its curve.")));
  return series;
}

function history() {
  const name = byId("column").value;
  const over = byId("over").value;
  if (name) plot(byId("curve"), [{ name, color: colorOf(0), x: data.history[over], y: data.history[name] }], over, name, (text) => (byId("curvesaid").textContent = text));
}

function save(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
const table = (rows) => rows.map((row) => row.map((one) => quoted(String(one ?? ""))).join(",")).join("\n") + "\n";
const title = (name, unit) => (unit ? `${name} [${unit}]` : name);
const fileName = (what, ending) => `${data.name}-${what}${shown.source === "simulated" ? "" : `-${shown.source}`}-${data.numbers[shown.output]}.${ending}`;

// The shown field as CSV: number and place of every point, and its value.
function csv() {
  const head = [body.point ?? "point", ...Array.from({ length: body.dimension }, (_, axis) => title(`x${axis + 1}`, data.length)), title(shown.field, unitOf())];
  const rows = Array.from(values, (value, k) => [
    numbers[k], ...Array.from({ length: body.dimension }, (_, axis) => +component(places, k, axis).toPrecision(7)),
    Number.isNaN(value) ? "" : +value.toPrecision(6),
  ]);
  return table([head, ...rows]);
}

// The view with its legend on white.
function picture() {
  draw();
  const view = byId("view");
  const made = document.createElement("canvas");
  Object.assign(made, { width: view.width, height: view.height });
  const pen = made.getContext("2d");
  const bar = document.createElement("canvas");
  const ratio = view.width / byId("stage").clientWidth;
  legend(bar, ratio);
  pen.drawImage(view, 0, 0);
  pen.drawImage(bar, view.width - bar.width - 8 * ratio, 8 * ratio);
  pen.font = `${14 * ratio}px system-ui, sans-serif`;
  pen.fillText(`${document.title}: ${data.outputs[shown.output]}`, 10 * ratio, 22 * ratio);
  return made;
}

function listen() {
  const on = (id, event, action) => byId(id).addEventListener(event, action);
  on("source", "change", async () => { shown.source = byId("source").value; probes = []; state = null; await newBody(); await show(); probed(); });
  on("field", "change", async () => { shown.field = byId("field").value; newField(); await show(); probed(); });
  on("map", "change", () => { colorMap(); range(); draw(); });
  for (const id of ["low", "high"])
    on(id, "change", () => { shown.fixed = [+byId("low").value, +byId("high").value]; range(); draw(); });
  on("all", "click", () => { shown.fixed = null; range(); draw(); });
  on("one", "click", () => { const part = field.parts[shown.output]; shown.fixed = part ? part.slice(1) : null; range(); draw(); });
  on("output", "input", () => { shown.output = +byId("output").value; show(); });
  on("scale", "input", () => { shown.scale = +byId("scale").value; uniforms.scale.value = shown.scale; draw(); });
  for (const id of ["edges", "rest"]) on(id, "change", async () => { await edges(); lines(); draw(); });
  for (const id of ["cut", "at", "flip"]) on(id, "input", async () => { await section(); draw(); });
  on("fit", "click", () => fit());
  document.querySelectorAll("[data-view]").forEach((one) => one.addEventListener("click", () => fit(+one.dataset.view)));
  on("picture", "click", () => picture().toBlob((blob) => save(fileName(shown.field, "png"), blob)));
  on("values", "click", () => save(fileName(shown.field, "csv"), new Blob([csv()], { type: "text/csv" })));
  on("probed", "click", async () => {
    const series = await probed();
    const axes = Object.entries(data.axes);
    const head = ["output", ...axes.map(([name]) => name), ...series.map((one) => title(`${shown.field} of ${one.name}`, unitOf()))];
    const rows = data.numbers.map((number, k) => [number, ...axes.map(([, x]) => x[k]), ...series.map((one) => one.y[k])]);
    save(`${data.name}-${shown.field}-probes.csv`, new Blob([table([head, ...rows])], { type: "text/csv" }));
  });
  on("clear", "click", () => { probes = []; probed(); draw(); });
  on("axis", "change", probed);
  for (const id of ["column", "over"]) on(id, "change", history);
  let playing = null;
  on("play", "click", () => {
    clearInterval(playing);
    playing = playing ? null : setInterval(() => { shown.output = (shown.output + 1) % data.outputs.length; show(); }, 350);
    byId("play").textContent = playing ? "⏸" : "▶";
  });
  let pressed = null;
  let waiting = false;
  on("view", "pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
  on("view", "pointerup", (event) => {
    if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
    const cell = pick(event.offsetX, event.offsetY);
    if (cell < 0) return;
    probes = probes.includes(cell) ? probes.filter((one) => one !== cell) : [...probes, cell];
    probed();
    draw();
  });
  on("view", "pointermove", (event) => {
    if (event.buttons || waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; hover(event.offsetX, event.offsetY); });
  });
  on("view", "pointerleave", () => (byId("tip").hidden = true));
}

// What is shown, in words for tests: page.html#test&pick=0.5,0.5
function report() {
  const gl = renderer.getContext();
  const view = byId("view");
  const read = new Uint8Array(view.width * view.height * 4);
  draw();
  gl.readPixels(0, 0, view.width, view.height, gl.RGBA, gl.UNSIGNED_BYTE, read);
  const found = new Set();
  for (let k = 0; k < read.length; k += 4) found.add((read[k] << 16) | (read[k + 1] << 8) | read[k + 2]);
  const said = document.createElement("script");
  said.type = "application/json";
  said.id = "report";
  const text = { ...shown, range: uniforms.range.value.toArray(), tip: byId("tip").hidden ? null : byId("tip").textContent,
    colors: found.size, section: parts.section.geometry.drawRange.count, csv: csv(), picture: picture().toDataURL().length };
  return probed().then((series) => {
    said.textContent = JSON.stringify({ ...text, probes: series }).replaceAll("<", "\\u003c");
    document.body.append(said);
  });
}

async function begin() {
  if (!data.outputs.length || !data.bodies.simulated) return;
  byId("viewer").hidden = false;
  start();
  byId("plots").hidden = false;
  byId("drawn").open = false;
  for (const name of Object.keys(data.maps)) option(name, name, byId("map"));
  if (data.bodies.measured) Object.assign(data.bodies, await measuredBodies(data.bodies.measured));
  for (const name of Object.keys(data.bodies)) option(name, name, byId("source"));
  byId("sources").hidden = Object.keys(data.bodies).length < 2;
  for (const [value, text] of [["", "none"], ["0", "x₁"], ["1", "x₂"], ["2", "x₃"], ["view", "as seen"]]) option(value, text, byId("cut"));
  for (const name of Object.keys(data.axes)) option(name, name, byId("axis"));
  for (const name of Object.keys(data.history)) for (const id of ["column", "over"]) option(name, name, byId(id));
  const columns = Object.keys(data.history);
  byId("over").value = columns.find((one) => /^(stretch|t|time)\b/.test(one)) ?? columns[0] ?? "";
  byId("column").value = columns.find((one) => /^(nominal_stress|force_)/.test(one)) ?? columns.at(-1) ?? "";
  byId("output").max = data.outputs.length - 1;
  for (const key of ["source", "field"]) if (asked.has(key)) shown[key] = asked.get(key);
  if (data.numbers.includes(+asked.get("output") || 0) && asked.has("output")) shown.output = data.numbers.indexOf(+asked.get("output"));
  if (asked.has("scale")) byId("scale").value = shown.scale = +asked.get("scale");
  if (!(shown.source in data.bodies)) shown.source = "simulated";
  byId("source").value = shown.source;
  await newBody();
  if (asked.has("cut")) [byId("cut").value, byId("at").value] = asked.get("cut").split(",");
  byId("hint").textContent = body.dimension === 2 ? "drag to move, wheel to zoom" : "drag to turn, right-drag to move, wheel to zoom";
  listen();
  await boxOf(data.bodies.simulated);
  fit();
  await show();
  if (asked.has("pick")) {
    const { clientWidth: width, clientHeight: height } = byId("stage");
    const [x, y] = asked.get("pick").split(",").map(Number);
    hover(x * width, y * height);
    const cell = pick(x * width, y * height);
    if (cell >= 0) probes = [cell];
  }
  await probed();
  history();
  draw();
  if (asked.has("test")) await report();
}

begin().catch((error) => {
  byId("viewer").hidden = byId("plots").hidden = byId("drawn").open = true;
  byId("why").hidden = false;
  console.warn(error);
});
