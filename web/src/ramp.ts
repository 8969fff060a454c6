// Color scale of stress and displacement: dark blue over green to light yellow, lightness rising all the way so that it
// reads in gray too.
const STOPS: [number, number, number][] = [
  [58, 62, 140],
  [46, 104, 172],
  [32, 148, 166],
  [82, 184, 126],
  [172, 210, 86],
  [252, 234, 112],
];

/** Color at t in [0, 1], sRGB bytes. */
export function rampColor(t: number): [number, number, number] {
  const x = Math.min(Math.max(t, 0), 1) * (STOPS.length - 1);
  const k = Math.min(Math.floor(x), STOPS.length - 2);
  const a = STOPS[k] as [number, number, number];
  const b = STOPS[k + 1] as [number, number, number];
  const f = x - k;
  return [0, 1, 2].map((i) => Math.round((a[i] as number) * (1 - f) + (b[i] as number) * f)) as [number, number, number];
}

/** RGBA bytes of `count` colors. */
export function rampTexels(count: number): Uint8Array {
  const out = new Uint8Array(4 * count);
  for (let i = 0; i < count; ++i) out.set([...rampColor(i / (count - 1)), 255], 4 * i);
  return out;
}
