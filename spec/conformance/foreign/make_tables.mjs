// Writes the rows of truth.json as a Parquet file in JavaScript; see make_tables.py.
import { readFileSync, unlinkSync } from 'node:fs'
import { parquetWriteFile } from 'hyparquet-writer'

const { pliant, rows } = JSON.parse(readFileSync('truth.json', 'utf8'))
const text = (name) => ({ name, type: 'BYTE_ARRAY', converted_type: 'UTF8', repetition_type: 'REQUIRED' })
const number = (name, type) => ({ name, type, repetition_type: 'REQUIRED' })
const schema = [
  { name: 'root', num_children: 9 },
  number('pair_id', 'INT32'),
  number('query_id', 'INT32'),
  text('tier'),
  number('point', 'INT32'),
  number('u_b', 'FLOAT'),
  number('v_b', 'FLOAT'),
  text('visibility_b'),
  number('box_px', 'FLOAT'),
  { name: 'alternatives', repetition_type: 'OPTIONAL', num_children: 1, converted_type: 'LIST' },
  { name: 'list', repetition_type: 'REPEATED', num_children: 1 },
  { name: 'element', repetition_type: 'OPTIONAL', num_children: 3 },
  text('visibility'),
  number('u', 'FLOAT'),
  number('v', 'FLOAT'),
]
const names = schema.slice(1, 10).map((element) => element.name)
parquetWriteFile({
  filename: 'javascript.parquet',
  columnData: names.map((name) => ({ name, data: rows.map((row) => row[name]) })),
  schema,
  rowGroupSize: 4,
  kvMetadata: [{ key: 'pliant', value: pliant }],
})
unlinkSync('truth.json')
