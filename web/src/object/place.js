import { byId, element } from "../shared/dom.js";
import { degrees, digits, length } from "../shared/words.js";
import { graspAt } from "./loading.js";
import { MEANING, reason } from "./reasons.js";

const DEGREE = Math.PI / 180;

function numbers(object, vertex, limits) {
  const { unit } = object;
  const [worst, best] = [object.worst[vertex], object.best[vertex]];
  const place = [...object.points.subarray(3 * vertex, 3 * vertex + 3)].map((one) => digits(one, 4));
  const angle = (value) => (value === Infinity ? "none" : degrees(value / DEGREE));
  const coarsest = 2 * (limits.beta - worst);
  return [
    ["vertex", String(object.numbers?.[vertex] ?? vertex)],
    ["place", `${place.join(", ")}${unit ? ` ${unit}` : ""}`],
    ["β*", worst === best ? angle(worst) : `${angle(worst)} (best normals ${angle(best)})`],
    ["α*", coarsest > 0 ? degrees(coarsest / DEGREE) : "no sensor is fine enough"],
    ["ε", digits(object.epsilon[vertex])],
    ["opening", Number.isFinite(object.opening[vertex]) ? length(object.opening[vertex], unit) : "no grasp"],
  ];
}

/** Shows a vertex and why it is what it is; returns the contacts of its grasp. */
export function showPlace(object, vertex, label, limits) {
  const target = byId("place");
  if (vertex === null) {
    target.replaceChildren(element("p", { className: "quiet" }, "Click on the surface."));
    delete target.dataset.vertex;
    return [];
  }
  const [letter, words, kind] = MEANING[label];
  target.dataset.vertex = object.numbers?.[vertex] ?? vertex;
  target.replaceChildren(
    element("p", {}, element("i", { className: `dot ${kind}` }), element("b", {}, `${letter} `), words),
    element("p", {}, reason(object, vertex, label, limits)),
    element("dl", { className: "numbers" }, ...numbers(object, vertex, limits).flatMap(([name, told]) => [
      element("dt", {}, name), element("dd", {}, told),
    ])),
  );
  const contacts = graspAt(object, vertex);
  return contacts.length ? contacts : [[...object.points.subarray(3 * vertex, 3 * vertex + 3)]];
}
