import { byId, element } from "../shared/dom.js";
import { degrees, objectAddress } from "../shared/words.js";

const FIRST = 8;

function link(row) {
  return row.stem
    ? element("a", { href: objectAddress(row.stem) }, row.name)
    : element("span", {}, row.name);
}

function list(title, note, rows, told, more) {
  const section = element("section", { className: "card" }, element("h2", {}, title));
  section.append(element("p", { className: "quiet" }, note));
  if (!rows.length) {
    section.append(element("p", {}, "None."));
    return section;
  }
  const items = rows.slice(0, FIRST).map((row) =>
    element("li", {}, link(row), element("span", { className: "quiet" }, told(row))));
  section.append(element("ol", { className: "meshes" }, ...items));
  if (rows.length > FIRST) {
    const words = `Show all ${rows.length.toLocaleString("en")} in the table`;
    section.append(element("button", { type: "button", onclick: more }, words));
  }
  return section;
}

/** The objects that a reader looks for first. */
export function showLists(rows, filters, table) {
  const labelled = rows.filter((row) => row.outcome === "labelled" && row.resolution80 !== null);
  const finest = labelled
    .filter((row) => row.resolution80 > 0)
    .sort((a, b) => a.resolution80 - b.resolution80);
  const hopeless = labelled.filter((row) => row.resolution80 === 0);
  const failed = rows.filter((row) => row.outcome !== "labelled");
  byId("lists").append(
    list("Need the finest sensor", "Resolution α below which 80 % of the surface is S.", finest,
      (row) => ` ${degrees(row.resolution80)}`,
      () => {
        filters.only("labelled", (row) => row.resolution80 > 0);
        table.setSort("resolution80", "asc");
      }),
    list("No sensor helps", "Less than 80 % of the surface is S however fine the sensor.", hopeless,
      () => "", () => filters.only("labelled", (row) => row.resolution80 === 0)),
    list("Not labelled", "Refused: not until the mesh or the settings change. Lost: the next run tries again.",
      failed, (row) => ` ${row.outcome}: ${row.error}`, () => filters.only("refused or lost")),
  );
}
