import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Quaternion, Vector3 } from 'three';
import { Painting, chosenSize, lengthText, standing } from '../src/placing.ts';

const BOX = [0, 1].flatMap((x) => [0, 1].flatMap((y) => [0, 1].flatMap((z) => [4 * x - 1, 2 * y, z + 7])));

test('what is turned stands on the ground, over the origin', () => {
  const still = standing(BOX, new Quaternion());
  assert.deepEqual(still.pose.position, [-1, -1, -7]);
  assert.deepEqual(still.sides, [4, 2, 1]);
  const turn = new Quaternion().setFromAxisAngle(new Vector3(0, 1, 0), Math.PI / 2); // x becomes -z, z becomes x
  const { pose, sides } = standing(BOX, turn);
  [1, 2, 4].forEach((side, k) => assert.ok(Math.abs((sides[k] as number) - side) < 1e-12));
  const points = Array.from({ length: 8 }, (_, i) => new Vector3().fromArray(BOX, 3 * i).applyQuaternion(turn).add(new Vector3(...pose.position)));
  assert.ok(Math.abs(Math.min(...points.map((p) => p.z))) < 1e-12);
  for (const axis of ['x', 'y'] as const) {
    const values = points.map((p) => p[axis]);
    assert.ok(Math.abs(Math.min(...values) + Math.max(...values)) < 1e-12);
  }
});

test('units of a file', () => {
  assert.equal(chosenSize('', 80, 150), 0.15);
  assert.equal(chosenSize('mm', 80, 150), 0.08);
  assert.equal(chosenSize('m', 0.5, 150), 0.5);
  assert.ok(Math.abs(chosenSize('inch', 10, 150) - 0.254) < 1e-12);
  assert.ok(Number.isNaN(chosenSize('', 80, NaN)));
  assert.equal(lengthText(0.0375), '37.5 mm');
  assert.equal(lengthText(2.5), '2.5 m');
});

test('a brush leaves balls, takes strokes back and runs dry', () => {
  const painting = new Painting(5);
  const at = (x: number): Vector3 => new Vector3(x, 0, 0);
  assert.ok(painting.add(at(0), 1, true));
  assert.ok(painting.add(at(0.1), 1, false)); // near enough to the first
  assert.equal(painting.dabs.length, 1);
  assert.ok(painting.add(at(1), 1, false));
  assert.ok(painting.holds(new Vector3(1.9, 0.3, 0), 1));
  assert.ok(!painting.holds(new Vector3(2.1, 0, 0), 1));
  assert.ok(painting.add(at(10), 1, true));
  assert.ok(painting.add(at(11), 1, false));
  assert.ok(painting.add(at(12), 1, false));
  assert.equal(painting.add(at(13), 1, false), false);
  painting.undo();
  assert.equal(painting.dabs.length, 2);
  painting.undo();
  painting.undo();
  assert.equal(painting.dabs.length, 0);
});
