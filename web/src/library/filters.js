import { byId, element } from "../shared/dom.js";
import { plural } from "../shared/formatting.js";

const FILTER_DELAY = 120; // milliseconds after the last key

const RANGES = [
  ["Distinct S grasps", "", (row) => row.grasps],
  ["α to spare", "°", (row) => row.spare],
  ["S", "%", (row) => scaled(row.stable, 100)],
  ["U", "%", (row) => scaled(row.noGrasp, 100)],
  ["β* median", "°", (row) => row.angle],
  ["α for 80 %", "°", (row) => row.resolution80],
  ["ε median", "", (row) => row.epsilon],
  ["Size", "mesh unit", (row) => row.size],
  ["Vertices", "", (row) => row.vertices],
  ["Seconds", "", (row) => row.seconds],
];

const LOAD_RANGES = [
  ["Payload", "kg", (row) => row.payload],
  ["Held", "%", (row) => scaled(row.held, 100)],
  ["Grip force", "N", (row) => row.forceNeeded],
];

function scaled(value, factor) {
  return value === null ? null : factor * value;
}

function rangeInput(name, unit, end) {
  return element("input", {
    type: "number",
    step: "any",
    placeholder: end,
    "aria-label": `${name}, ${end}${unit ? ` [${unit}]` : ""}`,
  });
}

/** Limits of one value: inputs, and a test of a row. */
function range([name, unit, value]) {
  const least = rangeInput(name, unit, "min");
  const most = rangeInput(name, unit, "max");
  const title = unit ? `${name} [${unit}]` : name;
  const passes = (row) => {
    if (least.value === "" && most.value === "") return true;
    const number = value(row);
    if (number === null) return false;
    return !(
      (least.value !== "" && number < Number(least.value)) ||
      (most.value !== "" && number > Number(most.value))
    );
  };
  const group = element("fieldset", {}, element("legend", {}, title), least, most);
  return { group, passes, clear: () => { least.value = most.value = ""; } };
}

function outcomeSelect() {
  const options = ["all", "labelled", "refused", "lost", "refused or lost"];
  return element("select", { id: "outcome" }, ...options.map((name) => element("option", {}, name)));
}

/** Shows the filters; returns an object with which other parts of the page set them. */
export function showFilters(table, rows) {
  const form = byId("filters");
  const text = element("input", { type: "search", id: "search", placeholder: "part of a name" });
  const outcome = outcomeSelect();
  const loaded = rows.some((row) => row.task);
  const ranges = [...RANGES, ...(loaded ? LOAD_RANGES : [])].map(range);
  const clear = element("button", { type: "reset" }, "Clear");
  form.append(
    element("label", { htmlFor: "search" }, "Name ", text),
    element("label", { htmlFor: "outcome" }, "Outcome ", outcome),
    clear,
    element("details", { className: "more" }, element("summary", {}, "Limits"),
      element("div", { className: "row" }, ...ranges.map((one) => one.group))),
  );
  let extra = () => true;
  const passes = (row) =>
    row.name.toLowerCase().includes(text.value.trim().toLowerCase()) &&
    (outcome.value === "all" || outcome.value.split(" or ").includes(row.outcome)) &&
    ranges.every((one) => one.passes(row)) &&
    extra(row);

  let ready = false;
  const apply = () => {
    if (ready) table.setFilter(passes);
    const count = rows.filter(passes).length;
    byId("shown").textContent =
      count === rows.length
        ? plural(count, "mesh", "meshes")
        : `${count.toLocaleString("en")} of ${plural(rows.length, "mesh", "meshes")}`;
  };
  let timer = 0;
  const applySoon = () => {
    clearTimeout(timer);
    timer = setTimeout(apply, FILTER_DELAY);
  };
  form.addEventListener("input", applySoon);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => {
    extra = () => true;
    applySoon();
  });
  table.on("tableBuilt", () => {
    ready = true;
    apply();
    document.documentElement.dataset.ready = "yes";
  });
  return {
    /** Shows the meshes of an outcome for which `test` is true, with all other filters cleared. */
    only(name, test = () => true) {
      text.value = "";
      outcome.value = name;
      for (const one of ranges) one.clear();
      extra = test;
      apply();
      byId("meshes-title").scrollIntoView({ block: "start" });
    },
  };
}
