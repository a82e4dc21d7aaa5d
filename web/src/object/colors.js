import { M, S, U, UNSEARCHED } from "./thresholds.js";

const GREY = [0x9a, 0xa0, 0xa6];
const LABELS = { [U]: [0xd5, 0x5e, 0x00], [M]: [0xf0, 0xe4, 0x42], [S]: [0x00, 0x9e, 0x73], [UNSEARCHED]: GREY };
const DEGREE = Math.PI / 180;

// Cividis, from low to high: safe for colour-blind readers.
const RAMP = [
  [0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115],
  [138, 134, 120], [165, 156, 116], [195, 179, 105], [225, 204, 85], [254, 232, 56],
];

export const rampCss = `linear-gradient(90deg, ${RAMP.map((stop) => `rgb(${stop})`).join(", ")})`;

/** Colour of a fraction from 0 to 1. */
function ramp(fraction) {
  const at = Math.min(1, Math.max(0, fraction)) * (RAMP.length - 1);
  const lower = Math.min(Math.floor(at), RAMP.length - 2);
  return RAMP[lower].map((value, channel) => value + (at - lower) * (RAMP[lower + 1][channel] - value));
}

function largest(values) {
  let found = 0;
  for (const value of values) if (Number.isFinite(value) && value > found) found = value;
  return found;
}

/** Quantities that the surface can be coloured by; values are nan where there is no grasp. */
export const QUANTITIES = {
  labels: { title: "S, M, U" },
  angle: {
    title: "β*: critical friction angle",
    unit: "°",
    value: (object, vertex) => object.worst[vertex] / DEGREE,
    most: (object) => object.cone / DEGREE,
  },
  resolution: {
    title: "α*: coarsest resolution for S",
    unit: "°",
    value: (object, vertex, limits) => Math.max(0, limits.sensor - 2 * object.locatedWorst[vertex]) / DEGREE,
    most: (object, limits) => Math.max(0, limits.sensor) / DEGREE,
  },
  spareAngle: {
    title: "margin: friction angle to spare in S",
    unit: "°",
    value: (object, vertex, limits) => Math.max(0, limits.stable - object.locatedWorst[vertex]) / DEGREE,
    most: (object, limits) => Math.max(0, limits.stable) / DEGREE,
  },
  epsilon: {
    title: "ε: Ferrari–Canny quality",
    unit: "",
    value: (object, vertex) => object.epsilon[vertex],
    most: (object) => largest(object.epsilon),
  },
  payload: {
    title: "payload at the force at hand",
    unit: " kg",
    array: "payload",
    value: (object, vertex) => object.payload[vertex],
    most: (object) => largest(object.payload),
  },
  margin: {
    title: "approach margin of the gripper",
    unit: "°",
    array: "margin",
    unknown: "not reached",
    value: (object, vertex) => object.margin[vertex] / DEGREE,
    most: (object) => largest(object.margin) / DEGREE,
  },
};

/** Red, green and blue of every vertex, 0 to 255. */
export function vertexColors(object, quantity, labels, limits) {
  const colors = new Uint8Array(3 * object.count);
  const { value, most } = QUANTITIES[quantity];
  const full = value ? most(object, limits) || 1 : 1;
  for (let vertex = 0; vertex < object.count; vertex++) {
    let color = LABELS[labels[vertex]];
    if (value) {
      const number = value(object, vertex, limits);
      const known = Number.isFinite(number) && Number.isFinite(object.worst[vertex]);
      color = known ? ramp(number / full) : GREY;
    }
    colors.set(color, 3 * vertex);
  }
  return colors;
}
