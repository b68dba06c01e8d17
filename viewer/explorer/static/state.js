// What is shown, kept in the address: every view has a link of its own.

const DEFAULTS = {
  a: "", b: "", u: null, v: null, pinned: false,
  tab: "compare", layer: "rgb", method: 0, heat: true, opacity: 80, lens: true,
  tier: "", split: "", sequence: "", sort: "",
  of: "a", frame: null,
};
const listeners = new Set();
export const state = { ...DEFAULTS };

/** Change what is shown; listeners get the names of what changed. */
export function set(changes) {
  const changed = Object.keys(changes).filter(name => state[name] !== changes[name]);
  if (!changed.length) return;
  Object.assign(state, changes);
  for (const listener of listeners) listener(new Set(changed));
}

export function onChange(listener) { listeners.add(listener); }

/** Take what the address says, with defaults for the rest. */
export function read(extra = {}) {
  const given = new URLSearchParams(location.hash.slice(1));
  const next = { ...DEFAULTS, ...extra };
  for (const [name, fallback] of Object.entries(DEFAULTS)) {
    if (!given.has(name)) continue;
    const text = given.get(name);
    if (typeof fallback === "boolean") next[name] = text === "1";
    else if (typeof fallback === "number" || fallback === null) {
      if (text !== "" && Number.isFinite(Number(text))) next[name] = Number(text);
    } else next[name] = text;
  }
  return next;
}

let due = 0;
export function write() {
  clearTimeout(due);
  due = setTimeout(() => {
    const out = new URLSearchParams();
    for (const [name, fallback] of Object.entries(DEFAULTS)) {
      const value = state[name];
      if (value === fallback || value === null) continue;
      out.set(name, typeof value === "boolean" ? (value ? "1" : "0") : String(value));
    }
    history.replaceState(null, "", "#" + out.toString().replaceAll("%2F", "/"));
  }, 80);
}
