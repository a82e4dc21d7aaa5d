import { escaped } from "../shared/formatting.js";

const FORMAT = 2;
const KINDS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array };

/** Loads the script of one object; unlike fetch, this works for pages opened as files. */
export function loadObject(stem) {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    let called = null;
    globalThis.grasp3dObject = (...data) => {
      called = data;
    };
    script.onload = () => {
      script.remove();
      if (!called) reject(new Error("The file of this object contains no data."));
      else decoded(...called).then(resolve, reject);
    };
    script.onerror = () => {
      script.remove();
      reject(new Error("The file of this object is missing."));
    };
    script.src = `objects/${escaped(stem)}.js`;
    document.head.append(script);
  });
}

async function decoded(header, data) {
  if (header.format !== FORMAT) {
    throw new Error("The file of this object was written by another version; run the batch again.");
  }
  const bytes = await inflated(data);
  const object = { ...header };
  let start = 0;
  for (const [name, kind, count] of header.arrays) {
    const Kind = KINDS[kind];
    const end = start + count * Kind.BYTES_PER_ELEMENT;
    object[name] = new Kind(bytes.slice(start, end));
    start = end;
  }
  for (const name of ["frictionError", "normalError", "locationError"]) object[name] ??= 0;
  object.best ??= object.worst;
  // Critical angles over the true contact locations too, which the labels follow from.
  object.locatedBest ??= object.locatedWorst ?? object.best;
  object.locatedWorst ??= object.worst;
  object.points = points(object, object.positions);
  object.others = points(object, object.partners);
  object.count = object.worst.length;
  return object;
}

async function inflated(data) {
  const packed = Uint8Array.from(atob(data), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

/** Positions in the mesh's unit and frame. */
function points({ low, step }, quantised) {
  return Float64Array.from(quantised, (value, number) => low[number % 3] + step[number % 3] * value);
}

/** Contact points of a vertex's best grasp, the vertex first; none where it has no grasp. */
export function graspAt(object, vertex) {
  if (!Number.isFinite(object.opening[vertex])) return [];
  const first = [...object.points.subarray(3 * vertex, 3 * vertex + 3)];
  const width = 3 * (object.fingers - 1);
  const others = object.others.subarray(width * vertex, width * (vertex + 1));
  const rest = Array.from({ length: object.fingers - 1 }, (_, finger) => [
    ...others.subarray(3 * finger, 3 * finger + 3),
  ]);
  return [first, ...rest];
}
