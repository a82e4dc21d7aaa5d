export const UNKNOWN = "–";

/** A number with `count` significant digits, without an exponent where it is short enough. */
export function digits(value, count = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const text = Number(value.toPrecision(count));
  const size = Math.abs(text);
  return size !== 0 && (size < 1e-4 || size >= 1e7) ? text.toExponential() : String(text);
}

export function percent(fraction, decimals = 0) {
  return Number.isFinite(fraction) ? `${(100 * fraction).toFixed(decimals)} %` : UNKNOWN;
}

export function degrees(value, decimals = 1) {
  return Number.isFinite(value) ? `${value.toFixed(decimals)}°` : UNKNOWN;
}

export function length(value, unit) {
  return `${digits(value)}${unit ? ` ${unit}` : ""}`;
}

const METRES = { m: 1, cm: 0.01, mm: 0.001 };

/** A length that is small beside the object: in millimetres if its unit is metric. */
export function smallLength(value, unit) {
  return METRES[unit] ? length(1000 * METRES[unit] * value, "mm") : length(value, unit);
}

/** Address of an object's page: the parts of its path are escaped, the slashes stay. */
export function objectAddress(stem) {
  return `object.html#${escaped(stem)}`;
}

export function escaped(stem) {
  return stem.split("/").map(encodeURIComponent).join("/");
}

export function plural(count, one, many = `${one}s`) {
  return `${count.toLocaleString("en")} ${count === 1 ? one : many}`;
}
