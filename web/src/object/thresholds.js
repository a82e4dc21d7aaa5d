// Labels S, M and U from thresholds on the critical friction angle, as in grasp3d.stability.

export const U = 0;
export const M = 1;
export const S = 2;
export const UNSEARCHED = 3;

const ROUNDING = 1e-9;
const RIGHT_ANGLE = Math.PI / 2;

/** The thresholds at a friction and a resolution [rad], and whether they exceed the searched cone. */
export function thresholds(object, friction, resolution) {
  const beta = Math.atan(friction);
  const reach = beta + resolution / 2;
  const neverUnstable = object.fingers > 2 && reach >= RIGHT_ANGLE;
  return {
    beta,
    stable: beta - resolution / 2,
    reach,
    unstable: neverUnstable ? Infinity : reach,
    beyond: Math.min(reach, RIGHT_ANGLE) > object.cone + ROUNDING,
  };
}

/**
 * Label of one vertex. Beyond the searched cone a better grasp may have been missed: vertices that
 * would be U, and M where such a grasp could be S, are unsearched.
 */
export function labelOf(object, vertex, limits) {
  const [worst, best] = [object.worst[vertex], object.best[vertex]];
  const searched = object.cone + ROUNDING;
  if (worst < limits.stable) return S;
  if (best >= limits.unstable) return limits.beyond ? UNSEARCHED : U;
  return limits.stable > searched && worst > searched ? UNSEARCHED : M;
}

export function labelsAt(object, limits) {
  return Uint8Array.from({ length: object.count }, (_, vertex) => labelOf(object, vertex, limits));
}

/** Area fractions by label. */
export function areaFractions(object, labels) {
  const sums = [0, 0, 0, 0];
  for (let vertex = 0; vertex < labels.length; vertex++) sums[labels[vertex]] += object.weights[vertex];
  const total = sums.reduce((sum, one) => sum + one);
  return sums.map((sum) => sum / total);
}
