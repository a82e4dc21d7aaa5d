import { degrees } from "../shared/formatting.js";
import { M, S, U, UNSEARCHED } from "./thresholds.js";

const REASONS = {
  1: "no contact points for the other fingers were found within the searched cone",
  2: "all contact points for the other fingers violate the opening or distance limits",
  5: "there are grasps here, but the gripper reaches none of those that were tested",
};

const angle = (radians) => degrees((180 / Math.PI) * radians);

/** One sentence with the reason why a vertex is S, M, U or not searched. */
export function reason(object, vertex, label, limits) {
  const [worst, best] = [object.worst[vertex], object.best[vertex]];
  const low = `β − α/2 = ${angle(limits.stable)}`;
  const high = `β + α/2 = ${angle(limits.reach)}`;
  if (label === S) {
    return `β* ${angle(worst)} is below ${low}: the grasp is stable for all true normals within the sensor resolution.`;
  }
  if (label === UNSEARCHED) {
    return `Grasps were searched with β* up to ${angle(object.cone)}, and none of them is stable; ${high} exceeds this, so M and U cannot be distinguished.`;
  }
  if (label === U) {
    if (best === Infinity) return `No grasp was found: ${REASONS[object.reason[vertex]] ?? "none is force-closed"}.`;
    return `β* ${angle(best)} is at least ${high}: no grasp was found that is stable for any true normals within the sensor resolution.`;
  }
  if (limits.unstable === Infinity && best >= limits.reach) {
    return `${high} is at least 90°, where grasps of three fingers and more are never surely unstable, and this one is not surely stable.`;
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
