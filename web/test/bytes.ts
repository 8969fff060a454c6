// Messages laid out by hand from docs/viewer.md.
export class Bytes {
  private readonly parts: number[] = [];

  u32(...values: number[]): this {
    for (const value of values) this.push(4, (view) => view.setUint32(0, value, true));
    return this;
  }

  f32(...values: number[]): this {
    for (const value of values) this.push(4, (view) => view.setFloat32(0, value, true));
    return this;
  }

  f64(value: number): this {
    return this.push(8, (view) => view.setFloat64(0, value, true));
  }

  raw(bytes: ArrayBuffer | string): this {
    const source = typeof bytes === 'string' ? new TextEncoder().encode(bytes) : new Uint8Array(bytes);
    for (const byte of source) this.parts.push(byte);
    return this;
  }

  private push(size: number, write: (view: DataView) => void): this {
    const view = new DataView(new ArrayBuffer(size));
    write(view);
    for (let i = 0; i < size; ++i) this.parts.push(view.getUint8(i));
    return this;
  }

  done(): ArrayBuffer {
    return Uint8Array.from(this.parts).buffer;
  }
}

const pose = [0.1, 0.2, 0.3, 1, 0, 0, 0];

/** One tetrahedron, one triangle, a plane and a surface. */
export const geometryBytes = (generation = 7): ArrayBuffer =>
  new Bytes()
    .u32(1, generation, 1, 2)
    .u32(4, 3, 1, 1, 1)
    .f32(0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1)
    .f32(0, 0, 0, 1)
    .u32(0, 1, 2, 3)
    .u32(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3)
    .f32(0.25, 0.25, 0.25, 0.25, 1, 0, 0, 0, 0, 1, 0, 0)
    .u32(0, 1, 2)
    .u32(0, 0, 0)
    .f32(0, 0, -1, 0, 0, 1)
    .u32(1, 3, 1)
    .f32(0, 0, 0, 1, 0, 0, 0, 1, 0)
    .u32(0, 1, 2)
    .done();

export const frameBytes = (time = 1.5, step = 45, generation = 7): ArrayBuffer =>
  new Bytes()
    .u32(2, generation, step, 12)
    .f64(time)
    .f32(...pose, ...pose, ...pose)
    .f32(1, 2, 3, 0.1, 0.2, 0.3)
    .u32(512, 12, 1, 4)
    .f32(0, 0, time, 1, 0, time, 0, 1, time, 0, 0, 1 + time)
    .f32(10, 20, 30, 40)
    .f32(0, 0, 0, 0, 0, 1, 0.5, 0, 2, 1)
    .done();

export const tickRow = (time: number, fill: number, flags = 0): { values: number[]; flags: number } => ({
  values: [time, ...Array.from({ length: 18 }, (_, i) => fill + i)],
  flags,
});

export function samplesBytes(t0: number, ticks: ReturnType<typeof tickRow>[], steps: number[][], lost = 0, generation = 7): ArrayBuffer {
  const bytes = new Bytes().u32(3, generation, ticks.length, steps.length, lost, 0).f64(t0);
  for (const { values, flags } of ticks) bytes.f32(...values).u32(flags);
  for (const step of steps) bytes.f32(...step);
  return bytes.done();
}

export const sceneText = (generation = 7): string =>
  JSON.stringify({
    type: 'scene',
    generation,
    name: 'tet',
    title: 'One tetrahedron',
    scenes: [{ name: 'tet', description: 'd' }],
    handles: ['tip'],
    methods: ['hsl', 'vc'],
    bodies: [{ name: 'tool', kind: 'tool', youngs_modulus: 2e4, tetrahedra: 1, triangles: 1 }],
    obstacles: [{ name: 'ground' }],
    device: { peak_force: 3.3, peak_torque: 0.2, stiffness: 300, workspace_radius: 0.1 },
    gravity: [0, 0, -9.81],
    haptic_step: 0.001,
    start: { position: [0, 0, 1], rotation: [1, 0, 0, 0] },
  });

/** A recording of records: text or bytes. */
export function recordingBytes(records: (string | ArrayBuffer)[]): ArrayBuffer {
  const bytes = new Bytes().raw('PALPATE1');
  for (const record of records) {
    const payload = typeof record === 'string' ? new TextEncoder().encode(record).buffer : record;
    bytes.u32(typeof record === 'string' ? 0 : 1, payload.byteLength).raw(payload as ArrayBuffer);
    bytes.raw(new ArrayBuffer((8 - (payload.byteLength % 8)) % 8));
  }
  return bytes.done();
}
