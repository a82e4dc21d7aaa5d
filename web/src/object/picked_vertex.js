import { byId, element } from "../shared/dom.js";
import { degrees, digits, length } from "../shared/formatting.js";
import { graspAt } from "./loading.js";
import { MEANING, reason } from "./reasons.js";

const DEGREE = Math.PI / 180;

function values(object, vertex, limits) {
  const { unit } = object;
  const [worst, best] = [object.worst[vertex], object.best[vertex]];
  const position = [...object.points.subarray(3 * vertex, 3 * vertex + 3)].map((one) => digits(one, 4));
  const angle = (value) => (value === Infinity ? "none" : degrees(value / DEGREE));
  const located = object.locatedWorst[vertex];
  const coarsest = limits.sensor - 2 * located;
  return [
    ["vertex", String(object.numbers?.[vertex] ?? vertex)],
    ["position", `${position.join(", ")}${unit ? ` ${unit}` : ""}`],
    ["β*", worst === best ? angle(worst) : `${angle(worst)} (best normals ${angle(best)})`],
    ["α*", coarsest > 0 ? degrees(coarsest / DEGREE) : "no resolution is fine enough"],
    ["margin", Number.isFinite(located) ? degrees((limits.stable - located) / DEGREE) : "none"],
    ...budget(object, vertex, limits),
    ["ε", digits(object.epsilon[vertex])],
    ["opening", Number.isFinite(object.opening[vertex]) ? length(object.opening[vertex], unit) : "no grasp"],
    ...holding(object, vertex),
    ...(Number.isFinite(object.margin?.[vertex]) ? [["approach margin", `±${degrees(object.margin[vertex] / DEGREE)}`]] : []),
  ];
}

/** How the friction angle is used up, if more than the sensor's normals is uncertain. */
function budget(object, vertex, limits) {
  const [worst, located] = [object.worst[vertex], object.locatedWorst[vertex]];
  if (!Number.isFinite(located) || object.perFinger) return [];
  const parts = { "β*": worst, friction: limits.beta - limits.least, normals: limits.tilt, locations: located - worst };
  if (parts.friction === 0 && parts.locations === 0) return [];
  const shown = Object.entries(parts).filter(([, part]) => part > 1e-6);
  const margin = (limits.stable - located) / DEGREE;
  const texts = shown.map(([name, part]) => `${name} ${degrees(part / DEGREE)}`);
  return [["of β", `${degrees(limits.beta / DEGREE)} = ${texts.join(" + ")} ${margin < 0 ? "−" : "+"} margin ${degrees(Math.abs(margin))}`]];
}

/** Grip force and payload of a vertex's grasp, if there is a load. */
function holding(object, vertex) {
  if (!object.load || Number.isNaN(object.force[vertex])) return [];
  const per = object.load.mass === null ? " for 1 kg" : "";
  const force = object.force[vertex] === Infinity ? "no force is enough" : `${digits(object.force[vertex])} N${per}`;
  return [
    ["grip force", force],
    ...(object.payload ? [["payload", `${digits(object.payload[vertex])} kg`]] : []),
  ];
}

/** Shows a vertex and the reason for its label; returns the contact points of its grasp. */
export function showVertex(object, vertex, label, limits) {
  const target = byId("vertex");
  if (vertex === null) {
    target.replaceChildren(element("p", { className: "quiet" }, "Click on the surface."));
    delete target.dataset.vertex;
    return [];
  }
  const [letter, meaning, kind] = MEANING[label];
  target.dataset.vertex = object.numbers?.[vertex] ?? vertex;
  target.replaceChildren(
    element("p", {}, element("i", { className: `dot ${kind}` }), element("b", {}, `${letter} `), meaning),
    element("p", {}, reason(object, vertex, label, limits)),
    element("dl", { className: "numbers" }, ...values(object, vertex, limits).flatMap(([name, value]) => [
      element("dt", {}, name), element("dd", {}, value),
    ])),
  );
  const contacts = graspAt(object, vertex);
  return contacts.length ? contacts : [[...object.points.subarray(3 * vertex, 3 * vertex + 3)]];
}
