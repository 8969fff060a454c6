// Mouse, touch and keys: what moves the tool goes to the server as the hand's pose, the rest moves the camera.
import { Quaternion, Vector3 } from 'three';
import type { Command } from './protocol.ts';
import type { View3D } from './view3d.ts';

const TURN_PER_PIXEL = 0.009; // rad
const TURN_PER_SECOND = 1.4; // rad/s, keys
const MOVE_PER_SECOND = 0.7; // scene radii a second, keys
const KEYS_LET_GO_AFTER = 2000; // ms
const DEPTH_PER_NOTCH = 0.06; // scene radii
const REACH = 6; // scene radii that the hand goes from where it was taken
const NEAR_PIXELS = { mouse: 26, touch: 44 };

const MOVES: Record<string, [number, number, number]> = {
  ArrowLeft: [-1, 0, 0],
  KeyA: [-1, 0, 0],
  ArrowRight: [1, 0, 0],
  KeyD: [1, 0, 0],
  ArrowUp: [0, 1, 0],
  KeyW: [0, 1, 0],
  ArrowDown: [0, -1, 0],
  KeyS: [0, -1, 0],
  KeyQ: [0, 0, 1],
  PageUp: [0, 0, 1],
  KeyE: [0, 0, -1],
  PageDown: [0, 0, -1],
};

type Drag = 'hold' | 'orbit' | 'pan' | 'paint';

interface Pointer {
  x: number;
  y: number;
}

export class Hand {
  /** whether tools can be held at all: not in replay */
  enabled = true;
  /** smoothed time from sending a hand message to a picture with its effect, ms */
  delay = NaN;
  onHold: (holding: boolean) => void = () => {};
  /** paints at a point of the canvas; false: there is nothing to paint. `first`: a stroke begins */
  brush: ((x: number, y: number, first: boolean) => boolean) | null = null;

  private drag: Drag | null = null;
  private readonly pointers = new Map<number, Pointer>();
  private primary = -1;
  private holding = false;
  private byKeys = false;
  private keysAt = 0;
  private keepByKey = false;
  private readonly target = new Vector3();
  private readonly taken = new Vector3();
  private readonly rotation = new Quaternion();
  private readonly grabbed = new Vector3();
  private seq = 0;
  private readonly sent = new Map<number, number>();
  private seen = 0;
  private readonly delays: number[] = [];
  private readonly down = new Set<string>();
  private shift = false;

  constructor(
    private readonly view: View3D,
    private readonly send: (command: Command) => boolean,
  ) {
    const { canvas } = view;
    canvas.addEventListener('pointerdown', (e) => this.pointerDown(e));
    canvas.addEventListener('pointermove', (e) => this.pointerMove(e));
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture'] as const) {
      canvas.addEventListener(name, (e) => this.pointerUp(e));
    }
    canvas.addEventListener('wheel', (e) => this.wheel(e), { passive: false });
    canvas.addEventListener('contextmenu', (e) => e.preventDefault());
    canvas.addEventListener('keydown', (e) => this.keyDown(e));
    canvas.addEventListener('keyup', (e) => {
      this.down.delete(e.code);
      this.shift = e.shiftKey;
    });
    canvas.addEventListener('blur', () => {
      this.down.clear();
      if (this.byKeys) this.letGo();
    });
  }

  get isHolding(): boolean {
    return this.holding;
  }

  // --- holding --------------------------------------------------------------------------------------------------------

  private take(): void {
    if (this.holding) return;
    const pose = this.view.devicePose;
    this.target.fromArray(pose.position);
    this.taken.copy(this.target);
    const [w, x, y, z] = pose.rotation;
    this.rotation.set(x, y, z, w);
    if (!this.send({ type: 'take' })) return;
    this.holding = true;
    this.sent.clear();
    this.delays.length = 0;
    this.onHold(true);
  }

  letGo(): void {
    if (!this.holding) return;
    this.holding = false;
    this.byKeys = false;
    this.keepByKey = false;
    if (this.drag === 'hold') this.drag = null;
    this.send({ type: 'release' });
    this.cursor();
    this.onHold(false);
  }

  /** Takes the tool or lets it go, by key. */
  toggle(): void {
    if (!this.enabled) return;
    if (this.holding) {
      this.letGo();
      return;
    }
    this.take();
    this.byKeys = true;
    this.keepByKey = true;
  }

  private move(right: number, up: number, forward: number): void {
    const { orbit } = this.view;
    const step = orbit
      .right()
      .multiplyScalar(right)
      .addScaledVector(orbit.up(), up)
      .addScaledVector(orbit.forward(), forward);
    const before = this.target.clone();
    this.target.add(step);
    const reach = REACH * this.view.sceneRadius;
    const offset = this.target.clone().sub(this.taken);
    if (offset.length() > reach) this.target.copy(this.taken).add(offset.setLength(reach));
    this.grabbed.add(this.target).sub(before);
  }

  private turn(aboutUp: number, aboutRight: number, aboutForward: number): void {
    const { orbit } = this.view;
    const q = new Quaternion()
      .setFromAxisAngle(orbit.up(), aboutUp)
      .multiply(new Quaternion().setFromAxisAngle(orbit.right(), aboutRight))
      .multiply(new Quaternion().setFromAxisAngle(orbit.forward(), aboutForward));
    this.rotation.premultiply(q).normalize();
  }

  /** Once a picture: keys, and the pose to the server. */
  tick(seconds: number, now: number): void {
    this.applyKeys(seconds, now);
    if (!this.holding) return;
    const { x, y, z } = this.target;
    const r = this.rotation;
    const seq = ++this.seq;
    this.sent.set(seq, now);
    if (this.sent.size > 600) this.sent.delete(this.sent.keys().next().value as number);
    this.send({ type: 'hand', seq, position: [x, y, z], rotation: [r.w, r.x, r.y, r.z] });
  }

  /** A frame whose device had taken hand message `seq` has been drawn. */
  drawn(seq: number, now: number): void {
    if (seq === this.seen) return;
    this.seen = seq;
    const at = this.sent.get(seq);
    if (at === undefined) return;
    this.delays.push(now - at);
    if (this.delays.length > 31) this.delays.shift();
    const sorted = [...this.delays].sort((a, b) => a - b);
    this.delay = sorted[sorted.length >> 1] as number;
  }

  /** The server's answer: someone else holds the hand. */
  refused(): void {
    if (!this.holding) return;
    this.holding = false;
    this.byKeys = false;
    if (this.drag === 'hold') this.drag = null;
    this.cursor();
    this.onHold(false);
  }

  // --- pointer --------------------------------------------------------------------------------------------------------

  private local(e: { clientX: number; clientY: number }): Pointer {
    const box = this.view.canvas.getBoundingClientRect();
    return { x: e.clientX - box.left, y: e.clientY - box.top };
  }

  /** Where the tool would be taken at a point of the canvas, or null. */
  private graspAt(p: Pointer, touch: boolean): Vector3 | null {
    if (!this.enabled) return null;
    const pick = this.view.pick(p.x, p.y);
    if (pick?.tool) return pick.point;
    const handle = this.view.project(this.view.handleCenter);
    const near = touch ? NEAR_PIXELS.touch : NEAR_PIXELS.mouse;
    if (handle && Math.hypot(handle.x - p.x, handle.y - p.y) < near) return this.view.handleCenter.clone();
    return null;
  }

  private pointerDown(e: PointerEvent): void {
    this.view.canvas.focus({ preventScroll: true });
    const p = this.local(e);
    this.pointers.set(e.pointerId, p);
    this.view.canvas.setPointerCapture(e.pointerId);
    if (this.pointers.size > 1) return; // a second finger joins what the first began
    this.primary = e.pointerId;
    if (e.button === 0 && !(e.metaKey || (e.ctrlKey && !e.shiftKey))) {
      const at = this.graspAt(p, e.pointerType === 'touch');
      if (this.brush?.(p.x, p.y, true)) this.drag = 'paint';
      else if (at) {
        this.take();
        if (this.holding) {
          this.byKeys = false;
          this.grabbed.copy(at);
          this.drag = 'hold';
        }
      }
      this.drag ??= 'orbit';
    } else {
      this.drag = 'pan';
    }
    this.cursor();
  }

  private pointerMove(e: PointerEvent): void {
    const p = this.local(e);
    const before = this.pointers.get(e.pointerId);
    if (!before) {
      if (e.pointerType === 'mouse') this.hover(p);
      return;
    }
    const dx = p.x - before.x;
    const dy = p.y - before.y;
    if (this.drag === 'paint' && e.pointerId === this.primary) this.brush?.(p.x, p.y, false);
    if (this.pointers.size >= 2 && this.drag !== 'hold') this.pinch(e.pointerId, before, p);
    this.pointers.set(e.pointerId, p);
    const height = this.view.canvas.clientHeight || 1;
    if (this.drag === 'hold') {
      if (e.pointerId !== this.primary) {
        this.move(0, 0, (-dy / height) * 3 * this.view.sceneRadius);
        this.turn(0, 0, dx * TURN_PER_PIXEL);
      } else if (e.shiftKey && e.ctrlKey) {
        this.turn(0, 0, dx * TURN_PER_PIXEL);
      } else if (e.shiftKey) {
        this.turn(dx * TURN_PER_PIXEL, dy * TURN_PER_PIXEL, 0);
      } else {
        const size = this.view.pixelSize(this.grabbed);
        this.move(dx * size, -dy * size, 0);
      }
    } else if (this.pointers.size === 1) {
      if (this.drag === 'orbit') this.view.orbit.orbit(dx * 0.006, dy * 0.006);
      else if (this.drag === 'pan') this.view.orbit.pan(dx / height, dy / height);
    }
  }

  /** Two fingers beside the tool: zoom by their distance, pan by their middle. */
  private pinch(id: number, before: Pointer, now: Pointer): void {
    const other = [...this.pointers].find(([key]) => key !== id)?.[1];
    if (!other) return;
    const was = Math.hypot(before.x - other.x, before.y - other.y);
    const is = Math.hypot(now.x - other.x, now.y - other.y);
    if (was > 10 && is > 10) this.view.orbit.zoom(was / is);
    const height = this.view.canvas.clientHeight || 1;
    this.view.orbit.pan((now.x - before.x) / 2 / height, (now.y - before.y) / 2 / height);
  }

  private pointerUp(e: PointerEvent): void {
    if (!this.pointers.delete(e.pointerId)) return;
    if (e.pointerId !== this.primary && this.pointers.size > 0) return;
    if (this.drag === 'hold') this.letGo();
    this.drag = null;
    const next = this.pointers.keys().next();
    if (!next.done) {
      this.primary = next.value;
      this.drag = 'orbit';
    }
    this.cursor();
  }

  private wheel(e: WheelEvent): void {
    e.preventDefault();
    const notches = (e.deltaMode === 0 ? e.deltaY / 100 : e.deltaY / 3) || 0;
    const limited = Math.max(-3, Math.min(3, notches));
    if (this.drag === 'hold') this.move(0, 0, -limited * DEPTH_PER_NOTCH * this.view.sceneRadius);
    else this.view.orbit.zoom(1.13 ** limited);
  }

  private hover(p: Pointer): void {
    this.view.canvas.classList.toggle('grab', this.graspAt(p, false) !== null);
  }

  private cursor(): void {
    this.view.canvas.classList.toggle('holding', this.drag === 'hold');
  }

  // --- keys -----------------------------------------------------------------------------------------------------------

  private keyDown(e: KeyboardEvent): void {
    this.shift = e.shiftKey;
    if (e.code in MOVES) {
      e.preventDefault();
      if (e.altKey || e.ctrlKey || e.metaKey) {
        const [x, y] = MOVES[e.code] as [number, number, number];
        if (e.altKey) this.view.orbit.orbit(-x * 0.12, y * 0.12);
        else this.view.orbit.pan(-x * 0.06, y * 0.06);
        return;
      }
      this.down.add(e.code);
    } else if (e.code === 'KeyH') {
      this.toggle();
    } else if (e.code === 'Escape') {
      this.letGo();
    }
  }

  private applyKeys(seconds: number, now: number): void {
    if (this.down.size > 0 && this.enabled) {
      this.keysAt = now;
      if (!this.holding) {
        this.take();
        this.byKeys = this.holding;
      }
      const sum: [number, number, number] = [0, 0, 0];
      for (const code of this.down) MOVES[code]?.forEach((v, i) => (sum[i]! += v));
      const length = Math.hypot(...sum);
      if (length > 0) {
        const [x, y, z] = sum.map((v) => v / length) as [number, number, number];
        if (this.shift) {
          const angle = TURN_PER_SECOND * seconds;
          this.turn(x * angle, -y * angle, z * angle);
        } else {
          const step = MOVE_PER_SECOND * this.view.sceneRadius * seconds;
          this.move(x * step, y * step, z * step);
        }
      }
    } else if (this.byKeys && !this.keepByKey && now - this.keysAt > KEYS_LET_GO_AFTER) {
      this.letGo();
    }
  }
}
