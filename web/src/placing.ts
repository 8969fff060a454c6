// A dropped surface before it runs: how it stands, how large and how fine it is, what the hand holds.
import { Quaternion, Vector3 } from 'three';
import { button, element, fillSelect, input, onChoice, onPress, select, setPressed, setText } from './dom.ts';
import { embedAll } from './embedding.ts';
import { PLACING_LIMITS, type Placement, type PlacingInfo, type Pose, type Quat, type Vec3 } from './protocol.ts';
import type { View3D } from './view3d.ts';

type Held = Placement['handle'];

const UNITS: Record<string, number> = { mm: 1e-3, cm: 1e-2, m: 1, inch: 0.0254 };
const AXES: Record<string, Vector3> = { x: new Vector3(1, 0, 0), y: new Vector3(0, 1, 0), z: new Vector3(0, 0, 1) };
const BEYOND = 0.1; // a box that reaches the end takes what sticks out of the surface, too; in longest sides
const DAB_SPACING = 0.4; // brush radii
const DIGITS = 5; // of a dab's coordinates behind the point, m: a message is short

/** Pose in which a turned surface stands on the ground, over the origin; and the sides of its box. */
export function standing(vertices: ArrayLike<number>, rotation: Quaternion): { pose: Pose; sides: Vec3 } {
  const low = new Vector3(Infinity, Infinity, Infinity);
  const high = new Vector3(-Infinity, -Infinity, -Infinity);
  const p = new Vector3();
  for (let i = 0; i < vertices.length; i += 3) {
    p.set(vertices[i] as number, vertices[i + 1] as number, vertices[i + 2] as number).applyQuaternion(rotation);
    low.min(p);
    high.max(p);
  }
  const { w, x, y, z } = rotation;
  return {
    pose: { position: [-(low.x + high.x) / 2, -(low.y + high.y) / 2, -low.z], rotation: [w, x, y, z] },
    sides: [high.x - low.x, high.y - low.y, high.z - low.z],
  };
}

/** Longest side in m of a file whose longest side is `extent` of its own units; `unit` '': as `millimeters` says. */
export function chosenSize(unit: string, extent: number, millimeters: number): number {
  const scale = UNITS[unit];
  return scale === undefined ? millimeters / 1000 : extent * scale;
}

/** A length for people. */
export function lengthText(meters: number): string {
  return meters >= 1 ? `${Number(meters.toPrecision(3))} m` : `${Number((1000 * meters).toPrecision(3))} mm`;
}

/** What a brush has touched: balls around its dabs. */
export class Painting {
  readonly dabs: Vector3[] = [];
  private readonly strokes: number[] = [];

  constructor(private readonly most: number) {}

  /** False where there are too many. */
  add(point: Vector3, radius: number, first: boolean): boolean {
    if (first) this.strokes.push(this.dabs.length);
    if (this.dabs.some((dab) => dab.distanceTo(point) < DAB_SPACING * radius)) return true;
    if (this.dabs.length >= this.most) return false;
    this.dabs.push(point.clone());
    return true;
  }

  /** Takes back the last stroke. */
  undo(): void {
    this.dabs.length = this.strokes.pop() ?? 0;
  }

  clear(): void {
    this.dabs.length = 0;
    this.strokes.length = 0;
  }

  holds(point: Vector3, radius: number): boolean {
    return this.dabs.some((dab) => dab.distanceToSquared(point) <= radius * radius);
  }
}

export class Placing {
  /** null: nothing is to be placed */
  private info: PlacingInfo | null = null;
  private generation = -1;
  private vertices: Float32Array = new Float32Array(0);
  private low = new Vector3();
  private high = new Vector3();
  private readonly rotation = new Quaternion();
  private held: Held = 'top';
  private readonly painting = new Painting(PLACING_LIMITS.dabs);
  private sides: Vec3 = [0, 0, 0];
  private pose: Pose = { position: [0, 0, 0], rotation: [1, 0, 0, 0] };

  constructor(
    private readonly view: View3D,
    private readonly start: (placement: Placement) => boolean,
    private readonly complain: (text: string) => void,
    cancel: () => void,
  ) {
    for (const axis of Object.keys(AXES)) {
      onPress(`turn-${axis}-back`, () => this.turn(axis, -1));
      onPress(`turn-${axis}`, () => this.turn(axis, 1));
    }
    onPress('turn-reset', () => {
      this.rotation.identity();
      this.stand();
    });
    fillSelect(select('place-unit'), [['', 'longest side:'], ...Object.keys(UNITS).map((u): [string, string] => [u, `the file is in ${u}`])], '');
    onChoice('place-unit', () => this.tell());
    for (const id of ['place-size', 'place-count']) input(id).addEventListener('input', () => this.tell());
    for (const held of ['top', 'box', 'painted'] as const) onPress(`held-${held}`, () => this.hold(held));
    for (const id of this.boxIds()) input(id).addEventListener('input', () => this.mark());
    input('brush').addEventListener('input', () => this.mark());
    onPress('brush-undo', () => this.repaint(() => this.painting.undo()));
    onPress('brush-clear', () => this.repaint(() => this.painting.clear()));
    onPress('place-start', () => this.begin());
    onPress('place-cancel', cancel);
  }

  get active(): boolean {
    return this.info !== null;
  }

  /** What is held, of the surface's vertices: for tests. */
  get heldVertices(): number {
    return this.marked.reduce((sum, m) => sum + m, 0);
  }
  private marked = new Float32Array(0);

  /** As the program says; the tool of `generation` is in the view by then. */
  show(info: PlacingInfo | null, generation: number): void {
    if (!info) {
      if (this.info) this.view.setPlacing(null);
      this.info = null;
      this.generation = -1;
      return;
    }
    const tool = this.view.toolView;
    if (this.generation === generation || !tool) return;
    this.info = info;
    this.generation = generation;
    this.vertices = embedAll(tool.body, tool.body.nodes);
    const { pose, sides } = standing(this.vertices, new Quaternion());
    this.low.set(-pose.position[0] - sides[0] / 2, -pose.position[1] - sides[1] / 2, -pose.position[2]);
    this.high.copy(this.low).add(new Vector3().fromArray(sides));
    this.rotation.identity();
    this.painting.clear();
    setText(element('placing-name'), info.name);
    select('place-unit').value = '';
    input('place-size').value = String(1000 * info.size);
    this.boxIds().forEach((id, i) => (input(id).value = i === 4 ? '75' : i % 2 ? '100' : '0'));
    this.stand();
    this.hold('top');
  }

  // --- standing -------------------------------------------------------------------------------------------------------

  private turn(axis: string, sign: number): void {
    const angle = (sign * Number(select('turn-step').value) * Math.PI) / 180;
    this.rotation.premultiply(new Quaternion().setFromAxisAngle(AXES[axis] as Vector3, angle)).normalize();
    this.stand();
  }

  private stand(): void {
    const { pose, sides } = standing(this.vertices, this.rotation);
    this.sides = sides;
    this.pose = pose;
    this.view.setPlacing(pose);
    this.mark();
    this.tell();
  }

  /** m; may be beyond the limits */
  private get size(): number {
    return chosenSize(select('place-unit').value, Math.max(...(this.info?.extent ?? [0])), Number(input('place-size').value));
  }

  private get tetrahedra(): number {
    const count = 10 ** Number(input('place-count').value);
    return Math.round(count < 100 ? count : Number(count.toPrecision(2)));
  }

  private tell(): void {
    if (!this.info) return;
    const scale = this.size / this.info.size;
    const [least, most] = PLACING_LIMITS.size;
    const fits = this.size >= least && this.size <= most;
    input('place-size').disabled = select('place-unit').value !== '';
    const sides = this.sides.map((s) => lengthText(s * scale)).join(' x ');
    setText(element('place-sides'), fits ? sides : `${sides}: from ${lengthText(least)} to ${lengthText(most)} is possible`);
    element('place-sides').classList.toggle('wrong', !fits);
    setText(element('place-count-value'), `${this.tetrahedra}`);
    input('place-count').setAttribute('aria-valuetext', `${this.tetrahedra} tetrahedra`);
    this.allow();
  }

  private allow(): void {
    const [least, most] = PLACING_LIMITS.size;
    const painted = this.held !== 'painted' || this.painting.dabs.length > 0;
    button('place-start').disabled = !(this.size >= least && this.size <= most && painted);
  }

  // --- the handle -----------------------------------------------------------------------------------------------------

  private boxIds(): string[] {
    return ['x', 'y', 'z'].flatMap((axis) => [`box-${axis}-from`, `box-${axis}-to`]);
  }

  private hold(held: Held): void {
    this.held = held;
    for (const name of ['top', 'box', 'painted'] as const) {
      setPressed(button(`held-${name}`), name === held);
      element(`held-${name}-more`).hidden = name !== held;
    }
    this.mark();
  }

  /** The box as it is drawn, rest coordinates at the size shown, m. */
  private get box(): { min: Vec3; max: Vec3 } {
    const min = this.low.clone();
    const max = this.high.clone();
    const side = this.high.clone().sub(this.low);
    (['x', 'y', 'z'] as const).forEach((axis) => {
      const ends = [Number(input(`box-${axis}-from`).value), Number(input(`box-${axis}-to`).value)].sort((a, b) => a - b);
      min[axis] = this.low[axis] + ((ends[0] as number) / 100) * side[axis];
      max[axis] = this.low[axis] + ((ends[1] as number) / 100) * side[axis];
    });
    return { min: min.toArray(), max: max.toArray() };
  }

  /** m, at the size shown */
  private get radius(): number {
    return (Number(input('brush').value) / 100) * (this.info?.size ?? 0.15);
  }

  /** Paints at a point of the canvas; false beside the surface, or where nothing is painted now. */
  paint(x: number, y: number, first: boolean): boolean {
    if (!this.info || this.held !== 'painted') return false;
    const pick = this.view.pick(x, y);
    if (!pick?.tool) return false;
    const rest = pick.point.sub(new Vector3().fromArray(this.pose.position)).applyQuaternion(this.rotation.clone().invert());
    if (!this.painting.add(rest, this.radius, first)) this.complain('The brush is empty: a larger one needs fewer dabs.');
    this.mark();
    return true;
  }

  private repaint(change: () => void): void {
    change();
    this.mark();
  }

  /** Colors what is held. */
  private mark(): void {
    if (!this.info) return;
    const { vertices } = this;
    this.marked = new Float32Array(vertices.length / 3);
    const box = this.box;
    const up = new Vector3(0, 0, 1).applyQuaternion(this.rotation.clone().invert());
    const heights = this.held === 'top' ? reach(vertices, up) : [0, 0];
    const edge = heights[0]! + 0.75 * (heights[1]! - heights[0]!);
    const p = new Vector3();
    const inBox = (): boolean => p.toArray().every((v, k) => v >= (box.min[k] as number) && v <= (box.max[k] as number));
    for (let i = 0; i < this.marked.length; ++i) {
      p.fromArray(vertices, 3 * i);
      const held = this.held === 'top' ? p.dot(up) >= edge : this.held === 'box' ? inBox() : this.painting.holds(p, this.radius);
      this.marked[i] = held ? 1 : 0;
    }
    this.view.toolView?.mark(this.marked);
    this.view.setBox(this.held === 'box' ? box : null);
    this.view.invalidate();
    const share = this.marked.length > 0 ? this.heldVertices / this.marked.length : 0;
    setText(element('held-share'), share > 0 ? `${Math.max(1, Math.round(100 * share))} % of the surface` : 'nothing yet');
    this.allow();
  }

  // --- starting -------------------------------------------------------------------------------------------------------

  /** What the program is to make of it. */
  placement(): Placement | null {
    if (!this.info) return null;
    const scale = this.size / this.info.size;
    const { w, x, y, z } = this.rotation;
    const rotation: Quat = [w, x, y, z];
    const common = { size: this.size, rotation, tetrahedra: this.tetrahedra };
    if (this.held === 'top') return { ...common, handle: 'top' };
    if (this.held === 'box') return { ...common, handle: 'box', ...this.reachingBox(scale) };
    const [least, most] = PLACING_LIMITS.brush;
    const radius = Math.min(most, Math.max(least, this.radius * scale));
    const centers = this.painting.dabs.flatMap((dab) => dab.toArray().map((v) => Number((v * scale).toFixed(DIGITS))));
    return { ...common, handle: 'painted', centers, radius };
  }

  /** Nodes of the simulation mesh lie around the surface: an end of the box at the surface's end is moved off it. */
  private reachingBox(scale: number): { min: Vec3; max: Vec3 } {
    const { min, max } = this.box;
    const more = BEYOND * (this.info?.size ?? 0);
    const end = (v: number, from: number, to: number): number => (v <= from ? from - more : v >= to ? to + more : v) * scale;
    const ends = (v: Vec3): Vec3 => v.map((c, k) => end(c, this.low.getComponent(k), this.high.getComponent(k))) as Vec3;
    return { min: ends(min), max: ends(max) };
  }

  private begin(): void {
    const placement = this.placement();
    if (placement && !this.start(placement)) this.complain('This could not be sent to the program.');
  }
}

/** Least and greatest coordinate along a direction. */
function reach(vertices: ArrayLike<number>, direction: Vector3): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  for (let i = 0; i < vertices.length; i += 3) {
    const v =
      (vertices[i] as number) * direction.x + (vertices[i + 1] as number) * direction.y + (vertices[i + 2] as number) * direction.z;
    low = Math.min(low, v);
    high = Math.max(high, v);
  }
  return [low, high];
}
