// Messages between the page and `palpate view` (docs/viewer.md). Decoding is total: whatever comes, the answer is a
// message or an `invalid` with a reason; no array is made that the message does not hold. Numbers of kinds, columns of
// rows and limits are the program's own, in protocol.json; test/shared.test.ts holds the rest against messages that the
// program wrote.
import description from './protocol.json';

export const PROTOCOL_VERSION = description.version;
const { kinds: KINDS, body_flags: BODY_FLAGS, obstacles: OBSTACLES, recording: RECORDING } = description;

export type Vec3 = [number, number, number];
/** w x y z, as the program writes them. */
export type Quat = [number, number, number, number];

export interface Pose {
  position: Vec3;
  rotation: Quat;
}

export interface Invalid {
  type: 'invalid';
  reason: string;
}

// --- JSON, server to page ---------------------------------------------------------------------------------------------

export interface Welcome {
  type: 'welcome';
  protocol: number;
  viewer: number;
  version: string;
}

export interface AttachmentInfo {
  name: string;
  kind: 'fixed' | 'springs' | 'glued';
  /** of the body */
  nodes: number[];
  /** the body that they are glued to; empty: the world */
  to: string;
}

export interface BodyInfo {
  name: string;
  kind: 'tool' | 'soft' | 'rigid';
  attachments: AttachmentInfo[];
  /** Pa */
  youngsModulus: number;
  tetrahedra: number;
  triangles: number;
}

export interface SceneInfo {
  type: 'scene';
  generation: number;
  name: string;
  title: string;
  description: string;
  scenes: { name: string; description: string }[];
  handles: string[];
  methods: string[];
  bodies: BodyInfo[];
  obstacles: { name: string }[];
  device: { peakForce: number; peakTorque: number; stiffness: number; workspaceRadius: number };
  gravity: Vec3;
  /** s */
  hapticStep: number;
  start: Pose;
}

export interface RunState {
  type: 'state';
  generation: number;
  handle: string;
  method: string;
  /** s */
  visualStep: number;
  friction: number;
  stiffness: number;
  speed: number;
  paused: boolean;
  /** number of the viewer that holds the hand */
  hand: number | null;
  driver: 'path' | 'hand';
  stress: boolean;
  recording: string | null;
  busy: string | null;
  viewers: number;
  /** what the scene's own motion of the hand does */
  motion: 'none' | 'playing' | 'over';
  /** a dropped surface that waits to be placed */
  placing: PlacingInfo | null;
}

export interface PlacingInfo {
  /** of the file */
  name: string;
  /** sides of its bounding box, in the file's own unit */
  extent: Vec3;
  /** longest side as it is shown, m */
  size: number;
}

export interface Saved {
  type: 'saved';
  /** of the file */
  name: string;
  text: string;
}

export interface Histogram {
  p50: number;
  p99: number;
  max: number;
  /** upper edge in us, count */
  bins: [number, number][];
}

export interface Stats {
  type: 'stats';
  ticks: number;
  missed: number;
  dropped: number;
  tickUs: Histogram;
  wakeUs: Histogram;
  /** J given to the hand */
  energyJ: number;
  realtime: string | null;
  serverShare: number;
}

export interface Notice {
  type: 'notice';
  level: 'info' | 'error';
  text: string;
}

export type TextMessage = Welcome | SceneInfo | RunState | Stats | Notice | Saved | Invalid;

type Json = Record<string, unknown>;

const isObject = (value: unknown): value is Json =>
  typeof value === 'object' && value !== null && !Array.isArray(value);
const number = (value: unknown, otherwise = 0): number =>
  typeof value === 'number' && Number.isFinite(value) ? value : otherwise;
const text = (value: unknown, otherwise = ''): string => (typeof value === 'string' ? value : otherwise);
const textOrNull = (value: unknown): string | null => (typeof value === 'string' && value !== '' ? value : null);
const list = (value: unknown): unknown[] => (Array.isArray(value) ? value : []);
const object = (value: unknown): Json => (isObject(value) ? value : {});
const texts = (value: unknown): string[] => list(value).filter((item): item is string => typeof item === 'string');

function vec3(value: unknown, otherwise: Vec3 = [0, 0, 0]): Vec3 {
  const v = list(value);
  return v.length === 3 && v.every((x) => typeof x === 'number' && Number.isFinite(x)) ? (v as Vec3) : otherwise;
}

function quat(value: unknown): Quat {
  const q = list(value);
  if (q.length !== 4 || !q.every((x) => typeof x === 'number' && Number.isFinite(x))) return [1, 0, 0, 0];
  return normalized(q as Quat);
}

export function normalized(q: Quat): Quat {
  const length = Math.hypot(q[0], q[1], q[2], q[3]);
  return length > 1e-9 ? [q[0] / length, q[1] / length, q[2] / length, q[3] / length] : [1, 0, 0, 0];
}

function histogram(value: unknown): Histogram {
  const h = object(value);
  const bins: [number, number][] = [];
  for (const item of list(h['bins'])) {
    const pair = list(item);
    const edge = pair[0];
    const count = pair[1];
    if (typeof edge === 'number' && typeof count === 'number') bins.push([edge, count]);
  }
  return { p50: number(h['p50']), p99: number(h['p99']), max: number(h['max']), bins };
}

function decodeAttachment(a: Json): AttachmentInfo {
  return {
    name: text(a['name']),
    kind: a['kind'] === 'springs' || a['kind'] === 'glued' ? a['kind'] : 'fixed',
    nodes: list(a['nodes']).filter((n): n is number => typeof n === 'number' && Number.isInteger(n) && n >= 0),
    to: text(a['to']),
  };
}

const invalid = (reason: string): Invalid => ({ type: 'invalid', reason });

function decodeScene(m: Json): SceneInfo {
  const device = object(m['device']);
  const start = object(m['start']);
  return {
    type: 'scene',
    generation: number(m['generation']),
    name: text(m['name']),
    title: text(m['title'], text(m['name'])),
    description: text(m['description']),
    scenes: list(m['scenes'])
      .filter(isObject)
      .map((s) => ({ name: text(s['name']), description: text(s['description']) })),
    handles: texts(m['handles']),
    methods: texts(m['methods']),
    bodies: list(m['bodies'])
      .filter(isObject)
      .map((b) => ({
        name: text(b['name']),
        kind: b['kind'] === 'tool' || b['kind'] === 'rigid' ? b['kind'] : 'soft',
        attachments: list(b['attachments']).filter(isObject).map(decodeAttachment),
        youngsModulus: number(b['youngs_modulus']),
        tetrahedra: number(b['tetrahedra']),
        triangles: number(b['triangles']),
      })),
    obstacles: list(m['obstacles'])
      .filter(isObject)
      .map((o) => ({ name: text(o['name']) })),
    device: {
      peakForce: number(device['peak_force'], 3.3),
      peakTorque: number(device['peak_torque'], 0.2),
      stiffness: number(device['stiffness']),
      workspaceRadius: number(device['workspace_radius'], 0.1),
    },
    gravity: vec3(m['gravity'], [0, 0, -9.81]),
    hapticStep: number(m['haptic_step'], 0.001),
    start: { position: vec3(start['position']), rotation: quat(start['rotation']) },
  };
}

function decodeState(m: Json): RunState {
  return {
    type: 'state',
    generation: number(m['generation']),
    handle: text(m['handle']),
    method: text(m['method']),
    visualStep: number(m['visual_step'], 0.033),
    friction: number(m['friction'], 1),
    stiffness: number(m['stiffness'], 1),
    speed: number(m['speed'], 1),
    paused: m['paused'] === true,
    hand: typeof m['hand'] === 'number' ? m['hand'] : null,
    driver: m['driver'] === 'hand' ? 'hand' : 'path',
    stress: m['stress'] === true,
    recording: textOrNull(m['recording']),
    busy: textOrNull(m['busy']),
    viewers: number(m['viewers'], 1),
    motion: m['motion'] === 'playing' || m['motion'] === 'over' ? m['motion'] : 'none',
    placing: isObject(m['placing'])
      ? { name: text(m['placing']['name']), extent: vec3(m['placing']['extent']), size: number(m['placing']['size'], 0.15) }
      : null,
  };
}

function decodeStats(m: Json): Stats {
  return {
    type: 'stats',
    ticks: number(m['ticks']),
    missed: number(m['missed']),
    dropped: number(m['dropped']),
    tickUs: histogram(m['tick_us']),
    wakeUs: histogram(m['wake_us']),
    energyJ: number(m['energy_J']),
    realtime: textOrNull(m['realtime']),
    serverShare: number(m['server_share']),
  };
}

/** One text message. */
export function decodeText(source: string): TextMessage {
  let parsed: unknown;
  try {
    parsed = JSON.parse(source);
  } catch {
    return invalid('text message is not JSON');
  }
  if (!isObject(parsed)) return invalid('text message is not an object');
  const m = parsed;
  switch (m['type']) {
    case 'welcome':
      return {
        type: 'welcome',
        protocol: number(m['protocol']),
        viewer: number(m['viewer']),
        version: text(m['version']),
      };
    case 'scene':
      return decodeScene(m);
    case 'state':
      return decodeState(m);
    case 'stats':
      return decodeStats(m);
    case 'notice':
      return { type: 'notice', level: m['level'] === 'error' ? 'error' : 'info', text: text(m['text']) };
    case 'saved':
      return { type: 'saved', name: text(m['name'], 'scene.yaml'), text: text(m['text']) };
    default:
      return invalid(`unknown message type ${JSON.stringify(m['type']) ?? 'none'}`);
  }
}

// --- binary, server to page -------------------------------------------------------------------------------------------

export interface BodyGeometry {
  /** f32[3N], m, world */
  nodes: Float32Array;
  /** f32[N], 1: attached to the handle */
  held: Float32Array;
  /** u32[4E] */
  tetrahedra: Uint32Array;
  /** u32[4V] */
  vertexNodes: Uint32Array;
  /** f32[4V] */
  vertexWeights: Float32Array;
  /** u32[3T] */
  triangles: Uint32Array;
  tool: boolean;
  rigid: boolean;
}

export type ObstacleGeometry =
  | { shape: 'plane'; point: Vec3; normal: Vec3 }
  | { shape: 'surface'; vertices: Float32Array; triangles: Uint32Array };

export interface Geometry {
  type: 'geometry';
  generation: number;
  bodies: BodyGeometry[];
  obstacles: ObstacleGeometry[];
}

/** Values of a contact in `Frame.contacts`, and where each stands; the force is on the first body [N]. */
export const CONTACT_STRIDE = description.contact.stride;
export const CONTACT = description.contact.columns;

export interface Frame {
  type: 'frame';
  generation: number;
  step: number;
  handSeq: number;
  /** s */
  time: number;
  device: Pose;
  proxy: Pose;
  handle: Pose;
  /** N, N m */
  wrench: Float32Array;
  flags: number;
  /** empty: nodes, stress and contacts as in the last frame */
  nodes: Float32Array;
  stress: Float32Array;
  contacts: Float32Array;
}

/** Values of a tick in `Samples.ticks`; see `TICK`. */
export const TICK_STRIDE = description.tick.stride;
/** Values of a visual step in `Samples.steps`; see `STEP`. */
export const STEP_STRIDE = description.step.stride;

export const TICK = description.tick.columns;
export const STEP = description.step.columns;

export interface Samples {
  type: 'samples';
  generation: number;
  lost: number;
  /** s */
  t0: number;
  ticks: Float32Array;
  /** the flags of each tick, as bits */
  tickBits: Uint32Array;
  steps: Float32Array;
  tickCount: number;
  stepCount: number;
}

export type BinaryMessage = Geometry | Frame | Samples | Invalid;

/** Walks through a message; a read past the end makes `short` true and gives zeros and empty arrays. */
class Reader {
  private readonly view: DataView;
  private at = 0;
  short = false;

  constructor(private readonly buffer: ArrayBuffer) {
    this.view = new DataView(buffer);
  }

  private take(bytes: number): number {
    const from = this.at;
    if (this.short || bytes > this.buffer.byteLength - from) {
      this.short = true;
      return -1;
    }
    this.at += bytes;
    return from;
  }

  u32(): number {
    const from = this.take(4);
    return from < 0 ? 0 : this.view.getUint32(from, true);
  }

  f32(): number {
    const from = this.take(4);
    return from < 0 ? 0 : this.view.getFloat32(from, true);
  }

  f64(): number {
    const from = this.take(8);
    return from < 0 ? 0 : this.view.getFloat64(from, true);
  }

  u32s(count: number): Uint32Array {
    const from = this.take(4 * count);
    return from < 0 ? new Uint32Array(0) : new Uint32Array(this.buffer, from, count);
  }

  f32s(count: number): Float32Array {
    const from = this.take(4 * count);
    return from < 0 ? new Float32Array(0) : new Float32Array(this.buffer, from, count);
  }

  vec3(): Vec3 {
    return [this.f32(), this.f32(), this.f32()];
  }

  pose(): Pose {
    const position = this.vec3();
    return { position, rotation: normalized([this.f32(), this.f32(), this.f32(), this.f32()]) };
  }

  get rest(): number {
    return this.buffer.byteLength - this.at;
  }
}

const below = (indices: Uint32Array, limit: number): boolean => {
  for (const index of indices) if (index >= limit) return false;
  return true;
};

const finite = (values: Float32Array): boolean => {
  for (const value of values) if (!Number.isFinite(value)) return false;
  return true;
};

const finitePose = (pose: Pose): boolean => pose.position.every(Number.isFinite) && pose.rotation.every(Number.isFinite);

/** One binary message. Arrays are views of `buffer`, which must start at a multiple of 8 bytes (an own ArrayBuffer does). */
export function decodeBinary(buffer: ArrayBuffer): BinaryMessage {
  const r = new Reader(buffer);
  const kind = r.u32();
  if (r.short) return invalid(`binary message of ${buffer.byteLength} bytes`);
  switch (kind) {
    case KINDS.geometry:
      return decodeGeometry(r);
    case KINDS.frame:
      return decodeFrame(r);
    case KINDS.samples:
      return decodeSamples(r);
    default:
      return invalid(`binary message of unknown kind ${kind}`);
  }
}

function decodeGeometry(r: Reader): Geometry | Invalid {
  const generation = r.u32();
  const bodyCount = r.u32();
  const obstacleCount = r.u32();
  if (r.short) return invalid('geometry is cut off');
  if (bodyCount * 20 + obstacleCount * 12 > r.rest) return invalid('geometry names more bodies than it holds');
  const bodies: BodyGeometry[] = [];
  for (let b = 0; b < bodyCount; ++b) {
    const n = r.u32();
    const v = r.u32();
    const t = r.u32();
    const e = r.u32();
    const flags = r.u32();
    const body: BodyGeometry = {
      nodes: r.f32s(3 * n),
      held: r.f32s(n),
      tetrahedra: r.u32s(4 * e),
      vertexNodes: r.u32s(4 * v),
      vertexWeights: r.f32s(4 * v),
      triangles: r.u32s(3 * t),
      tool: (flags & BODY_FLAGS.tool) !== 0,
      rigid: (flags & BODY_FLAGS.rigid) !== 0,
    };
    if (r.short) return invalid(`geometry is cut off in body ${b}`);
    if (!below(body.tetrahedra, n) || !below(body.vertexNodes, n)) return invalid(`body ${b} names a node it lacks`);
    if (!below(body.triangles, v)) return invalid(`body ${b} names a vertex it lacks`);
    if (!finite(body.nodes) || !finite(body.vertexWeights)) return invalid(`body ${b} is not finite`);
    bodies.push(body);
  }
  const obstacles: ObstacleGeometry[] = [];
  for (let o = 0; o < obstacleCount; ++o) {
    const shape = r.u32();
    const v = r.u32();
    const t = r.u32();
    if (shape === OBSTACLES.plane) {
      obstacles.push({ shape: 'plane', point: r.vec3(), normal: r.vec3() });
    } else if (shape === OBSTACLES.surface) {
      const vertices = r.f32s(3 * v);
      const triangles = r.u32s(3 * t);
      if (!r.short && !below(triangles, v)) return invalid(`obstacle ${o} names a vertex it lacks`);
      if (!finite(vertices)) return invalid(`obstacle ${o} is not finite`);
      obstacles.push({ shape: 'surface', vertices, triangles });
    } else {
      return invalid(`obstacle ${o} is of unknown type ${shape}`);
    }
    if (r.short) return invalid(`geometry is cut off in obstacle ${o}`);
  }
  return { type: 'geometry', generation, bodies, obstacles };
}

function decodeFrame(r: Reader): Frame | Invalid {
  const generation = r.u32();
  const step = r.u32();
  const handSeq = r.u32();
  const time = r.f64();
  const device = r.pose();
  const proxy = r.pose();
  const handle = r.pose();
  const wrench = r.f32s(6);
  const flags = r.u32();
  const n = r.u32();
  const c = r.u32();
  const s = r.u32();
  const nodes = r.f32s(n);
  const stress = r.f32s(s);
  const contacts = r.f32s(CONTACT_STRIDE * c);
  if (r.short) return invalid('frame is cut off');
  if (n % 3 !== 0 || (s !== 0 && s !== n / 3)) return invalid('frame has parts of nodes');
  if (!Number.isFinite(time) || !finitePose(device) || !finitePose(proxy) || !finitePose(handle) || !finite(nodes)) {
    return invalid('frame is not finite');
  }
  return {
    type: 'frame',
    generation,
    step,
    handSeq,
    time,
    device,
    proxy,
    handle,
    wrench,
    flags,
    nodes,
    stress,
    contacts,
  };
}

function decodeSamples(r: Reader): Samples | Invalid {
  const generation = r.u32();
  const tickCount = r.u32();
  const stepCount = r.u32();
  const lost = r.u32();
  r.u32();
  const t0 = r.f64();
  const ticks = r.f32s(TICK_STRIDE * tickCount);
  const steps = r.f32s(STEP_STRIDE * stepCount);
  if (r.short) return invalid('samples are cut off');
  if (!Number.isFinite(t0)) return invalid('samples have no time');
  const tickBits = new Uint32Array(ticks.buffer, ticks.byteOffset, ticks.length);
  return { type: 'samples', generation, lost, t0, ticks, tickBits, steps, tickCount, stepCount };
}

// --- page to server ---------------------------------------------------------------------------------------------------

export interface Settings {
  method?: string;
  handle?: string;
  visual_step?: number;
  friction?: number;
  stiffness?: number;
  speed?: number;
  stress?: boolean;
}

/** How a dropped surface becomes the tool; lengths in m, points in its rest coordinates (docs/viewer.md). */
export type Placement = {
  size: number;
  rotation: Quat;
  tetrahedra: number;
} & (
  | { handle: 'top' }
  | { handle: 'box'; min: Vec3; max: Vec3 }
  /** x, y, z of each dab of the brush */
  | { handle: 'painted'; centers: number[]; radius: number }
);

export const PLACING_LIMITS = {
  size: description.limits.surface_size as [number, number],
  tetrahedra: description.limits.tetrahedra as [number, number],
  brush: description.limits.brush as [number, number],
  dabs: description.limits.dabs,
};

export type Command =
  | { type: 'hand'; seq: number; position: Vec3; rotation: Quat }
  | { type: 'take' | 'release' | 'play' | 'pause' | 'resume' | 'step' | 'reset' }
  | ({ type: 'set' } & Settings)
  | { type: 'scene'; name: string }
  | { type: 'record'; on: boolean }
  | ({ type: 'place' } & Placement)
  | { type: 'cancel' }
  | { type: 'save' }
  | { type: 'ack'; frame: number };

export const MAX_COMMAND_BYTES = description.limits.command_bytes;

/** A command as it goes over the wire, or null where it would be refused (not finite or too long). */
export function encodeCommand(command: Command): string | null {
  if (command.type === 'hand' && !finitePose(command)) return null;
  const message = JSON.stringify(command);
  return new TextEncoder().encode(message).length <= MAX_COMMAND_BYTES ? message : null;
}

// --- HTTP -------------------------------------------------------------------------------------------------------------

export interface Session {
  mode: 'view' | 'replay';
  protocol: number;
  version: string;
  name: string;
  maxSurfaceBytes: number;
}

export function decodeSession(value: unknown): Session {
  const s = object(value);
  return {
    mode: s['mode'] === 'replay' ? 'replay' : 'view',
    protocol: number(s['protocol'], PROTOCOL_VERSION),
    version: text(s['version']),
    name: text(s['name']),
    maxSurfaceBytes: number(s['max_surface_bytes'], description.limits.surface_bytes),
  };
}

// --- recording --------------------------------------------------------------------------------------------------------

export interface Recording {
  messages: (TextMessage | BinaryMessage)[];
  /** what could not be read, for people */
  complaint: string | null;
}

/** `recording.palpate`. A file that was cut off gives what it holds up to there, and a complaint. */
export function decodeRecording(buffer: ArrayBuffer): Recording | Invalid {
  const bytes = new Uint8Array(buffer);
  const magic = RECORDING.magic;
  if (bytes.length < magic.length || !magic.split('').every((c, i) => bytes[i] === c.charCodeAt(0))) {
    return invalid('this is not a recording of Palpate');
  }
  const view = new DataView(buffer);
  const messages: (TextMessage | BinaryMessage)[] = [];
  const utf8 = new TextDecoder();
  let complaint: string | null = null;
  let at = magic.length;
  while (at < bytes.length) {
    if (bytes.length - at < 8) {
      complaint = 'the recording ends in the middle of a record';
      break;
    }
    const kind = view.getUint32(at, true);
    const size = view.getUint32(at + 4, true);
    at += 8;
    if (size > bytes.length - at) {
      complaint = 'the recording ends in the middle of a record';
      break;
    }
    if (kind === RECORDING.extra) {
      at += Math.ceil(size / RECORDING.alignment) * RECORDING.alignment;
      continue;
    }
    // A copy, so that arrays are aligned and a frame does not keep the whole file alive.
    const message =
      kind === RECORDING.text
        ? decodeText(utf8.decode(bytes.subarray(at, at + size)))
        : kind === RECORDING.binary
          ? decodeBinary(buffer.slice(at, at + size))
          : invalid(`record of unknown kind ${kind}`);
    if (message.type === 'invalid') complaint ??= message.reason;
    else messages.push(message);
    at += Math.ceil(size / RECORDING.alignment) * RECORDING.alignment;
  }
  return { messages, complaint };
}
