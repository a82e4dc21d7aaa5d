import "tabulator-tables/dist/css/tabulator_simple.css";
import "uplot/dist/uPlot.min.css";
import "../shared/page.css";
import "./library.css";
import { byId, element } from "../shared/dom.js";
import { plural } from "../shared/formatting.js";
import { showCurves } from "./curves.js";
import { showFilters } from "./filters.js";
import { showLegend } from "./legend.js";
import { showLists } from "./lists.js";
import { makeTable } from "./table.js";

const OUTCOMES = ["labelled", "refused", "lost"];

/** Rows as objects, with the names of the columns as keys. */
function unpacked({ columns, rows }) {
  return rows.map((row, id) =>
    Object.fromEntries([["id", id], ...columns.map((name, number) => [name, row[number]])]),
  );
}

function showHeader(data, rows) {
  byId("summary").textContent = data.summary.join(" · ");
  byId("certainty").textContent = data.certainty && `Labels are safe: ${data.certainty}.`;
  byId("counts").append(
    ...OUTCOMES.map((outcome) => {
      const count = rows.filter((row) => row.outcome === outcome).length;
      return element("span", {}, element("b", {}, count.toLocaleString("en")), ` ${outcome}`);
    }),
  );
  byId("settings").append(
    ...data.settings.flatMap(([name, value]) => [
      element("dt", {}, name),
      element("dd", {}, value),
    ]),
  );
  byId("foot").textContent =
    `${plural(rows.length, "mesh", "meshes")} · written ${data.made} by grasp3d ${data.version}`;
}

const data = JSON.parse(byId("data").textContent);
const rows = unpacked(data);
showHeader(data, rows);
showLegend(data, rows);
showCurves(data);
const table = makeTable(rows, data.uncertain);
const filters = showFilters(table, rows);
showLists(rows, filters, table);
