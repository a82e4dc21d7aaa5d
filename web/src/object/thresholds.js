// Labels S, M and U from thresholds on the critical friction angle, as in grasp3d.stability.

export const U = 0;
export const M = 1;
export const S = 2;
export const UNSEARCHED = 3;

const ROUNDING = 1e-9;
const RIGHT_ANGLE = Math.PI / 2;

/** Names of what the thresholds depend on. */
export const SETTINGS = ["friction", "resolution", "frictionError", "normalError"];

/** Friction angles at the smallest and at the largest friction [rad]. */
function frictionAngles(object, { friction, frictionError }) {
  if (!object.perFinger) return [Math.atan(Math.max(0, friction - frictionError)), Math.atan(friction + frictionError)];
  // Fingers differ: their friction is that of the labels.
  const { stable, widest } = object.limits;
  const labelled = object.resolution / 2 + object.normalError;
  return [stable + labelled, widest - labelled];
}

/** The thresholds at some settings [rad], and whether they exceed the searched cone. */
export function thresholds(object, settings) {
  const tilt = settings.resolution / 2 + settings.normalError;
  const [least, most] = frictionAngles(object, settings);
  const reach = most + tilt;
  const neverUnstable = object.fingers > 2 && reach >= RIGHT_ANGLE;
  return {
    beta: Math.atan(settings.friction),
    least,
    tilt,
    simple: !object.perFinger && settings.frictionError === 0 && settings.normalError === 0,
    // The coarsest sensor resolution for a critical angle of 0: alpha* = sensor - 2 beta*.
    sensor: 2 * (least - settings.normalError),
    stable: least - tilt,
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
  const [worst, best] = [object.locatedWorst[vertex], object.locatedBest[vertex]];
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
