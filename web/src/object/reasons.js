import { degrees } from "../shared/formatting.js";
import { M, S, U, UNSEARCHED } from "./thresholds.js";

const angle = (radians) => degrees((180 / Math.PI) * radians);

/** One sentence with the reason why a vertex is S, M, U or not searched. */
export function reason(object, vertex, label, limits) {
  const [worst, best] = [object.locatedWorst[vertex], object.locatedBest[vertex]];
  const [low, high] = limits.simple
    ? [`β − α/2 = ${angle(limits.stable)}`, `β + α/2 = ${angle(limits.reach)}`]
    : [`smallest β − tilt = ${angle(limits.stable)}`, `largest β + tilt = ${angle(limits.reach)}`];
  const where = worst === object.worst[vertex] ? "" : " at the worst contact locations";
  const all = limits.simple ? "normals within the sensor resolution" : "normals within the tilt, and every friction,";
  const located = object.locationError || object.perFinger ? ", at all true contact locations" : "";
  if (label === S) {
    return `β* ${angle(worst)}${where} is below ${low}: the grasp is stable for all true ${all.replace(/,$/, "")}${located}.`;
  }
  if (label === UNSEARCHED) {
    return `Grasps were searched with β* up to ${angle(object.cone)}, and none of them is stable; ${high} exceeds this, so M and U cannot be distinguished.`;
  }
  if (label === U) {
    if (best === Infinity) return `No grasp was found: ${object.causes[object.cause[vertex]]}.`;
    const there = best === object.best[vertex] ? "" : " at the best contact locations";
    return `β* ${angle(best)}${there} is at least ${high}: no grasp was found that is stable for any true ${all.replace(", and every friction,", " and any friction")}.`;
  }
  if (limits.unstable === Infinity && best >= limits.reach) {
    return `${high} is at least 90°, where grasps of three fingers and more are never surely unstable, and this one is not surely stable.`;
  }
  if (object.worst[vertex] === object.best[vertex] && worst !== best) {
    return `β* is ${angle(worst)} at the worst contact locations and ${angle(best)} at the best: neither surely stable (below ${low}) nor surely unstable (from ${high} on).`;
  }
  if (worst !== best) {
    return `On a sharp edge β* is ${worst === Infinity ? "unbounded" : angle(worst)} for the worst normals and ${angle(best)} for the best: neither surely stable (below ${low}) nor surely unstable (from ${high} on).`;
  }
  return `β* ${angle(worst)} lies between ${low} and ${high}: neither surely stable nor surely unstable.`;
}

export const MEANING = {
  [S]: ["S", "surely stable", "s"],
  [M]: ["M", "ambiguous", "m"],
  [U]: ["U", "no grasp found", "u"],
  [UNSEARCHED]: ["–", "not searched", "unknown"],
};
