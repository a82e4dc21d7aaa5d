import "tabulator-tables/dist/css/tabulator_simple.css";
import "uplot/dist/uPlot.min.css";
import "../shared/page.css";
import "./library.css";
import { byId, element } from "../shared/dom.js";
import { plural } from "../shared/words.js";
import { showCurves } from "./curves.js";
import { showFilters } from "./filters.js";
import { showLegend } from "./legend.js";
import { showLists } from "./lists.js";
import { makeTable } from "./table.js";

const OUTCOMES = ["labelled", "refused", "lost"];

/** Rows as objects, with the names of the columns. */
function unpacked({ columns, rows }) {
  return rows.map((row, id) =>
    Object.fromEntries([["id", id], ...columns.map((name, number) => [name, row[number]])]),
  );
}

function showHead(data, rows) {
  const said = data.settings.slice(0, 3).map(([name, words]) => `${name} ${words}`);
  byId("said").textContent = `${said.join(" · ")}.`;
  byId("counts").append(
    ...OUTCOMES.map((outcome) => {
      const count = rows.filter((row) => row.outcome === outcome).length;
      return element("span", {}, element("b", {}, count.toLocaleString("en")), ` ${outcome}`);
    }),
  );
  byId("settings").append(
    ...data.settings.flatMap(([name, words]) => [
      element("dt", {}, name),
      element("dd", {}, words),
    ]),
  );
  byId("foot").textContent =
    `${plural(rows.length, "mesh", "meshes")} · made ${data.made} by grasp3d ${data.version}`;
}

const data = JSON.parse(byId("data").textContent);
const rows = unpacked(data);
showHead(data, rows);
showLegend(data);
showCurves(data);
const table = makeTable(rows);
const filters = showFilters(table, rows);
showLists(rows, filters, table);
