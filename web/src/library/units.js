/** Lengths in metres; meshes without a unit are ordered as if they were in metres. */
export const IN_METRES = { m: 1, cm: 0.01, mm: 0.001, in: 0.0254 };
