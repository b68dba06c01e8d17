// Requests to the server that sent this page, and to no other. A page without a server contains its answers.

const kept = JSON.parse(document.getElementById("kept")?.textContent ?? "null");

export function address(name, parameters = {}) {
  if (kept) return kept.layers[parameters.frame][parameters.layer];
  const given = Object.entries(parameters).filter(([, value]) => value !== null && value !== undefined);
  return `api/${name}?${new URLSearchParams(given)}`;
}

function fetched(name, parameters) {
  const ended = () => { throw new Error("The command has ended. Run it again, and open the address that it prints."); };
  return fetch(address(name, parameters)).catch(ended);
}

export async function get(name, parameters) {
  if (kept) return ofNearest(name, parameters);
  const answer = await fetched(name, parameters);
  const document = await answer.json();
  if (!answer.ok) throw new Error(document.error ?? answer.statusText);
  return document;
}

/** What the page contains: of a point, that of the nearest query, or null where none is near. */
function ofNearest(name, { u, v, method } = {}) {
  if (["dataset", "missing", "queries"].includes(name)) return kept[name];
  const gaps = kept.queries.map(([x, y]) => Math.hypot(x - u, y - v)), least = Math.min(...gaps);
  if (least > kept.reach_px) return null;
  return (name === "truth" ? kept.truth : kept.answers[method])[gaps.indexOf(least)];
}

/** The query that a pair opens with: near the middle of the list, on the object, and visible in the target. */
export async function opening(queries, pair) {
  const middle = queries.length >> 1;
  for (const [u, v] of [...queries.slice(middle), ...queries.slice(0, middle)].slice(0, 12)) {
    const truth = await get("truth", { ...pair, u, v }).catch(() => null);
    if (truth?.visibility === "visible") return [u, v];
  }
  return queries[middle];
}

/** Bytes, or null where the dataset has none. */
export async function bytes(name, parameters) {
  const answer = await fetched(name, parameters);
  if (answer.status === 204) return null;
  if (!answer.ok) throw new Error((await answer.json()).error ?? answer.statusText);
  return answer.arrayBuffer();
}

/** Calls `work` for the last thing asked; what is asked in between is skipped. */
export class Latest {
  constructor(work) { this.work = work; this.busy = false; this.waiting = null; }
  async ask(...what) {
    this.waiting = what;
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.waiting) {
        const next = this.waiting;
        this.waiting = null;
        await this.work(...next);
      }
    } finally { this.busy = false; }
  }
}
