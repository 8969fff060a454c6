import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Object3D, Quaternion, Vector3 } from 'three';
import { placeFrom, poseBetween } from '../src/markers.ts';
import type { Pose } from '../src/protocol.ts';

function pose(position: [number, number, number], axis: [number, number, number], angle: number): Pose {
  const q = new Quaternion().setFromAxisAngle(new Vector3(...axis).normalize(), angle);
  return { position, rotation: [q.w, q.x, q.y, q.z] };
}

const apply = (p: Pose, point: Vector3): Vector3 => {
  const [w, x, y, z] = p.rotation;
  return point.clone().applyQuaternion(new Quaternion(x, y, z, w)).add(new Vector3(...p.position));
};

test('an object is moved as one pose to another', () => {
  const from = pose([0.1, -0.2, 0.3], [1, 2, 3], 0.7);
  const to = pose([-0.4, 0.5, 0.2], [0, -1, 1], 1.9);
  const object = new Object3D();
  placeFrom(object, from, to);
  object.updateMatrix();
  for (const local of [new Vector3(), new Vector3(0.03, -0.01, 0.07)]) {
    const moved = apply(from, local).applyMatrix4(object.matrix);
    assert.ok(moved.distanceTo(apply(to, local)) < 1e-12);
  }
  placeFrom(object, to, to);
  assert.ok(object.position.length() < 1e-12 && Math.abs(object.quaternion.w) > 1 - 1e-12);
});

test('between two poses: ends, middle, the shorter way', () => {
  const from = pose([0, 0, 0], [0, 0, 1], 0.2);
  const to = pose([1, 2, 3], [0, 0, 1], 1.0);
  to.rotation = to.rotation.map((x) => -x) as Pose['rotation']; // the same rotation
  assert.deepEqual(poseBetween(from, to, 0).position, [0, 0, 0]);
  assert.deepEqual(poseBetween(from, to, 1).position, [1, 2, 3]);
  const middle = poseBetween(from, to, 0.5);
  const wanted = pose([0.5, 1, 1.5], [0, 0, 1], 0.6);
  assert.deepEqual(middle.position, wanted.position);
  const along = middle.rotation.reduce((sum, x, i) => sum + x * wanted.rotation[i]!, 0);
  assert.ok(Math.abs(along) > 1 - 1e-12);
});
