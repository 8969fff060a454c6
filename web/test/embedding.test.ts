import assert from 'node:assert/strict';
import { test } from 'node:test';
import { NodeField, castRay, embed, embedAll, shadingSurface } from '../src/embedding.ts';
import { decodeBinary, type BodyGeometry } from '../src/protocol.ts';
import { displacement } from '../src/rigid_fit.ts';
import { geometryBytes } from './bytes.ts';

const near = (a: ArrayLike<number>, b: ArrayLike<number>, tolerance = 1e-5): void => {
  assert.equal(a.length, b.length);
  for (let i = 0; i < a.length; ++i) assert.ok(Math.abs(a[i]! - b[i]!) < tolerance, `${[...Array.from(a)]} is not ${[...Array.from(b)]}`);
};

function tetrahedron(): BodyGeometry {
  const g = decodeBinary(geometryBytes());
  assert.ok(g.type === 'geometry');
  return g.bodies[0]!;
}

/** Node positions A x + b, A row after row. */
const mapped = (nodes: Float32Array, a: number[], b: number[]): Float32Array => {
  const out = new Float32Array(nodes.length);
  for (let i = 0; i < nodes.length; i += 3) {
    for (let r = 0; r < 3; ++r) out[i + r] = a[3 * r]! * nodes[i]! + a[3 * r + 1]! * nodes[i + 1]! + a[3 * r + 2]! * nodes[i + 2]! + b[r]!;
  }
  return out;
};

const CUBE = Float32Array.from([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1]);
const CUBE_TRIANGLES = Uint32Array.from([
  0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4, 2, 3, 7, 2, 7, 6, 1, 2, 6, 1, 6, 5, 3, 0, 4, 3, 4, 7,
]); // prettier-ignore

test('vertices are weighted sums of nodes', () => {
  const body = tetrahedron();
  near(embed(body, body.nodes, 0), [0.25, 0.25, 0.25]);
  near(embedAll(body, mapped(body.nodes, [1, 0, 0, 0, 1, 0, 0, 0, 1], [1, 2, 3])).subarray(0, 3), [1.25, 2.25, 3.25]);
});

test('normals follow the cofactor of an affine map', () => {
  const body = tetrahedron();
  const field = new NodeField(body, 0);
  // Stretch along x: a normal at 45 degrees leans away from x.
  field.update(mapped(body.nodes, [2, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]), null);
  const s = Math.SQRT1_2;
  const n = field.normal(0, [s, s, 0]);
  near(n, [1 / Math.sqrt(5), 2 / Math.sqrt(5), 0]);
  // Quarter turn about z.
  field.update(mapped(body.nodes, [0, -1, 0, 1, 0, 0, 0, 0, 1], [5, 0, 0]), null);
  near(field.normal(0, [1, 0, 0]), [0, 1, 0]);
});

test('a flat tetrahedron says nothing and breaks nothing', () => {
  const body = tetrahedron();
  const flat = { ...body, nodes: mapped(body.nodes, [1, 0, 0, 0, 1, 0, 0, 0, 0], [0, 0, 0]) };
  const field = new NodeField(flat, 0);
  field.update(flat.nodes, Float32Array.of(1, 2, 3, 4));
  near(field.normal(0, [0, 0, 1]), [0, 0, 1]);
  assert.equal(field.data[16 + 3], 2);
});

test('edges of a cube are split, a gentle roof is not', () => {
  const cube = shadingSurface(CUBE, CUBE_TRIANGLES);
  assert.equal(cube.source.length, 24);
  for (let i = 0; i < cube.normals.length; i += 3) {
    const n = [...cube.normals.subarray(i, i + 3)].map(Math.abs).sort();
    near(n, [0, 0, 1]);
  }
  const roof = shadingSurface(
    Float32Array.from([0, -1, 0, 0, 1, 0, 1, 0, -0.2, -1, 0, -0.2]),
    Uint32Array.from([0, 2, 1, 0, 1, 3]),
  );
  assert.equal(roof.source.length, 4);
  near(roof.normals.subarray(0, 3), [0, 0, 1]);
});

test('rays hit the nearest triangle', () => {
  const hit = castRay(CUBE, CUBE_TRIANGLES, [0.3, 0.4, 5], [0, 0, -1]);
  assert.ok(hit);
  assert.ok(Math.abs(hit.distance - 4) < 1e-6);
  assert.equal(castRay(CUBE, CUBE_TRIANGLES, [2, 0.4, 5], [0, 0, -1]), null);
  assert.equal(castRay(CUBE, CUBE_TRIANGLES, [0.3, 0.4, 5], [0, 0, 1]), null);
});

test('a rigid motion is no displacement', () => {
  const c = Math.cos(2.5);
  const s = Math.sin(2.5);
  const moved = mapped(CUBE, [c, -s, 0, s, c, 0, 0, 0, 1], [3, 1, -2]);
  const out = new Float32Array(8);
  const guess = Float64Array.of(1, 0, 0, 0);
  displacement(CUBE, moved, null, guess, out);
  near(out, new Float32Array(8), 1e-4);
  const held = Float32Array.of(1, 1, 1, 1, 0, 0, 0, 0);
  moved[3 * 6 + 2]! += 0.5;
  displacement(CUBE, moved, held, guess, out);
  near(out, [0, 0, 0, 0, 0, 0, 0.5, 0], 1e-4);
});
