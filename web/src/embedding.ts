// The geometry that the graphics card evaluates, and the same on the processor for picking and tests: surface vertices are
// weighted sums of nodes; normals follow the cofactor matrix of the deformation gradient, averaged at the nodes.
import type { BodyGeometry } from './protocol.ts';

/** A surface with its vertices split along sharp edges, so that a box looks like a box and a scan looks smooth. */
export interface ShadingSurface {
  /** for each vertex drawn: the vertex of the body's surface */
  source: Uint32Array;
  /** f32[3 * drawn], at rest */
  positions: Float32Array;
  /** f32[3 * drawn], at rest, unit */
  normals: Float32Array;
  /** u32[3T] of drawn vertices */
  triangles: Uint32Array;
}

const at = (a: ArrayLike<number>, i: number): number => a[i] as number;

/** Position of surface vertex `vertex` for node positions `nodes` (f32[3N]). */
export function embed(body: BodyGeometry, nodes: ArrayLike<number>, vertex: number): [number, number, number] {
  const p: [number, number, number] = [0, 0, 0];
  for (let k = 0; k < 4; ++k) {
    const w = at(body.vertexWeights, 4 * vertex + k);
    const node = 3 * at(body.vertexNodes, 4 * vertex + k);
    p[0] += w * at(nodes, node);
    p[1] += w * at(nodes, node + 1);
    p[2] += w * at(nodes, node + 2);
  }
  return p;
}

/** All vertices of a body's surface, f32[3V]. */
export function embedAll(body: BodyGeometry, nodes: ArrayLike<number>): Float32Array {
  const count = body.vertexNodes.length / 4;
  const out = new Float32Array(3 * count);
  for (let v = 0; v < count; ++v) out.set(embed(body, nodes, v), 3 * v);
  return out;
}

/** Splits vertices where neighboring triangles meet at more than `creaseDegrees`, and gives each its normal. */
export function shadingSurface(
  vertices: Float32Array,
  triangles: Uint32Array,
  creaseDegrees = 50,
): ShadingSurface {
  const cosine = Math.cos((creaseDegrees * Math.PI) / 180);
  const faceCount = triangles.length / 3;
  const area = new Float32Array(3 * faceCount); // normals as long as twice the area
  const unit = new Float32Array(3 * faceCount);
  for (let f = 0; f < faceCount; ++f) {
    const a = 3 * at(triangles, 3 * f);
    const b = 3 * at(triangles, 3 * f + 1);
    const c = 3 * at(triangles, 3 * f + 2);
    const ux = at(vertices, b) - at(vertices, a);
    const uy = at(vertices, b + 1) - at(vertices, a + 1);
    const uz = at(vertices, b + 2) - at(vertices, a + 2);
    const vx = at(vertices, c) - at(vertices, a);
    const vy = at(vertices, c + 1) - at(vertices, a + 1);
    const vz = at(vertices, c + 2) - at(vertices, a + 2);
    const nx = uy * vz - uz * vy;
    const ny = uz * vx - ux * vz;
    const nz = ux * vy - uy * vx;
    const length = Math.hypot(nx, ny, nz) || 1;
    area.set([nx, ny, nz], 3 * f);
    unit.set([nx / length, ny / length, nz / length], 3 * f);
  }
  const vertexCount = vertices.length / 3;
  const begin = new Uint32Array(vertexCount + 1);
  for (const v of triangles) ++begin[v + 1]!;
  for (let v = 0; v < vertexCount; ++v) begin[v + 1]! += at(begin, v);
  const corners = new Uint32Array(triangles.length);
  const fill = begin.slice(0, vertexCount);
  for (let c = 0; c < triangles.length; ++c) corners[fill[at(triangles, c)]!++] = c;

  const drawn = new Uint32Array(triangles.length);
  const source: number[] = [];
  const normals: number[] = [];
  const group: number[] = [];
  const shareEdge = (f: number, g: number, v: number): boolean => {
    for (let i = 0; i < 3; ++i) {
      const u = at(triangles, 3 * f + i);
      if (u === v) continue;
      for (let j = 0; j < 3; ++j) if (at(triangles, 3 * g + j) === u) return true;
    }
    return false;
  };
  for (let v = 0; v < vertexCount; ++v) {
    const from = at(begin, v);
    const count = at(begin, v + 1) - from;
    for (let i = 0; i < count; ++i) group[i] = i;
    const find = (i: number): number => {
      while (group[i] !== i) i = group[i] as number;
      return i;
    };
    for (let i = 0; i < count; ++i) {
      const f = Math.floor(at(corners, from + i) / 3);
      for (let j = i + 1; j < count; ++j) {
        const g = Math.floor(at(corners, from + j) / 3);
        const dot =
          at(unit, 3 * f) * at(unit, 3 * g) +
          at(unit, 3 * f + 1) * at(unit, 3 * g + 1) +
          at(unit, 3 * f + 2) * at(unit, 3 * g + 2);
        if (dot > cosine && shareEdge(f, g, v)) group[find(j)] = find(i);
      }
    }
    for (let i = 0; i < count; ++i) {
      if (find(i) !== i) continue;
      const index = source.length;
      let nx = 0;
      let ny = 0;
      let nz = 0;
      for (let j = 0; j < count; ++j) {
        if (find(j) !== i) continue;
        const corner = at(corners, from + j);
        const f = 3 * Math.floor(corner / 3);
        nx += at(area, f);
        ny += at(area, f + 1);
        nz += at(area, f + 2);
        drawn[corner] = index;
      }
      const length = Math.hypot(nx, ny, nz) || 1;
      source.push(v);
      normals.push(nx / length, ny / length, nz / length);
    }
  }
  const positions = new Float32Array(3 * source.length);
  source.forEach((v, i) => positions.set(vertices.subarray(3 * v, 3 * v + 3), 3 * i));
  return { source: Uint32Array.from(source), positions, normals: Float32Array.from(normals), triangles: drawn };
}

/** Values a node has in the texture: x y z and the value that colors, then three columns of the cofactor matrix, each padded. */
export const NODE_FLOATS = 16;

/** Node positions and cofactors of a body as the vertex shader wants them. */
export class NodeField {
  readonly count: number;
  /** f32[16 N] and padding up to whole texture rows */
  readonly data: Float32Array;
  private readonly inverseRest: Float32Array;
  private readonly volume: Float32Array;
  private readonly total: Float32Array;

  constructor(
    private readonly body: BodyGeometry,
    floats: number,
  ) {
    const { nodes, tetrahedra } = body;
    this.count = nodes.length / 3;
    this.data = new Float32Array(Math.max(floats, NODE_FLOATS * this.count));
    const tets = tetrahedra.length / 4;
    this.inverseRest = new Float32Array(9 * tets);
    this.volume = new Float32Array(tets);
    this.total = new Float32Array(this.count);
    const m = new Float64Array(9);
    for (let e = 0; e < tets; ++e) {
      this.edges(nodes, e, m);
      const det = determinant(m);
      const scale = Math.cbrt(Math.abs(det));
      if (!(scale > 1e-12)) continue; // flat at rest: says nothing about normals
      this.volume[e] = Math.abs(det);
      invert(m, det, this.inverseRest, 9 * e);
      for (let k = 0; k < 4; ++k) this.total[at(tetrahedra, 4 * e + k)]! += Math.abs(det);
    }
  }

  /** Columns of `m` become the edges from node 0 of tetrahedron `e`. */
  private edges(nodes: ArrayLike<number>, e: number, m: Float64Array): void {
    const t = this.body.tetrahedra;
    const o = 3 * at(t, 4 * e);
    for (let k = 0; k < 3; ++k) {
      const p = 3 * at(t, 4 * e + k + 1);
      for (let i = 0; i < 3; ++i) m[3 * k + i] = at(nodes, p + i) - at(nodes, o + i);
    }
  }

  /** Takes node positions (f32[3N] from `offset` on) and a value for each node. */
  update(nodes: Float32Array, values: Float32Array | null): void {
    const { data, count } = this;
    for (let i = 0; i < count; ++i) {
      const d = NODE_FLOATS * i;
      data[d] = at(nodes, 3 * i);
      data[d + 1] = at(nodes, 3 * i + 1);
      data[d + 2] = at(nodes, 3 * i + 2);
      data[d + 3] = values ? at(values, i) : 0;
      const identity = at(this.total, i) > 0 ? 0 : 1;
      for (let k = 4; k < NODE_FLOATS; ++k) data[d + k] = 0;
      data[d + 4] = data[d + 9] = data[d + 14] = identity;
    }
    const t = this.body.tetrahedra;
    const ds = new Float64Array(9);
    const f = new Float64Array(9);
    const c = new Float64Array(9);
    for (let e = 0; e < this.volume.length; ++e) {
      const volume = at(this.volume, e);
      if (volume === 0) continue;
      this.edges(nodes, e, ds);
      const inv = 9 * e;
      // F = Ds Dm^-1, column after column
      for (let col = 0; col < 3; ++col) {
        for (let row = 0; row < 3; ++row) {
          f[3 * col + row] =
            at(ds, row) * at(this.inverseRest, inv + 3 * col) +
            at(ds, 3 + row) * at(this.inverseRest, inv + 3 * col + 1) +
            at(ds, 6 + row) * at(this.inverseRest, inv + 3 * col + 2);
        }
      }
      cofactor(f, c);
      for (let k = 0; k < 4; ++k) {
        const node = at(t, 4 * e + k);
        const w = volume / at(this.total, node);
        const d = NODE_FLOATS * node + 4;
        for (let col = 0; col < 3; ++col) {
          data[d + 4 * col]! += w * at(c, 3 * col);
          data[d + 4 * col + 1]! += w * at(c, 3 * col + 1);
          data[d + 4 * col + 2]! += w * at(c, 3 * col + 2);
        }
      }
    }
  }

  /** What the vertex shader does to the normal `rest` of surface vertex `vertex`. */
  normal(vertex: number, rest: ArrayLike<number>): [number, number, number] {
    const n: [number, number, number] = [0, 0, 0];
    for (let k = 0; k < 4; ++k) {
      const w = at(this.body.vertexWeights, 4 * vertex + k);
      const d = NODE_FLOATS * at(this.body.vertexNodes, 4 * vertex + k) + 4;
      for (let i = 0; i < 3; ++i) {
        n[i]! +=
          w *
          (at(this.data, d + i) * at(rest, 0) +
            at(this.data, d + 4 + i) * at(rest, 1) +
            at(this.data, d + 8 + i) * at(rest, 2));
      }
    }
    const length = Math.hypot(n[0], n[1], n[2]) || 1;
    return [n[0] / length, n[1] / length, n[2] / length];
  }
}

const determinant = (m: ArrayLike<number>): number =>
  at(m, 0) * (at(m, 4) * at(m, 8) - at(m, 7) * at(m, 5)) -
  at(m, 3) * (at(m, 1) * at(m, 8) - at(m, 7) * at(m, 2)) +
  at(m, 6) * (at(m, 1) * at(m, 5) - at(m, 4) * at(m, 2));

/** Cofactor matrix of m, both column after column: cross products of the columns. */
function cofactor(m: ArrayLike<number>, out: Float64Array): void {
  for (let k = 0; k < 3; ++k) {
    const a = 3 * ((k + 1) % 3);
    const b = 3 * ((k + 2) % 3);
    out[3 * k] = at(m, a + 1) * at(m, b + 2) - at(m, a + 2) * at(m, b + 1);
    out[3 * k + 1] = at(m, a + 2) * at(m, b) - at(m, a) * at(m, b + 2);
    out[3 * k + 2] = at(m, a) * at(m, b + 1) - at(m, a + 1) * at(m, b);
  }
}

function invert(m: Float64Array, det: number, out: Float32Array, offset: number): void {
  const c = new Float64Array(9);
  cofactor(m, c); // inverse = cofactor^T / det
  for (let col = 0; col < 3; ++col) {
    for (let row = 0; row < 3; ++row) out[offset + 3 * col + row] = at(c, 3 * row + col) / det;
  }
}

/**
 * Nearest hit of the ray origin + s * direction with a triangle surface; s >= 0, or null. Triangles are hit from both sides.
 */
export function castRay(
  vertices: Float32Array,
  triangles: Uint32Array,
  origin: ArrayLike<number>,
  direction: ArrayLike<number>,
): { distance: number; triangle: number } | null {
  const [ox, oy, oz] = [at(origin, 0), at(origin, 1), at(origin, 2)];
  const [dx, dy, dz] = [at(direction, 0), at(direction, 1), at(direction, 2)];
  let best = Infinity;
  let triangle = -1;
  for (let f = 0; f < triangles.length; f += 3) {
    const a = 3 * at(triangles, f);
    const b = 3 * at(triangles, f + 1);
    const c = 3 * at(triangles, f + 2);
    const ax = at(vertices, a);
    const ay = at(vertices, a + 1);
    const az = at(vertices, a + 2);
    const ux = at(vertices, b) - ax;
    const uy = at(vertices, b + 1) - ay;
    const uz = at(vertices, b + 2) - az;
    const vx = at(vertices, c) - ax;
    const vy = at(vertices, c + 1) - ay;
    const vz = at(vertices, c + 2) - az;
    const px = dy * vz - dz * vy;
    const py = dz * vx - dx * vz;
    const pz = dx * vy - dy * vx;
    const det = ux * px + uy * py + uz * pz;
    if (det === 0) continue;
    const tx = ox - ax;
    const ty = oy - ay;
    const tz = oz - az;
    const s = (tx * px + ty * py + tz * pz) / det;
    if (s < 0 || s > 1) continue;
    const qx = ty * uz - tz * uy;
    const qy = tz * ux - tx * uz;
    const qz = tx * uy - ty * ux;
    const r = (dx * qx + dy * qy + dz * qz) / det;
    if (r < 0 || s + r > 1) continue;
    const distance = (vx * qx + vy * qy + vz * qz) / det;
    if (distance >= 0 && distance < best) {
      best = distance;
      triangle = f / 3;
    }
  }
  return triangle < 0 ? null : { distance: best, triangle };
}
