import {
  AccessorModule,
  ExportModule,
  FilterModule,
  FormatModule,
  FrozenColumnsModule,
  PrintModule,
  ResizeColumnsModule,
  SortModule,
  Tabulator,
} from "tabulator-tables";
import { byId, element } from "../shared/dom.js";
import { degrees, digits, length, objectAddress, percent, plural } from "../shared/formatting.js";
import { IN_METRES } from "./units.js";

Tabulator.registerModule([
  AccessorModule,
  ExportModule,
  FilterModule,
  FormatModule,
  FrozenColumnsModule,
  PrintModule,
  ResizeColumnsModule,
  SortModule,
]);

const ROW_HEIGHT = 66;
const HEAD_HEIGHT = 70;
const NARROW = 700; // of a window that shows picture, name and verdict, if these are narrow

/** Sorts by a number; rows without one are last in both directions. */
function byNumber(valueOf) {
  return (a, b, rowA, rowB, column, direction) => {
    const [x, y] = [valueOf(rowA.getData()), valueOf(rowB.getData())];
    if (x === null || y === null) {
      const last = (x === null) - (y === null);
      return direction === "asc" ? last : -last;
    }
    return x - y;
  };
}

/** An element with text: the table would interpret a string as markup. */
function text(content) {
  return element("span", {}, content);
}

const order = new Intl.Collator("en", { numeric: true });

/** Header with its title as a button, so that the keyboard sorts as well. */
function headed(title, meaning) {
  return {
    title,
    titleFormatter: () => element("button", { type: "button", className: "head", title: meaning }, title),
    titlePrint: title,
  };
}

function numeric(field, title, meaning, format, width = 80) {
  return {
    ...headed(title, meaning),
    field,
    width,
    hozAlign: "right",
    sorter: byNumber((row) => row[field]),
    headerSortStartingDir: "desc",
    formatter: (cell) => text(format(cell.getData())),
  };
}

function resolution(percentage) {
  const field = `resolution${percentage}`;
  const meaning = `Coarsest sensor resolution below which ${percentage} % of the surface is S; none: no resolution is fine enough`;
  return numeric(field, `α for ${percentage} %`, meaning, (row) => {
    if (row[field] === null) return "";
    return row[field] > 0 ? degrees(row[field]) : "none";
  }, 68);
}

function picture(cell) {
  const { thumbnail } = cell.getData();
  if (!thumbnail) return "";
  const src = thumbnail.split("/").map(encodeURIComponent).join("/");
  return element("img", { src, loading: "lazy", decoding: "async", width: 80, height: 60, alt: "" });
}

function nameCell(cell) {
  const { name, stem, outcome } = cell.getData();
  const shown = stem
    ? element("a", { href: objectAddress(stem) }, name)
    : element("span", {}, name);
  const content = element("div", { title: name }, element("div", { className: "name" }, shown));
  if (outcome !== "labelled") content.append(element("b", { className: "outcome" }, outcome));
  return content;
}

/** Warnings of a mesh, or why it was not labelled. */
function message(row) {
  return row.error || row.warnings;
}

function bar(cell) {
  const { stable, ambiguous, noGrasp, causes } = cell.getData();
  if (stable === null) return "";
  const parts = { s: stable, m: ambiguous, u: noGrasp };
  const spans = Object.entries(parts).map(([kind, fraction]) => {
    const span = element("span", { className: kind });
    span.style.width = `${100 * fraction}%`;
    return span;
  });
  const values = `S ${percent(stable)} · M ${percent(ambiguous)} · U ${percent(noGrasp)}`;
  return element("div", { className: "fractions", title: causes ? `U: ${causes}` : "" },
    element("div", { className: "bar", "aria-hidden": "true" }, ...spans),
    element("div", {}, values));
}

/** The verdict on an object, with its reason below. */
function verdict(cell) {
  const { verdict: word, verdictText } = cell.getData();
  if (!word) return "";
  const detail = verdictText.slice(verdictText.indexOf(":") + 1).trim();
  return element("div", { className: "verdict", title: verdictText },
    element("b", {}, word), element("div", { className: "quiet" }, detail));
}

/** The largest payload, or the force that is needed, and the fraction of the surface that holds the load. */
function load(cell) {
  const { payload, forceNeeded, held, task, verdictText } = cell.getData();
  if (!task) return "";
  const main = payload !== null ? `${digits(payload)} kg` : forceNeeded === null ? "none" : `${digits(forceNeeded)} N`;
  const detail = held === null ? "" : `${percent(held)} held`;
  return element("div", { className: "verdict", title: verdictText },
    element("b", {}, main), element("div", { className: "quiet" }, detail));
}

/** The column of a load: of payloads, or of the forces that are needed where none is at hand. */
function loadColumn(rows) {
  const payloads = rows.some((row) => row.payload !== null);
  const [field, title] = payloads ? ["payload", "Payload"] : ["forceNeeded", "Grip force"];
  const meaning = payloads
    ? "Largest mass that a grasp surely holds with the force at hand, and the fraction of the surface whose grasps surely hold the load"
    : "Smallest force of each finger that surely holds the load, or 1 kg where no mass is given";
  return {
    ...numeric(field, title, meaning, () => "", 90),
    hozAlign: "left",
    formatter: load,
    formatterPrint: load,
  };
}

/** The margin, where more than the sensor's normals is uncertain; otherwise the number of vertices. */
function marginColumn() {
  const meaning = "Median margin over the surface: by how much the friction angle exceeds what β* and all uncertainties need; S is where it is above 0";
  return numeric("spareAngle", "Margin median", meaning, (row) => {
    if (row.outcome !== "labelled") return "";
    return row.spareAngle === null ? "no grasp" : degrees(row.spareAngle);
  }, 90);
}

const VERDICTS = ["not", "perhaps", "surely"];

function columns(rows, uncertain) {
  const loaded = rows.some((row) => row.task);
  const frozen = window.innerWidth > NARROW;
  const [pictureWidth, nameWidth] = frozen ? [98, 144] : [70, 92];
  return [
    { title: "", field: "thumbnail", width: pictureWidth, headerSort: false, formatter: picture, frozen, print: false },
    {
      ...headed("Name", "Path of the mesh; the link opens its page"),
      field: "name",
      width: nameWidth,
      frozen,
      formatter: nameCell,
      sorter: (a, b) => order.compare(a, b),
      formatterPrint: (cell) => text(cell.getValue()),
    },
    {
      ...numeric("verdict", "Verdict", "Whether the object can be held reliably; sorted by the word, then by the resolution to spare", () => "", 164),
      hozAlign: "left",
      formatter: verdict,
      sorter: byNumber((row) => (row.verdict ? 1000 * VERDICTS.indexOf(row.verdict) + (row.spare ?? 0) : null)),
      formatterPrint: (cell) => text(cell.getData().verdictText),
    },
    { ...numeric("stable", "S / M / U", "Area fractions of S, M and U", () => "", 168), hozAlign: "left", formatter: bar },
    numeric("angle", "β* median", "Median critical friction angle over the surface, weighted by area", (row) => {
      if (row.outcome !== "labelled") return "";
      return row.angle === null ? "no grasp" : degrees(row.angle);
    }, 84),
    resolution(80),
    numeric("epsilon", "ε median", "Median epsilon over the surface, weighted by area", (row) =>
      row.epsilon === null ? "" : digits(row.epsilon), 84),
    {
      ...numeric("size", "Size", "Diameter of the surface's bounding sphere; sorted in metres", (row) =>
        row.size === null ? "" : length(row.size, row.unit), 80),
      sorter: byNumber((row) => (row.size === null ? null : row.size * (IN_METRES[row.unit] ?? 1))),
    },
    uncertain
      ? marginColumn()
      : numeric("vertices", "Vertices", "Vertices of the refined surface", (row) =>
        row.vertices === null ? "" : row.vertices.toLocaleString("en"), 90),
    loaded
      ? loadColumn(rows)
      : numeric("seconds", "Seconds", "Total time for the mesh", (row) => digits(row.seconds), 92),
    {
      ...headed("Warnings", "Warnings about the labels, or why there are none"),
      field: "warnings",
      minWidth: 120,
      maxInitialWidth: 120, // stretched to what is left, also if its texts are long
      sorter: (a, b, rowA, rowB) => order.compare(message(rowA.getData()), message(rowB.getData())),
      formatter: (cell) => {
        const content = message(cell.getData());
        return element("div", { className: "warnings", title: content }, content);
      },
      formatterPrint: (cell) => text(message(cell.getData())),
    },
  ];
}

/** The table of all meshes; only the visible rows are in the page. */
export function makeTable(rows, uncertain) {
  const whole = (Math.max(1, rows.length) * ROW_HEIGHT) + HEAD_HEIGHT;
  return new Tabulator(byId("table"), {
    data: rows,
    columns: columns(rows, uncertain),
    layout: "fitDataStretch",
    height: Math.min(whole, Math.max(360, Math.round(0.8 * window.innerHeight))),
    rowHeight: ROW_HEIGHT,
    columnHeaderSortMulti: false,
    placeholder: "No mesh matches the filters",
    printAsHtml: true,
    printStyled: false,
    printRowRange: "active",
  });
}
