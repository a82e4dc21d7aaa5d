import { byId, element } from "../shared/dom.js";
import { degrees, objectAddress, plural } from "../shared/formatting.js";

const SHOWN = 8;

function link(row) {
  return row.stem
    ? element("a", { href: objectAddress(row.stem) }, row.name)
    : element("span", {}, row.name);
}

function list(title, note, rows, detail, showAll) {
  const section = element("section", { className: "card" }, element("h2", {}, title));
  section.append(element("p", { className: "quiet" }, note));
  if (!rows.length) {
    section.append(element("p", {}, "None."));
    return section;
  }
  const items = rows.slice(0, SHOWN).map((row) =>
    element("li", {}, link(row), element("span", { className: "quiet" }, detail(row))));
  section.append(element("ol", { className: "meshes" }, ...items));
  if (rows.length > SHOWN) {
    const label = `Show all ${rows.length.toLocaleString("en")} in the table`;
    section.append(element("button", { type: "button", onclick: showAll }, label));
  }
  return section;
}

/** Shows lists of meshes: not held by any grasp, finest sensor required, never mostly S, not labelled. */
export function showLists(rows, filters, table) {
  const judged = rows.filter((row) => row.verdict);
  const unheld = judged
    .filter((row) => row.verdict !== "surely")
    .sort((a, b) => (a.spare ?? -Infinity) - (b.spare ?? -Infinity));
  const labelled = rows.filter((row) => row.outcome === "labelled" && row.resolution80 !== null);
  const finest = labelled
    .filter((row) => row.resolution80 > 0)
    .sort((a, b) => a.resolution80 - b.resolution80);
  const neverMostlyStable = labelled.filter((row) => row.resolution80 === 0);
  const failed = rows.filter((row) => row.outcome !== "labelled");
  const held = judged.length - unheld.length;
  byId("lists").append(
    list("Not surely held",
      `${held.toLocaleString("en")} of ${plural(judged.length, "object", "objects")} are surely held. The others, why, and what would help:`,
      unheld,
      (row) => ` ${row.verdictText}`,
      () => {
        filters.only("labelled", (row) => row.verdict && row.verdict !== "surely");
        table.setSort("verdict", "asc");
      }),
    list("Finest sensor required", "Sensor resolution α below which 80 % of the surface is S; the most demanding objects first.", finest,
      (row) => ` ${degrees(row.resolution80)}`,
      () => {
        filters.only("labelled", (row) => row.resolution80 > 0);
        table.setSort("resolution80", "asc");
      }),
    list("Less than 80 % of the surface is S with any sensor",
      "At no sensor resolution, however fine, is 80 % of the surface S. The best grasps of such an object may still be S.",
      neverMostlyStable,
      () => "", () => filters.only("labelled", (row) => row.resolution80 === 0)),
    list("Not labelled", "Refused: cannot be labelled unless the mesh or the settings change. Lost: the next run tries again.",
      failed, (row) => ` ${row.outcome}: ${row.error}`, () => filters.only("refused or lost")),
  );
}
