import { degrees as told } from "../shared/words.js";
import { M, S, U, UNSEARCHED } from "./rule.js";

const REASONS = {
  1: "no place for the other fingers was found within the cone that was searched",
  2: "every place for the other fingers is outside the limits of openings or distances",
};

const angle = (radians) => told((180 / Math.PI) * radians);

/** One sentence: why a vertex is S, M, U or not searched. */
export function reason(object, vertex, label, limits) {
  const [worst, best] = [object.worst[vertex], object.best[vertex]];
  const low = `β − α/2 = ${angle(limits.stable)}`;
  const high = `β + α/2 = ${angle(limits.reach)}`;
  if (label === S) {
    return `β* ${angle(worst)} is below ${low}: the grasp holds whatever the true normals within the sensor's resolution.`;
  }
  if (label === UNSEARCHED) {
    return `Grasps were searched with β* up to ${angle(object.cone)}, and none of them will do; ${high} goes beyond, so M and U cannot be told apart.`;
  }
  if (label === U) {
    if (best === Infinity) return `No grasp was found: ${REASONS[object.reason[vertex]] ?? "none closes"}.`;
    return `β* ${angle(best)} reaches ${high}: no grasp was found that could hold.`;
  }
  if (limits.unstable === Infinity && best >= limits.reach) {
    return `${high} is at least 90°, where three fingers and more are never surely unstable: the sensor cannot tell.`;
  }
  if (worst !== best) {
    return `On a crease β* is ${worst === Infinity ? "not bounded" : angle(worst)} over the worst normals and ${angle(best)} over the best, between ${low} and ${high} not sure either way: the sensor cannot tell.`;
  }
  return `β* ${angle(worst)} lies between ${low} and ${high}: the sensor cannot tell.`;
}

export const MEANING = {
  [S]: ["S", "surely stable", "s"],
  [M]: ["M", "sensor cannot tell", "m"],
  [U]: ["U", "no grasp found", "u"],
  [UNSEARCHED]: ["–", "not searched", "unknown"],
};
