// Movement that only shows where something goes.

/** How long a way may take in milliseconds; no time for those whom movement makes sick. */
export const way = (usual_ms) => (matchMedia('(prefers-reduced-motion: reduce)').matches ? 0 : usual_ms);
