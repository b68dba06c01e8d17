"use strict";
(() => {
  const root = document.documentElement;
  const all = (selector, from = document) => [...from.querySelectorAll(selector)];
  const stored = key => { try { return localStorage.getItem(key); } catch { return null; } };

  // Light and dark: the system's choice until the reader makes one.
  if (stored("theme")) root.dataset.theme = stored("theme");
  document.getElementById("theme").addEventListener("click", () => {
    const shown = root.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    root.dataset.theme = shown === "dark" ? "light" : "dark";
    try { localStorage.setItem("theme", root.dataset.theme); } catch { /* pages of some origins have no storage */ }
  });

  // Tables whose headings sort their first body; rows without a value come last.
  for (const button of all("button.sort")) button.addEventListener("click", () => {
    const head = button.closest("th"), body = button.closest("table").tBodies[0], column = head.cellIndex;
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of head.parentNode.children) other.setAttribute("aria-sort", "none");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const key = row => row.children[column].dataset.key ?? "";
    body.append(...[...body.rows].sort((a, b) => {
      const x = key(a), y = key(b);
      if (x === "" || y === "") return (x === "") - (y === "");
      const order = Number.isNaN(Number(x)) || Number.isNaN(Number(y)) ? x.localeCompare(y) : x - y;
      return up ? order : -order;
    }));
  });

  // One selector shows one tier: rows, columns and pictures of others are hidden.
  const tier = document.getElementById("tier");
  const chosen = () => (tier ? tier.value : "");
  const showTier = () => {
    for (const each of all("[data-tier]")) each.hidden = chosen() !== "" && each.dataset.tier !== chosen();
    showPairs();
  };

  // The pairs: filter, sort, count.
  const pairs = all("figure.example"), list = document.getElementById("pairs");
  const cause = document.getElementById("cause"), order = document.getElementById("order"), find = document.getElementById("find");
  function showPairs() {
    if (!list) return;
    const words = find.value.trim().toLowerCase();
    let count = 0;
    for (const pair of pairs) {
      const data = pair.dataset;
      pair.hidden = !((chosen() === "" || data.tier === chosen()) && (cause.value === "" || data.cause === cause.value)
        && data.find.toLowerCase().includes(words));
      count += !pair.hidden;
    }
    document.getElementById("count").textContent = `${count} of ${pairs.length} pairs`;
  }
  function sortPairs() {
    const [key, down] = order.value.split(" ");
    const value = pair => Number(pair.dataset[key]);
    list.append(...pairs.sort((a, b) => (value(a) - value(b)) * (down ? -1 : 1)));
  }
  if (list) {
    for (const each of [cause, find]) each.addEventListener("input", showPairs);
    order.addEventListener("input", sortPairs);
    sortPairs();
  }
  if (tier) tier.addEventListener("input", showTier);
  showPairs();

  // Under the pointer: the nearest query, its truth, its answer, its error.
  const tip = document.getElementById("tip");
  const names = tip ? JSON.parse(tip.dataset.causes) : [];
  const place = value => value.toFixed(1);
  function nearest(svg, event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const left = Number(svg.dataset.left), reach = svg.viewBox.baseVal.width / 30;
    let best = null, least = reach;
    JSON.parse(svg.closest("[data-points]").dataset.points).forEach((point, index) => {
      for (const [u, v] of [[point[0], point[1]], [point[2] + left, point[3]], [point[4] + left, point[5]]]) {
        const gap = Math.hypot(u - at.x, v - at.y);
        if (gap < least) { least = gap; best = { index, point }; }
      }
    });
    return best;
  }
  function mark(svg, index) {
    svg.classList.toggle("marked", index !== null);
    for (const each of all("[data-q]", svg)) each.classList.toggle("on", Number(each.dataset.q) === index);
  }
  function hover(event) {
    const svg = event.target.closest?.("svg.pair");
    for (const other of all("svg.marked")) if (other !== svg) mark(other, null);
    const best = svg && svg.closest("[data-points]") ? nearest(svg, event) : null;
    if (svg) mark(svg, best ? best.index : null);
    tip.hidden = !best;
    if (!best) return;
    const [ua, va, ub, vb, u, v, error, code] = best.point;
    tip.replaceChildren(...[
      `Query (${place(ua)}, ${place(va)})`, `Truth (${place(ub)}, ${place(vb)})`, `Answer (${place(u)}, ${place(v)})`,
      `Error ${place(error)} px`, ...(names[code] ? [names[code]] : []),
    ].map(text => Object.assign(document.createElement("div"), { textContent: text })));
    const box = tip.getBoundingClientRect();
    tip.style.left = `${Math.max(4, Math.min(event.clientX + 14, innerWidth - box.width - 4))}px`;
    tip.style.top = `${event.clientY + 18 + box.height > innerHeight ? event.clientY - box.height - 10 : event.clientY + 18}px`;
  }
  const dialog = document.getElementById("large");
  if (tip) {
    addEventListener("pointermove", hover);
    addEventListener("pointerdown", hover);
    const open = figure => {
      const copy = figure.cloneNode(true);
      copy.removeAttribute("tabindex");
      dialog.querySelector("div").replaceChildren(copy);
      dialog.showModal();
      dialog.append(tip);  // above the dialog
    };
    for (const figure of pairs) {
      figure.addEventListener("click", () => open(figure));
      figure.addEventListener("keydown", event => { if (event.key === "Enter") { event.preventDefault(); open(figure); } });
    }
    dialog.addEventListener("close", () => { document.body.append(tip); tip.hidden = true; });
    dialog.addEventListener("click", event => { if (event.target === dialog) dialog.close(); });
  }
})();
