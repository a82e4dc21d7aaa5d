import uPlot from "uplot";
import { byId, element } from "../shared/dom.js";
import { digits, percent, plural } from "../shared/formatting.js";

const HEIGHT = 330;
const KINDS = [
  ["S", "surely stable", "--s"],
  ["M", "ambiguous", "--m"],
  ["U", "no grasp found", "--u"],
];

const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

const column = (quartiles, number) => quartiles.map((one) => (one ? 100 * one[number] : null));

/** A median in its colour over a wider dark line, so that yellow is visible on white. */
function line(name, dash) {
  const points = { show: true, size: 5, fill: () => color(name), stroke: () => color("--ink"), width: 0.5 };
  return [
    { stroke: () => color("--quiet"), width: 4, dash, points: { show: false } },
    { stroke: () => color(name), width: 2.5, dash, points },
  ];
}

function axis(label) {
  return {
    label,
    stroke: () => color("--quiet"),
    grid: { stroke: () => color("--line"), width: 1 },
    ticks: { stroke: () => color("--line"), width: 1 },
    labelSize: 22,
    size: 44,
    font: "12px system-ui, sans-serif",
    labelFont: "12px system-ui, sans-serif",
  };
}

function options(width, curve, onMove) {
  const hidden = { width: 0, points: { show: false } };
  const [first, last] = [curve.resolution[0], curve.resolution.at(-1)];
  const margin = last > first ? 0.02 * (last - first) : 1;
  return {
    width,
    height: HEIGHT,
    legend: { show: false },
    cursor: { y: false, drag: { x: false, y: false } },
    scales: { x: { time: false, range: () => [first - margin, last + margin] }, y: { range: () => [-2, 102] } },
    axes: [axis("sensor resolution α [degrees]"), axis("area fraction [%]")],
    bands: [{ series: [2, 1], fill: () => `${color("--s")}33` }],
    series: [{}, hidden, hidden, ...line("--m", [8, 4]), ...line("--u", [3, 3]), ...line("--s")],
    hooks: { setCursor: [(plot) => onMove(plot.cursor.idx ?? null)] },
  };
}

function plotted(curve) {
  const twice = (kind) => [column(curve[kind], 1), column(curve[kind], 1)];
  return [curve.resolution, column(curve.S, 0), column(curve.S, 2), ...twice("M"), ...twice("U"), ...twice("S")];
}

function readoutAt(curve, number) {
  const [low, middle, high] = curve.S[number];
  const medians = ["M", "U"].map((kind) =>
    `${kind} ${curve[kind][number] ? percent(curve[kind][number][1], 1) : "not searched"}`);
  return `α ${digits(curve.resolution[number], 4)}°: S ${percent(middle, 1)} (middle half of the meshes ` +
    `${percent(low, 1)} to ${percent(high, 1)}), ${medians.join(", ")}; ${plural(curve.meshes[number], "mesh", "meshes")}`;
}

/** A note on meshes without M and U; empty: all have them. */
function unsearchedNote(curve) {
  const missing = curve.searched.findIndex((count, number) => count < curve.meshes[number]);
  if (missing < 0) return "";
  return `From α ${digits(curve.resolution[missing], 4)}° on, some meshes have no values of M and U, since atan μ + α/2 ` +
    "exceeds their searched cone. The medians are over the other meshes.";
}

function showValues(curve) {
  const head = ["α [°]", "S lower quartile", "S median", "S upper quartile", "M median", "U median", "meshes"];
  const body = curve.resolution.map((resolution, number) => [
    digits(resolution, 4),
    ...curve.S[number].map((fraction) => percent(fraction, 1)),
    ...["M", "U"].map((kind) => (curve[kind][number] ? percent(curve[kind][number][1], 1) : "not searched")),
    curve.meshes[number].toLocaleString("en"),
  ]);
  byId("values").className = "plain";
  byId("values").replaceChildren(
    element("thead", {}, element("tr", {}, ...head.map((title) => element("th", { scope: "col" }, title)))),
    element("tbody", {}, ...body.map((cells) => element("tr", {}, ...cells.map((cell) => element("td", {}, cell))))),
  );
}

/** A list for each axis with several values; returns a function of the chosen curve. */
function showAxes(axes, curves, shown, onChange) {
  const chosen = axes.map((_, at) => () => curves[shown].at[at]);
  const items = axes.map(({ name, title, values }, at) => {
    if (values.length === 1) return element("span", {}, `${title} ${values[0]}`);
    const select = element("select", { id: name }, ...values.map((value) => element("option", { value }, value)));
    select.value = chosen[at]();
    select.addEventListener("change", onChange);
    chosen[at] = () => select.value;
    return element("label", { htmlFor: name }, `${title} `, select);
  });
  // Errors that are 0 for all curves are not stated.
  byId("axes").append(...items.filter((_, at) => at === 0 || axes[at].values.length > 1 || Number.parseFloat(axes[at].values[0]) > 0));
  return () => curves.find((one) => chosen.every((value, at) => value() === one.at[at]));
}

/** Shows the area fractions over the sensor resolution, at a selected friction and selected errors. */
export function showCurves({ axes, curves, curve: shown }) {
  if (!curves.length) {
    byId("curves").replaceChildren(byId("curves-title"), element("p", {}, "No mesh was labelled."));
    return;
  }
  byId("curve-key").append(
    ...KINDS.map(([kind, meaning, name]) => {
      const swatch = element("i");
      swatch.style.background = `var(${name})`;
      return element("li", {}, swatch, `${kind} ${meaning}${kind === "S" ? ", band: middle half of the meshes" : ""}`);
    }),
  );
  const chart = byId("chart");
  chart.setAttribute("role", "img");
  chart.setAttribute("aria-label", "Median area fractions of S, M and U over the sensor resolution; the values are in the table below");
  let plot = null;
  const draw = () => {
    const curve = selected();
    plot?.destroy();
    const hint = "Move the pointer over the chart to read values.";
    const move = (number) => {
      byId("readout").textContent = number === null ? hint : readoutAt(curve, number);
    };
    plot = new uPlot(options(chart.clientWidth, curve, move), plotted(curve), chart);
    move(null);
    byId("unsearched").textContent = unsearchedNote(curve);
    showValues(curve);
  };
  const selected = showAxes(axes, curves, shown, draw);
  draw();
  new ResizeObserver(() => plot.setSize({ width: chart.clientWidth, height: HEIGHT })).observe(chart);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
}
