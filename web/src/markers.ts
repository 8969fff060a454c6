// Arrows, frames and contact points.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  ConeGeometry,
  CylinderGeometry,
  Group,
  InstancedMesh,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  Quaternion,
  SphereGeometry,
  TorusGeometry,
  Vector3,
  type Object3D,
} from 'three';
import { CONTACT_STRIDE, type Pose } from './protocol.ts';

const UP = new Vector3(0, 1, 0);
const FORWARD = new Vector3(0, 0, 1);

/** Sets position and rotation of an object to a pose of the protocol (w first). */
export function place(object: Object3D, pose: Pose): void {
  object.position.fromArray(pose.position);
  const [w, x, y, z] = pose.rotation;
  object.quaternion.set(x, y, z, w);
}

/** Moves an object as the rigid motion does that takes one pose to another. */
export function placeFrom(object: Object3D, from: Pose, to: Pose): void {
  place(object, to);
  const [w, x, y, z] = from.rotation;
  object.quaternion.multiply(new Quaternion(-x, -y, -z, w));
  object.position.sub(new Vector3().fromArray(from.position).applyQuaternion(object.quaternion));
}

/** A share of the way from one pose to another. */
export function poseBetween(from: Pose, to: Pose, share: number): Pose {
  const position = new Vector3().fromArray(from.position).lerp(new Vector3().fromArray(to.position), share);
  const turned = quaternionOf(from).slerp(quaternionOf(to), share);
  return { position: position.toArray(), rotation: [turned.w, turned.x, turned.y, turned.z] };
}

function quaternionOf(pose: Pose): Quaternion {
  const [w, x, y, z] = pose.rotation;
  return new Quaternion(x, y, z, w);
}

/** A straight arrow of unit thickness; `size` [m] sets its thickness. */
export class Arrow {
  readonly group = new Group();
  readonly tip = new Vector3();
  private readonly shaft: Mesh;
  private readonly head: Mesh;
  private readonly direction = new Vector3();

  constructor(color: Color) {
    const material = new MeshLambertMaterial({ color, emissive: color, emissiveIntensity: 0.25 });
    const shaft = new CylinderGeometry(1, 1, 1, 20);
    shaft.translate(0, 0.5, 0);
    const head = new ConeGeometry(2.4, 6, 28);
    head.translate(0, 3, 0);
    this.shaft = new Mesh(shaft, material);
    this.head = new Mesh(head, material);
    this.shaft.castShadow = this.head.castShadow = true;
    this.group.add(this.shaft, this.head);
  }

  set(from: Vector3, vector: Vector3, size: number): void {
    const length = vector.length();
    this.group.visible = length > size * 0.5;
    if (!this.group.visible) return;
    this.direction.copy(vector).divideScalar(length);
    this.group.position.copy(from);
    this.group.quaternion.setFromUnitVectors(UP, this.direction);
    const thin = Math.min(1, length / (12 * size)); // short arrows stay arrows
    const headLength = 6 * size * thin;
    this.shaft.scale.set(size * thin, Math.max(length - headLength, 1e-6), size * thin);
    this.head.scale.setScalar(size * thin);
    this.head.position.y = length - headLength;
    this.tip.copy(from).addScaledVector(this.direction, length);
  }
}

/** A torque: three quarters of a ring around its axis with a head, larger with more torque. */
export class Ring {
  readonly group = new Group();
  readonly edge = new Vector3();
  private readonly material: MeshLambertMaterial;
  private readonly arc: Mesh;
  private readonly head: Mesh;

  constructor(color: Color) {
    this.material = new MeshLambertMaterial({ color, emissive: color, emissiveIntensity: 0.25 });
    const angle = Math.PI * 1.5;
    this.arc = new Mesh(new TorusGeometry(1, 0.035, 10, 64, angle), this.material);
    const cone = new ConeGeometry(0.1, 0.26, 24);
    cone.translate(0, 0.1, 0);
    this.head = new Mesh(cone, this.material);
    this.head.position.set(Math.cos(angle), Math.sin(angle), 0);
    this.head.rotation.z = angle;
    this.group.add(this.arc, this.head);
  }

  /** `share` of the greatest torque, `radius` [m] at that. */
  set(at: Vector3, torque: Vector3, share: number, radius: number): void {
    this.group.visible = share > 0.01;
    if (!this.group.visible) return;
    this.group.position.copy(at);
    this.group.quaternion.setFromUnitVectors(FORWARD, torque.clone().normalize());
    const scale = radius * (0.35 + 0.65 * Math.min(1, share));
    this.group.scale.setScalar(scale);
    this.edge.set(1, 0, 0).applyQuaternion(this.group.quaternion).multiplyScalar(scale).add(at);
  }
}

/** Three axes, seen through what is before them. */
export function makeTriad(length: number, faint: boolean): Group {
  const group = new Group();
  const axes: [Vector3, string][] = [
    [new Vector3(1, 0, 0), '#e5484d'],
    [new Vector3(0, 1, 0), '#30a46c'],
    [new Vector3(0, 0, 1), '#3e7bfa'],
  ];
  const opacity = faint ? 0.45 : 1;
  for (const [axis, color] of axes) {
    const material = new MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity });
    const shaft = new CylinderGeometry(0.025 * length, 0.025 * length, length, 10);
    shaft.translate(0, length / 2, 0);
    const mesh = new Mesh(shaft, material);
    mesh.quaternion.setFromUnitVectors(UP, axis);
    mesh.renderOrder = 10;
    group.add(mesh);
  }
  const center = new Mesh(
    new SphereGeometry(0.07 * length, 16, 12),
    new MeshBasicMaterial({ color: faint ? '#9aa3ad' : '#ffffff', depthTest: false, transparent: true, opacity }),
  );
  center.renderOrder = 11;
  group.add(center);
  return group;
}

const STATE_COLORS = [new Color('#8b949e'), new Color('#0f9d8a'), new Color('#f08c1a')]; // open, sticking, sliding

/** Contact points with their normals and forces. */
export class Contacts {
  readonly group = new Group();
  private points: InstancedMesh | null = null;
  private normals: InstancedMesh | null = null;
  private capacity = 0;
  private readonly matrix = new Matrix4();
  private readonly position = new Vector3();
  private readonly normal = new Vector3();
  private readonly rotation = new Quaternion();
  private readonly scale = new Vector3();

  /** `contacts` as in a frame; `size` [m] of a point. */
  set(contacts: Float32Array, size: number): void {
    const count = contacts.length / CONTACT_STRIDE;
    if (count > this.capacity) this.grow(Math.max(64, 2 * count));
    if (!this.points || !this.normals) return;
    for (let i = 0; i < count; ++i) {
      const at = i * CONTACT_STRIDE;
      this.position.fromArray(contacts, at);
      this.normal.fromArray(contacts, at + 3);
      const state = Math.min(2, Math.max(0, Math.round(contacts[at + 9] as number)));
      this.rotation.setFromUnitVectors(UP, this.normal.normalize());
      this.scale.setScalar(state === 0 ? size * 0.7 : size);
      this.points.setMatrixAt(i, this.matrix.compose(this.position, this.rotation, this.scale));
      this.scale.set(size, size * (state === 0 ? 5 : 9), size);
      this.normals.setMatrixAt(i, this.matrix.compose(this.position, this.rotation, this.scale));
      const color = STATE_COLORS[state] as Color;
      this.points.setColorAt(i, color);
      this.normals.setColorAt(i, color);
    }
    for (const mesh of [this.points, this.normals]) {
      mesh.count = count;
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
  }

  private grow(capacity: number): void {
    this.dispose();
    this.capacity = capacity;
    const make = (geometry: BufferGeometry, opacity: number): InstancedMesh => {
      const material = new MeshBasicMaterial({ depthTest: false, transparent: true, opacity });
      const mesh = new InstancedMesh(geometry, material, capacity);
      mesh.frustumCulled = false;
      mesh.renderOrder = 8;
      this.group.add(mesh);
      return mesh;
    };
    const stem = new CylinderGeometry(0.22, 0.22, 1, 6);
    stem.translate(0, 0.5, 0);
    this.normals = make(stem, 0.8);
    this.points = make(new SphereGeometry(1, 14, 10), 0.95);
  }

  dispose(): void {
    for (const mesh of [this.points, this.normals]) {
      if (!mesh) continue;
      this.group.remove(mesh);
      mesh.geometry.dispose();
      (mesh.material as MeshBasicMaterial).dispose();
      mesh.dispose();
    }
    this.points = this.normals = null;
    this.capacity = 0;
  }
}

/** A segment between two points, as a thin line geometry. */
export function setSegment(geometry: BufferGeometry, a: Vector3, b: Vector3): void {
  const attribute = geometry.getAttribute('position') as BufferAttribute;
  attribute.setXYZ(0, a.x, a.y, a.z);
  attribute.setXYZ(1, b.x, b.y, b.z);
  attribute.needsUpdate = true;
}
