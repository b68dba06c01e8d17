// Scores answers by the definitions of docs/scoring.md, without Pliant: one line of JSON per folder.
// Usage: npm install; node score_answers.mjs FOLDER…
// A FOLDER has queries.parquet, truth.parquet, answers.parquet (compression `snappy` or none) and
// size.json, [width, height]. It gets copied.parquet: the answers in reverse order.
import { readFileSync } from 'node:fs'
import { asyncBufferFromFile, parquetMetadataAsync, parquetReadObjects } from 'hyparquet'
import { parquetWriteFile } from 'hyparquet-writer'

const mean = (values) => values.length ? values.reduce((sum, value) => sum + value, 0) / values.length : null
const root = (value) => value === null ? null : Math.sqrt(value)
const key = (row) => `${row.pair_id} ${row.query_id}`

async function read(path) {
  const file = await asyncBufferFromFile(path)
  return { rows: await parquetReadObjects({ file }), metadata: await parquetMetadataAsync(file) }
}

function copy(filename, { rows, metadata }) {
  const reversed = [...rows].reverse()
  const types = Object.fromEntries(metadata.schema.map(({ name, type }) => [name, type]))
  parquetWriteFile({
    filename,
    columnData: Object.keys(rows[0]).map((name) => ({ name, type: types[name], data: reversed.map((row) => row[name]), nullable: false })),
    kvMetadata: metadata.key_value_metadata.filter((entry) => entry.key === 'pliant'),
  })
}

function score(rows, [width, height]) {
  const seen = rows.filter((row) => row.seen)
  const errors = seen.map((row) => row.error)
  const result = { rmse_px: root(mean(errors.map((error) => error ** 2))), mean_px: mean(errors) }
  for (const t of [1, 2, 4, 8, 16, 32]) result[`pck_${t}px`] = mean(seen.map((row) => +(row.answer !== undefined && row.error <= t)))
  const videos = [...new Set(rows.map((row) => row.pair_id))].map((id) => rows.filter((row) => row.pair_id === id))
  const says = (row) => row.answer === undefined || (row.answer.visible ?? 1) >= 0.5
  const near = (row, t) => row.answer !== undefined &&
    Math.hypot((row.answer.u - row.u_b) * 256 / width, (row.answer.v - row.v_b) * 256 / height) < t
  result.oa = mean(videos.map((video) => mean(video.map((row) => +(row.answer !== undefined && says(row) === row.seen)))))
  const [deltas, jaccards] = [[], []]
  for (const t of [1, 2, 4, 8, 16]) {
    const [within, jaccard] = [[], []]
    for (const video of videos) {
      const visible = video.filter((row) => row.seen)
      const positive = visible.filter((row) => says(row) && near(row, t)).length
      const wrong = video.filter((row) => says(row) && !(row.seen && near(row, t))).length
      if (visible.length) within.push(mean(visible.map((row) => +near(row, t))))
      if (visible.length + wrong) jaccard.push(positive / (visible.length + wrong))
    }
    deltas.push(mean(within))
    jaccards.push(mean(jaccard))
  }
  result.delta_avg = deltas.includes(null) ? null : mean(deltas)
  result.aj = jaccards.includes(null) ? null : mean(jaccards)
  return result
}

for (const folder of process.argv.slice(2)) {
  const size = JSON.parse(readFileSync(`${folder}/size.json`, 'utf8'))
  const [queries, truth, answers] = await Promise.all(
    ['queries', 'truth', 'answers'].map((name) => read(`${folder}/${name}.parquet`)))
  const given = new Map(answers.rows.map((row) => [key(row), row]))
  const asked = new Map(queries.rows.map((row) => [key(row), row]))
  const rows = truth.rows.map((row) => {
    const answer = given.get(key(row))
    const error = answer === undefined ? Math.hypot(...size) : Math.hypot(answer.u - row.u_b, answer.v - row.v_b)
    return { ...asked.get(key(row)), ...row, answer, error, seen: row.visibility_b === 'visible' }
  })
  copy(`${folder}/copied.parquet`, answers)
  console.log(JSON.stringify(score(rows, size)))
}
