// Displacement as one means it: what is left when the motion as a whole is taken out.

/**
 * Distance of each node from where the best rigid motion of the nodes with weight > 0 puts its rest position, f32[N], m.
 * Rotation: largest-overlap iteration on a quaternion, started from `guess` (w x y z), which is updated.
 */
export function displacement(
  rest: Float32Array,
  now: Float32Array,
  weights: Float32Array | null,
  guess: Float64Array,
  out: Float32Array,
): void {
  const count = rest.length / 3;
  const c0 = [0, 0, 0];
  const c1 = [0, 0, 0];
  let total = 0;
  const weight = (i: number): number => (weights ? (weights[i] as number) : 1);
  for (let i = 0; i < count; ++i) {
    const w = weight(i);
    total += w;
    for (let k = 0; k < 3; ++k) {
      c0[k]! += w * (rest[3 * i + k] as number);
      c1[k]! += w * (now[3 * i + k] as number);
    }
  }
  if (!(total > 0)) {
    out.fill(0);
    return;
  }
  for (let k = 0; k < 3; ++k) {
    c0[k]! /= total;
    c1[k]! /= total;
  }
  // a[3 col + row] = sum w (now - c1)_row (rest - c0)_col
  const a = new Float64Array(9);
  for (let i = 0; i < count; ++i) {
    const w = weight(i);
    if (w === 0) continue;
    for (let col = 0; col < 3; ++col) {
      const r = w * ((rest[3 * i + col] as number) - (c0[col] as number));
      for (let row = 0; row < 3; ++row) a[3 * col + row]! += r * ((now[3 * i + row] as number) - (c1[row] as number));
    }
  }
  const r = new Float64Array(9);
  for (let iteration = 0; iteration < 20; ++iteration) {
    matrix(guess, r);
    let scale = 1e-30;
    const omega = [0, 0, 0];
    for (let col = 0; col < 3; ++col) {
      const x = 3 * col;
      const [rx, ry, rz] = [r[x] as number, r[x + 1] as number, r[x + 2] as number];
      const [ax, ay, az] = [a[x] as number, a[x + 1] as number, a[x + 2] as number];
      omega[0]! += ry * az - rz * ay;
      omega[1]! += rz * ax - rx * az;
      omega[2]! += rx * ay - ry * ax;
      scale += rx * ax + ry * ay + rz * az;
    }
    const factor = 1 / (Math.abs(scale) + 1e-30);
    const [wx, wy, wz] = [omega[0]! * factor, omega[1]! * factor, omega[2]! * factor];
    const angle = Math.hypot(wx, wy, wz);
    if (angle < 1e-9) break;
    const s = Math.sin(angle / 2) / angle;
    const [dw, dx, dy, dz] = [Math.cos(angle / 2), s * wx, s * wy, s * wz];
    const [qw, qx, qy, qz] = [guess[0]!, guess[1]!, guess[2]!, guess[3]!];
    const q = [
      dw * qw - dx * qx - dy * qy - dz * qz,
      dw * qx + dx * qw + dy * qz - dz * qy,
      dw * qy - dx * qz + dy * qw + dz * qx,
      dw * qz + dx * qy - dy * qx + dz * qw,
    ];
    const length = Math.hypot(q[0]!, q[1]!, q[2]!, q[3]!);
    for (let k = 0; k < 4; ++k) guess[k] = q[k]! / length;
  }
  matrix(guess, r);
  for (let i = 0; i < count; ++i) {
    const [x, y, z] = [rest[3 * i]! - c0[0]!, rest[3 * i + 1]! - c0[1]!, rest[3 * i + 2]! - c0[2]!];
    out[i] = Math.hypot(
      now[3 * i]! - c1[0]! - (r[0]! * x + r[3]! * y + r[6]! * z),
      now[3 * i + 1]! - c1[1]! - (r[1]! * x + r[4]! * y + r[7]! * z),
      now[3 * i + 2]! - c1[2]! - (r[2]! * x + r[5]! * y + r[8]! * z),
    );
  }
}

/** Rotation matrix of a quaternion, column after column. */
function matrix(q: Float64Array, m: Float64Array): void {
  const [w, x, y, z] = [q[0]!, q[1]!, q[2]!, q[3]!];
  m[0] = 1 - 2 * (y * y + z * z);
  m[1] = 2 * (x * y + w * z);
  m[2] = 2 * (x * z - w * y);
  m[3] = 2 * (x * y - w * z);
  m[4] = 1 - 2 * (x * x + z * z);
  m[5] = 2 * (y * z + w * x);
  m[6] = 2 * (x * z + w * y);
  m[7] = 2 * (y * z - w * x);
  m[8] = 1 - 2 * (x * x + y * y);
}
