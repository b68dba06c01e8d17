"use strict";
(() => {
  // Ink is the text's own colour, so that light and dark pages need no second drawing.
  const ink = { labelColor: "currentColor", titleColor: "currentColor" };
  const config = {
    background: null, font: "system-ui, sans-serif", view: { stroke: null },
    axis: { ...ink, domainColor: "currentColor", tickColor: "currentColor", gridColor: "currentColor", gridOpacity: .12, titleFontWeight: "normal" },
    legend: { ...ink, orient: "bottom", symbolType: "stroke", labelLimit: 240 },
    title: { color: "currentColor", anchor: "start" },
    rule: { color: "currentColor" }, tick: { color: "currentColor", thickness: 2 },
    range: { category: ["#3a86b8", "#c8553d", "#3d8b5f", "#8a5a9e", "#b8862b", "#7a8790", "#2b9aa8", "#a34a6b"] },
  };
  const tip = Object.assign(document.createElement("div"), { className: "tip", hidden: true });
  document.body.append(tip);
  const written = value => typeof value === "number" ? String(Number(value.toPrecision(4))) : String(value);
  const show = (handler, event, item, values) => {
    tip.hidden = !values;
    if (!values) return;
    tip.replaceChildren(...Object.entries(values).map(([key, value]) =>
      Object.assign(document.createElement("div"), { textContent: `${key} ${written(value)}` })));
    tip.style.left = `${Math.max(4, Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 4))}px`;
    tip.style.top = `${event.clientY + 18}px`;
  };
  for (const figure of document.querySelectorAll("[data-chart]")) {
    config.legend.columns = figure.clientWidth < 480 ? 1 : 2;
    config.title.limit = figure.clientWidth - 20; // a longer one would narrow the chart
    const chart = { width: "container", height: 190, autosize: { type: "fit-x", contains: "padding" }, ...JSON.parse(figure.dataset.chart), config };
    const program = vega.parse(vegaLite.compile(chart).spec, null, { ast: true });
    const view = new vega.View(program, { expr: vega.expressionInterpreter, renderer: "svg", container: figure, hover: true });
    view.tooltip(show).runAsync().then(() => { figure.dataset.drawn = "yes"; });
  }
})();
