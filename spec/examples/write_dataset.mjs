// Writes the dataset of SPEC.md's walkthrough, and answers to it: write_dataset.py in JavaScript.
// Usage: npm install; node write_dataset.mjs DATASET ANSWERS.parquet
import { createHash } from 'node:crypto'
import { mkdirSync, readFileSync, statSync, writeFileSync } from 'node:fs'
import { deflateSync } from 'node:zlib'
import { parquetWriteFile } from 'hyparquet-writer'

const [root, submission] = process.argv.slice(2)
const [WIDTH, HEIGHT, FOCAL_PX, CAMERA_M, SIDE_M] = [64, 48, 100, 0.5, 0.15]
const POSES = [[0.96, 0.28, 0, 0], [0.28, 0.96, 0.1, 0.02]] // cos, sin, x_m, y_m of each frame
const GRID = [0.125, 0.5, 0.875] // material coordinates of the 3 x 3 points
const ORDER = [4, 0, 7, 2, 8, 5, 1, 6, 3] // the queries, in random order
const [NAME, VERSION] = [{ id: 'card', version: '1.0.0' }, '1.0.0']
const ID = 'card-test-000000'
const folder = `${root}/sequences/card/${ID}`

// --- JSON and Parquet ---------------------------------------------------------------------
const sorted = (value) =>
  value instanceof Array ? value.map(sorted)
  : value instanceof Object ? Object.fromEntries(Object.keys(value).sort().map((key) => [key, sorted(value[key])]))
  : value
const saveJson = (path, document) => writeFileSync(path, JSON.stringify(sorted(document), null, 1) + '\n')
const sha256 = (path) => createHash('sha256').update(readFileSync(path)).digest('hex')

// A column's type -> its elements of the Parquet schema.
const one = (type, extra) => (name) => [{ name, type, repetition_type: 'REQUIRED', ...extra }]
const INT = one('INT32'), LONG = one('INT64'), BOOL = one('BOOLEAN'), FLOAT = one('FLOAT')
const TEXT = one('BYTE_ARRAY', { converted_type: 'UTF8' })
const nullable = (kind) => (name) => kind(name).map((each) => ({ ...each, repetition_type: 'OPTIONAL' }))
const list = (...element) => (name) => [
  { name, repetition_type: 'OPTIONAL', num_children: 1, converted_type: 'LIST' },
  { name: 'list', repetition_type: 'REPEATED', num_children: 1 },
  ...element,
]
const INTS = list({ name: 'element', type: 'INT32', repetition_type: 'OPTIONAL' })
const ALTERNATIVES = list(
  { name: 'element', repetition_type: 'OPTIONAL', num_children: 3 },
  ...FLOAT('u'), ...FLOAT('v'), ...TEXT('visibility'),
)

function saveTable(filename, columns, footer) {
  const names = Object.keys(columns)
  parquetWriteFile({
    filename,
    columnData: names.map((name) => ({ name, data: columns[name][1] })),
    schema: [{ name: 'root', num_children: names.length }, ...names.flatMap((name) => columns[name][0](name))],
    kvMetadata: [{ key: 'pliant', value: JSON.stringify({ spec_version: VERSION, ...footer }) }],
  })
}

// --- PNG and OpenEXR ----------------------------------------------------------------------
function crc32(bytes) {
  let crc = ~0
  for (const byte of bytes) {
    crc ^= byte
    for (let bit = 0; bit < 8; bit++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0)
  }
  return ~crc >>> 0
}

function savePng(path, grey) { // Uint8Array of WIDTH x HEIGHT, written as RGB
  const chunk = (name, data) => {
    const body = Buffer.concat([Buffer.from(name, 'latin1'), data])
    const ends = Buffer.alloc(8)
    ends.writeUInt32BE(data.length, 0)
    ends.writeUInt32BE(crc32(body), 4)
    return Buffer.concat([ends.subarray(0, 4), body, ends.subarray(4)])
  }
  const head = Buffer.alloc(13)
  head.writeUInt32BE(WIDTH, 0)
  head.writeUInt32BE(HEIGHT, 4)
  head.set([8, 2, 0, 0, 0], 8) // 8 bits, RGB, not interlaced
  const pixels = Buffer.alloc(HEIGHT * (1 + 3 * WIDTH)) // each row begins with its filter, 0
  grey.forEach((value, at) => {
    const [row, column] = [Math.floor(at / WIDTH), at % WIDTH]
    pixels.fill(value, row * (1 + 3 * WIDTH) + 1 + 3 * column, row * (1 + 3 * WIDTH) + 4 + 3 * column)
  })
  const chunks = [['IHDR', head], ['IDAT', deflateSync(pixels)], ['IEND', Buffer.alloc(0)]]
  const magic = Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a])
  writeFileSync(path, Buffer.concat([magic, ...chunks.map(([name, data]) => chunk(name, data))]))
}

function saveExr(path, channels) { // name -> Float32Array or Uint32Array, names in ASCII order
  const text = (value) => Buffer.from(value + '\0', 'latin1')
  const ints = (...values) => Buffer.from(Int32Array.from(values).buffer)
  const floats = (...values) => Buffer.from(Float32Array.from(values).buffer)
  const attribute = (name, type, data) => [text(name), text(type), ints(data.length), data]
  const listed = Object.entries(channels).flatMap(([name, data]) =>
    [text(name), ints(data instanceof Uint32Array ? 0 : 2, 0, 1, 1)]) // UINT or FLOAT
  const window = ints(0, 0, WIDTH - 1, HEIGHT - 1)
  const header = Buffer.concat([
    ints(20000630, 2),
    ...attribute('channels', 'chlist', Buffer.concat([...listed, Buffer.alloc(1)])),
    ...attribute('compression', 'compression', Buffer.from([0])), // NONE
    ...attribute('dataWindow', 'box2i', window),
    ...attribute('displayWindow', 'box2i', window),
    ...attribute('lineOrder', 'lineOrder', Buffer.from([0])),
    ...attribute('pixelAspectRatio', 'float', floats(1)),
    ...attribute('screenWindowCenter', 'v2f', floats(0, 0)),
    ...attribute('screenWindowWidth', 'float', floats(1)),
    Buffer.alloc(1),
  ])
  const rows = Array.from({ length: HEIGHT }, (_, row) => {
    const parts = Object.values(channels).map((data) => data.slice(row * WIDTH, (row + 1) * WIDTH))
    const bytes = Buffer.concat(parts.map((part) => Buffer.from(part.buffer)))
    return Buffer.concat([ints(row, bytes.length), bytes])
  })
  const begins = BigUint64Array.from(rows, (row, index) => BigInt(header.length + 8 * HEIGHT + index * row.length))
  writeFileSync(path, Buffer.concat([header, Buffer.from(begins.buffer), ...rows]))
}

// --- the scene ----------------------------------------------------------------------------
function saveImages(frame) { // returns the longer side of the object's box, px
  const [cos, sin, xM, yM] = POSES[frame]
  const size = WIDTH * HEIGHT
  const grey = new Uint8Array(size).fill(60)
  const channels = {
    Z: new Float32Array(size).fill(Infinity),
    'surface.m0': new Float32Array(size),
    'surface.m1': new Float32Array(size),
    'surface.object': new Uint32Array(size),
  }
  const [rows, columns] = [[], []]
  for (let at = 0; at < size; at++) {
    const [u, v] = [(at % WIDTH) + 0.5, Math.floor(at / WIDTH) + 0.5] // the pixel's centre
    const x = (u - WIDTH / 2) * CAMERA_M / FOCAL_PX - xM
    const y = -(v - HEIGHT / 2) * CAMERA_M / FOCAL_PX - yM
    const [m0, m1] = [(cos * x + sin * y) / SIDE_M + 0.5, (cos * y - sin * x) / SIDE_M + 0.5]
    if (Math.min(m0, m1) < 0 || Math.max(m0, m1) > 1) continue
    grey[at] = Math.abs(Math.abs(m0 - 0.5) - 0.25) < 0.1 ? 150 : 220
    channels.Z[at] = CAMERA_M
    channels['surface.m0'][at] = m0
    channels['surface.m1'][at] = m1
    channels['surface.object'][at] = 1
    rows.push(v)
    columns.push(u)
  }
  savePng(`${folder}/rgb/00000${frame}.png`, grey)
  saveExr(`${folder}/depth/00000${frame}.exr`, channels)
  return Math.max(...[rows, columns].map((each) => Math.max(...each) - Math.min(...each) + 1))
}

function place(frame, [m0, m1], point) {
  const [cos, sin, xM, yM] = POSES[frame]
  const [a, b] = [(m0 - 0.5) * SIDE_M, (m1 - 0.5) * SIDE_M]
  const [x, y] = [xM + cos * a - sin * b, yM + sin * a + cos * b]
  const [u, v] = [FOCAL_PX * x / CAMERA_M + WIDTH / 2, -FOCAL_PX * y / CAMERA_M + HEIGHT / 2]
  const visibility = 0 <= u && u < WIDTH && 0 <= v && v < HEIGHT ? 'visible' : 'out_of_frame'
  return { frame, point, u_px: u, v_px: v, depth_m: CAMERA_M, visibility, x_m: x, y_m: y, z_m: 0 }
}

// --- the dataset --------------------------------------------------------------------------
for (const name of [`${folder}/rgb`, `${folder}/depth`, `${root}/queries`, `${root}/truth`]) mkdirSync(name, { recursive: true })
const boxes = [0, 1].map(saveImages)

const K = [[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1]]
const pose = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, CAMERA_M], [0, 0, 0, 1]]
const imageSize = { width: WIDTH, height: HEIGHT }
const cameras = [0, 1].map((frame) => ({ frame, K, world_to_camera: pose }))
saveJson(`${folder}/cameras.json`, { spec_version: VERSION, ...imageSize, frames: cameras })

const material = GRID.flatMap((m1) => GRID.map((m0) => [m0, m1]))
const fill = (count, value) => new Array(count).fill(value)
saveTable(`${folder}/points.parquet`, {
  point: [INT, material.map((_, point) => point)],
  object: [INT, fill(9, 1)],
  kind: [TEXT, fill(9, 'surface')],
  m0: [FLOAT, material.map(([m0]) => m0)],
  m1: [FLOAT, material.map(([, m1]) => m1)],
  partners: [INTS, material.map((_, point) => [8 - point])], // after half a turn
}, { table: 'points' })
const found = [0, 1].map((frame) => material.map((m, point) => place(frame, m, point)))
const kinds = { frame: INT, point: INT, u_px: FLOAT, v_px: FLOAT, depth_m: FLOAT, visibility: TEXT, x_m: FLOAT, y_m: FLOAT, z_m: FLOAT }
const rows = found.flat()
const correspondences = Object.entries(kinds).map(([name, kind]) => [name, [kind, rows.map((row) => row[name])]])
saveTable(`${folder}/correspondences.parquet`, Object.fromEntries(correspondences), { table: 'correspondences' })

const files = ['cameras.json', 'correspondences.parquet', 'depth/000000.exr', 'depth/000001.exr', 'points.parquet', 'rgb/000000.png', 'rgb/000001.png']
  .map((path) => ({ path, sha256: sha256(`${folder}/${path}`), bytes: statSync(`${folder}/${path}`).size }))
const same = { id: ID, tier: 'card', split: 'test', shape: null, frames: 2, temporal: false, seed: 0, style: 'external' }
const free = { index: 0, noise: null, parameters: {}, frame_info: [{}, {}], tools: {} }
saveJson(`${folder}/sequence.json`, { spec_version: VERSION, ...same, ...free, files })
saveTable(`${root}/sequences.parquet`, {
  id: [TEXT, [ID]], tier: [TEXT, ['card']], split: [TEXT, ['test']], shape: [nullable(TEXT), [null]],
  frames: [INT, [2]], temporal: [BOOL, [false]], seed: [LONG, [0n]], style: [TEXT, ['external']],
  coverage: [nullable(FLOAT), [null]], self_occluded: [FLOAT, [0]],
}, { table: 'sequences', dataset: NAME })

saveJson(`${root}/dataset.json`, {
  spec_version: VERSION,
  ...NAME,
  title: 'Card',
  description: 'A card in two frames.',
  licence: 'CC0-1.0',
  conventions: {
    pixel_origin: 'top_left_corner', first_pixel_centre: [0.5, 0.5], pixel_axes: { u: 'right', v: 'down' },
    camera_axes: { x: 'right', y: 'down', z: 'forward' }, pose: 'world_to_camera', length_unit: 'm', angle_unit: 'rad',
    depth: 'planar_z', depth_background: '+inf', colour_space: 'sRGB',
    visibility_states: ['visible', 'self_occluded', 'occluded', 'out_of_frame'],
  },
  image_size: imageSize,
  tiers: [{
    name: 'card', kind: 'cloth', variant: 'printed', queried_object: 1,
    objects: [{
      id: 1,
      name: 'card',
      material: ['u', 'v'].map((name) => ({ name, min: 0, max: 1, metres_per_unit: SIDE_M, period: null })),
    }],
    symmetries: [{ name: 'rotate-180', matrix: [[-1, 0], [0, -1]], offset: [1, 1] }],
  }],
  splits: ['test'],
  provenance: { generator: 'write_dataset', seed: null, config: {}, tools: {} },
})

const of = { dataset: NAME, split: 'test' }
const pair = { pair_id: [INT, fill(9, 0)], query_id: [INT, ORDER.map((_, row) => row)] }
const tier = [TEXT, fill(9, 'card')]
const at = (frame, name) => ORDER.map((point) => found[frame][point][name])
saveTable(`${root}/queries/test.parquet`, {
  ...pair, tier,
  sequence_a: [TEXT, fill(9, ID)], frame_a: [INT, fill(9, 0)],
  sequence_b: [TEXT, fill(9, ID)], frame_b: [INT, fill(9, 1)],
  u_a: [FLOAT, at(0, 'u_px')], v_a: [FLOAT, at(0, 'v_px')],
}, { table: 'queries', ...of })
const asked = sha256(`${root}/queries/test.parquet`)
const alternatives = ORDER.map((point) => {
  const { u_px: u, v_px: v, visibility } = found[1][8 - point]
  return [{ u, v, visibility }]
})
saveTable(`${root}/truth/test.parquet`, {
  ...pair, tier,
  point: [INT, ORDER],
  u_b: [FLOAT, at(1, 'u_px')], v_b: [FLOAT, at(1, 'v_px')], visibility_b: [TEXT, at(1, 'visibility')],
  box_px: [FLOAT, fill(9, boxes[1])],
  alternatives: [ALTERNATIVES, alternatives],
}, { table: 'truth', ...of, queries_sha256: asked })

// The answers: every point where it was, 20 px to the right.
const moved = at(0, 'u_px').map((u) => u + 20)
const answers = { ...pair, u: [FLOAT, moved], v: [FLOAT, at(0, 'v_px')] }
saveTable(submission, answers, { table: 'answers', ...of, queries_sha256: asked, method: { name: 'twenty-right' } })
