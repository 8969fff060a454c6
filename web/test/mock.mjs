// Stands in for `palpate view` and `palpate replay` while one works on the page alone: the protocol of docs/viewer.md with a
// soft bar that only looks like physics. Written from the manual and not from src/protocol.ts, so that both are checked.
//   node test/mock.mjs [--port N] [--replay] [--watch] [--slow-scene]
import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';
import { WebSocketServer } from 'ws';
import { buildPage } from '../build.mjs';

const here = dirname(fileURLToPath(import.meta.url));
const CSP =
  "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'";

// --- a soft bar --------------------------------------------------------------------------------------------------------

const CORNERS = [
  [0, 1, 3, 7],
  [0, 3, 2, 7],
  [0, 2, 6, 7],
  [0, 6, 4, 7],
  [0, 4, 5, 7],
  [0, 5, 1, 7],
]; // six tetrahedra of a cube, corner bits x y z

function makeBar({ size = [0.056, 0.056, 0.15], cells = [4, 4, 10], at = [0, 0, 0], heldAbove = 0.105, rounding = 4 }) {
  const nodes = [];
  const index = (i, j, k) => (k * (cells[1] + 1) + j) * (cells[0] + 1) + i;
  for (let k = 0; k <= cells[2]; ++k)
    for (let j = 0; j <= cells[1]; ++j)
      for (let i = 0; i <= cells[0]; ++i)
        nodes.push(
          at[0] + (i / cells[0] - 0.5) * size[0],
          at[1] + (j / cells[1] - 0.5) * size[1],
          at[2] + (k / cells[2]) * size[2],
        );
  const tetrahedra = [];
  for (let k = 0; k < cells[2]; ++k)
    for (let j = 0; j < cells[1]; ++j)
      for (let i = 0; i < cells[0]; ++i)
        for (const tet of CORNERS)
          for (const c of tet) tetrahedra.push(index(i + (c & 1), j + ((c >> 1) & 1), k + ((c >> 2) & 1)));
  // Surface: a superellipsoid-like cushion from a subdivided cube.
  const n = 26;
  const vertices = [];
  const triangles = [];
  const seen = new Map();
  const vertex = (u) => {
    const key = u.join(',');
    if (!seen.has(key)) {
      const p = u.map((x) => (x / n) * 2 - 1);
      const r = Math.pow(p.reduce((s, x) => s + Math.pow(Math.abs(x), rounding), 0), 1 / rounding);
      const q = p.map((x) => x / r);
      seen.set(key, vertices.length / 3);
      vertices.push(
        at[0] + (q[0] * 0.498 * size[0]),
        at[1] + (q[1] * 0.498 * size[1]),
        at[2] + (q[2] * 0.498 + 0.5) * size[2],
      );
    }
    return seen.get(key);
  };
  for (let axis = 0; axis < 3; ++axis)
    for (const side of [0, n])
      for (let a = 0; a < n; ++a)
        for (let b = 0; b < n; ++b) {
          const corner = (da, db) => {
            const u = [0, 0, 0];
            u[axis] = side;
            u[(axis + 1) % 3] = a + da;
            u[(axis + 2) % 3] = b + db;
            return vertex(u);
          };
          const [p, q, r, s] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
          if (side) triangles.push(p, q, r, p, r, s);
          else triangles.push(p, r, q, p, s, r);
        }
  const vertexNodes = [];
  const weights = [];
  for (let v = 0; v < vertices.length; v += 3) {
    const g = [0, 1, 2].map((d) => {
      const low = d < 2 ? at[d] - size[d] / 2 : at[d];
      return Math.min(Math.max(((vertices[v + d] - low) / size[d]) * cells[d], 0), cells[d] - 1e-9);
    });
    const base = g.map(Math.floor);
    const f = g.map((x, d) => x - base[d]);
    // The six tetrahedra of a cube are the orders of f: walk from corner 0 along the largest coordinate first.
    const order = [0, 1, 2].sort((a, b) => f[b] - f[a]);
    const corner = [...base];
    vertexNodes.push(index(...corner));
    weights.push(1 - f[order[0]]);
    for (let k = 0; k < 3; ++k) {
      corner[order[k]] += 1;
      vertexNodes.push(index(...corner));
      weights.push(f[order[k]] - (k < 2 ? f[order[k + 1]] : 0));
    }
  }
  const held = [];
  for (let i = 2; i < nodes.length; i += 3) held.push(nodes[i] - at[2] >= heldAbove ? 1 : 0);
  return { nodes, held, tetrahedra, vertexNodes, weights, triangles, vertices: vertices.length / 3 };
}

/** A rigid ball: four nodes, one tetrahedron. */
function makeRigid(at, size) {
  const nodes = [...at, at[0] + size, at[1], at[2], at[0], at[1] + size, at[2], at[0], at[1], at[2] + size];
  const n = 24;
  const vertexNodes = [];
  const weights = [];
  const triangles = [];
  const ring = 2 * n;
  for (let i = 0; i <= n; ++i)
    for (let j = 0; j < ring; ++j) {
      const [a, b] = [(Math.PI * i) / n, (2 * Math.PI * j) / ring];
      const q = [Math.sin(a) * Math.cos(b), Math.sin(a) * Math.sin(b), Math.cos(a)];
      vertexNodes.push(0, 1, 2, 3);
      weights.push(1 - q[0] - q[1] - q[2], ...q);
      if (i < n) {
        const [p, s] = [i * ring + j, i * ring + ((j + 1) % ring)];
        triangles.push(p, p + ring, s, s, p + ring, s + ring);
      }
    }
  return { nodes, held: [0, 0, 0, 0], tetrahedra: [0, 1, 2, 3], vertexNodes, weights, triangles, vertices: weights.length / 4 };
}

// --- writing messages --------------------------------------------------------------------------------------------------

class Writer {
  parts = [];
  u32(...values) {
    this.parts.push(Buffer.from(Uint32Array.from(values).buffer));
    return this;
  }
  f32(values) {
    this.parts.push(Buffer.from(Float32Array.from(values).buffer));
    return this;
  }
  f64(value) {
    this.parts.push(Buffer.from(Float64Array.of(value).buffer));
    return this;
  }
  done() {
    return Buffer.concat(this.parts);
  }
}

export function geometryMessage(generation, bodies, obstacles) {
  const w = new Writer().u32(1, generation, bodies.length, obstacles.length);
  for (const b of bodies) {
    w.u32(b.nodes.length / 3, b.vertices, b.triangles.length / 3, b.tetrahedra.length / 4, b.flags);
    w.f32(b.nodes).f32(b.held).u32(...b.tetrahedra).u32(...b.vertexNodes).f32(b.weights).u32(...b.triangles);
  }
  for (const o of obstacles) {
    if (o.point) w.u32(0, 0, 0).f32(o.point).f32(o.normal);
    else w.u32(1, o.vertices.length / 3, o.triangles.length / 3).f32(o.vertices).u32(...o.triangles);
  }
  return w.done();
}

export function frameMessage(f) {
  return new Writer()
    .u32(2, f.generation, f.step, f.handSeq)
    .f64(f.time)
    .f32([...f.device, ...f.proxy, ...f.handle, ...f.wrench])
    .u32(f.flags ?? 0, f.nodes.length, f.contacts.length, f.stress.length)
    .f32(f.nodes)
    .f32(f.stress)
    .f32(f.contacts.flat())
    .done();
}

export function samplesMessage(generation, t0, ticks, steps, lost = 0) {
  const w = new Writer().u32(3, generation, ticks.length, steps.length, lost, 0).f64(t0);
  for (const t of ticks) w.f32(t.slice(0, 19)).u32(t[19]);
  for (const s of steps) w.f32(s);
  return w.done();
}

// --- the run -----------------------------------------------------------------------------------------------------------

const SCENES = [
  { name: 'bar', description: 'A soft bar stands on the ground. Hold it by its top and press it down.' },
  { name: 'bar-and-ball', description: 'The bar, a softer cushion and a rigid ball.' },
];
const mix = (a, b, t) => a + (b - a) * t;
const rotate = ([w, x, y, z], [a, b, c]) => {
  const [tx, ty, tz] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx];
};
const nlerp = (p, q, t) => {
  const sign = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3] < 0 ? -1 : 1;
  const r = p.map((x, i) => mix(x, sign * q[i], t));
  const length = Math.hypot(...r) || 1;
  return r.map((x) => x / length);
};

class Run {
  constructor() {
    this.generation = 0;
    this.settings = { method: 'hsl', handle: 'top', visual_step: 0.033, friction: 1, stiffness: 1, speed: 1, stress: false };
    this.start('bar');
  }

  start(name, title = null) {
    ++this.generation;
    this.placing = null;
    this.playedAt = 0;
    this.name = name;
    this.title = title ?? (name === 'bar' ? 'Soft bar' : 'Bar, cushion and ball');
    const handle = this.settings.handle;
    this.bodies = [{ ...makeBar({ heldAbove: handle === 'top' ? 0.105 : 0.06 }), flags: 1 }];
    if (name === 'bar-and-ball') {
      this.bodies.push({ ...makeBar({ size: [0.09, 0.09, 0.05], cells: [6, 6, 3], at: [0.11, 0.02, 0], heldAbove: 9, rounding: 3 }), flags: 0 });
      this.bodies.push({ ...makeRigid([-0.09, 0.03, 0.025], 0.025), flags: 2 });
    }
    this.rest = { position: [0, 0, handle === 'top' ? 0.128 : 0.105], rotation: [1, 0, 0, 0] };
    this.device = [...this.rest.position, ...this.rest.rotation];
    this.target = [...this.device];
    this.layers = Array.from({ length: 16 }, () => [...this.device]);
    this.velocity = [0, 0, 0];
    this.time = 0;
    this.step = 0;
    this.handSeq = 0;
    this.sinceStep = 1;
    this.driver = 'path';
    this.hand = null;
    this.handAt = 0;
    this.contacts = [];
    this.wrench = [0, 0, 0, 0, 0, 0];
    this.visualWrench = [0, 0, 0, 0, 0, 0];
    this.ticks = [];
    this.steps = [];
    this.nodes = this.bodies.flatMap((b) => b.nodes);
    this.stress = this.nodes.filter((_, i) => i % 3 === 0).map(() => 0);
    this.fresh = true;
  }

  /** A surface that waits, drawn as a ball whatever is in the file. */
  place(name, before) {
    this.start('surface', name);
    this.bodies = [{ ...makeRigid([0, 0, 0.075], 0.075), flags: 3 }];
    this.nodes = this.bodies[0].nodes;
    this.stress = [0, 0, 0, 0];
    this.placing = { name, extent: [0.08, 0.08, 0.08], size: 0.15 };
    this.before = before;
  }

  get motion() {
    return this.driver === 'path' && this.time - this.playedAt < 30 ? 'playing' : 'over';
  }

  tick(dt) {
    if (this.driver === 'path') {
      const t = this.time - this.playedAt;
      const s = 0.5 - 0.5 * Math.cos(t * 1.1);
      const [x, z, turn] = [0.03 * Math.sin(t * 0.8), 0.02 * Math.sin(t * 1.7) - 0.022 * s, 0.25 * Math.sin(t * 0.6)];
      this.target = [this.rest.position[0] + x, this.rest.position[1], this.rest.position[2] + z, Math.cos(turn / 2), 0, Math.sin(turn / 2), 0];
    }
    const before = this.device.slice(0, 3);
    for (let i = 0; i < 3; ++i) {
      const pull = (this.target[i] - this.device[i]) * 0.02;
      this.device[i] += Math.min(Math.max(pull, -0.002), 0.002);
    }
    this.device.splice(3, 4, ...nlerp(this.device.slice(3), this.target.slice(3), 0.02));
    for (let i = 0; i < 3; ++i) this.velocity[i] = mix(this.velocity[i], (this.device[i] - before[i]) / dt, 0.05);
    const press = this.rest.position[2] - this.device[2];
    const stiff = 400 * this.settings.stiffness;
    const push = press > 0 ? stiff * press : 0;
    const rub = push * 0.35 * this.settings.friction;
    const speed = Math.hypot(this.velocity[0], this.velocity[1]) + 1e-3;
    const noise = () => (Math.random() - 0.5) * 0.01;
    const exact = [
      (-rub * this.velocity[0]) / speed + noise(),
      (-rub * this.velocity[1]) / speed + noise(),
      push + noise(),
      0.02 * rub * this.velocity[1],
      -0.05 * rub * this.velocity[0] + 0.02 * this.device[5],
      0.002 * noise(),
    ];
    const vc = exact.map((f, i) => f - (i < 3 ? 25 * this.velocity[i] : 0));
    const raw = this.settings.method === 'vc' ? vc : exact;
    const length = Math.hypot(raw[0], raw[1], raw[2]);
    const scale = length > 3.3 ? 3.3 / length : 1;
    this.wrench = raw.map((f, i) => (i < 3 ? f * scale : f));
    this.ticks.push([this.time, ...this.wrench, ...raw, ...vc, scale < 1 ? 512 : 0]);
    this.time += dt;
    this.sinceStep += dt;
    if (this.sinceStep >= this.settings.visual_step) this.visualStep(push, raw);
  }

  visualStep(push, raw) {
    this.sinceStep = 0;
    ++this.step;
    this.visualWrench = raw;
    this.layers[15] = [...this.device];
    for (let k = 14; k >= 0; --k) {
      const a = 0.9 / (1 + (15 - k) * 0.12);
      const up = this.layers[k + 1];
      const own = this.layers[k];
      this.layers[k] = [
        ...[0, 1, 2].map((i) => mix(own[i], up[i], a)),
        ...nlerp(own.slice(3), up.slice(3), a),
      ];
    }
    const contacts = [];
    const nodes = [];
    const stress = [];
    this.bodies.forEach((body, b) => {
      for (let i = 0; i < body.nodes.length; i += 3) {
        const rest = body.nodes.slice(i, i + 3);
        let p = rest;
        let strain = 0;
        if (b === 0) {
          const k = Math.min(15, Math.max(0, Math.round((rest[2] / 0.11) * 15)));
          const pose = this.layers[body.held[i / 3] ? 15 : k];
          const r = rotate(pose.slice(3), rest.map((x, d) => x - this.rest.position[d]));
          p = r.map((x, d) => x + pose[d]);
          const sink = Math.max(0, this.rest.position[2] - pose[2]);
          if (!body.held[i / 3] && sink > 0) {
            // Squeezed between the handle and the ground, and bulging.
            const f = rest[2] / 0.105;
            p[2] = Math.max(0, rest[2] - sink * f);
            const bulge = 1 + 14 * sink * 4 * f * (1 - f);
            p[0] = pose[0] + (p[0] - pose[0]) * bulge;
            p[1] = pose[1] + (p[1] - pose[1]) * bulge;
            strain = sink * (1.2 - Math.abs(f - 0.5)) * 3e5;
          }
          if (p[2] < 0) p[2] = 0;
          if (rest[2] === 0 && p[2] <= 1e-6 && push > 0 && contacts.length < 25) {
            contacts.push([...p, 0, 0, 1, raw[0] / 25, raw[1] / 25, push / 25, Math.hypot(this.velocity[0], this.velocity[1]) > 0.02 ? 2 : 1]);
          } else if (rest[2] === 0 && p[2] < 0.002) {
            contacts.push([...p, 0, 0, 1, 0, 0, 0, 0]);
          }
        }
        nodes.push(...p);
        stress.push(strain);
      }
    });
    this.nodes = nodes;
    this.stress = stress;
    this.contacts = contacts;
    this.fresh = true;
    const ms = 4 + contacts.length * 0.1 + Math.random();
    const active = contacts.filter((c) => c[9] > 0).length;
    this.steps.push([
      this.time, ...raw, ms, ms * 0.3, ms * 0.25, ms * 0.1, ms * 0.2, ms * 0.05, ms * 0.1, 0.1,
      contacts.length, contacts.length, active, active, 0, 7, 1e-6, 1e-5,
      2e-4 * Math.hypot(...this.velocity), 1e-2 * push * push, 0, 1, 0,
    ]); // prettier-ignore
  }

  takeMessages(withNodes) {
    const nodes = this.fresh || withNodes;
    this.fresh = false;
    const frame = frameMessage({
      generation: this.generation,
      step: this.step,
      handSeq: this.handSeq,
      time: this.time,
      device: this.device,
      proxy: this.device.map((x, i) => (i === 2 ? Math.max(x, mix(x, this.rest.position[2], 0.15)) : x)),
      handle: this.layers[15],
      wrench: this.wrench,
      nodes: nodes ? this.nodes : [],
      contacts: nodes ? this.contacts : [],
      stress: nodes && this.settings.stress ? this.stress : [],
    });
    let samples = null;
    if (this.ticks.length + this.steps.length > 0) {
      const t0 = this.ticks[0]?.[0] ?? this.steps[0][0];
      for (const row of this.ticks) row[0] -= t0;
      for (const row of this.steps) row[0] -= t0;
      samples = samplesMessage(this.generation, t0, this.ticks, this.steps);
      this.ticks = [];
      this.steps = [];
    }
    return { frame, samples };
  }

  sceneMessage(scenes = SCENES) {
    return {
      type: 'scene',
      generation: this.generation,
      name: this.name,
      title: this.title,
      description: scenes.find((s) => s.name === this.name)?.description ?? 'A surface from a file.',
      scenes,
      handles: ['top', 'upper half'],
      methods: ['hsl', 'hsl-exact', 'vc'],
      bodies: this.bodies.map((b, i) => ({
        name: i ? ['', 'cushion', 'ball'][i] : 'bar',
        kind: b.flags & 1 ? 'tool' : b.flags & 2 ? 'rigid' : 'soft',
        youngs_modulus: 2e4 * this.settings.stiffness,
        tetrahedra: b.tetrahedra.length / 4,
        triangles: b.triangles.length / 3,
      })),
      obstacles: [{ name: 'ground' }],
      device: { peak_force: 3.3, peak_torque: 0.2, stiffness: 300, workspace_radius: 0.1 },
      gravity: [0, 0, -9.81],
      haptic_step: 0.001,
      start: this.rest,
    };
  }

  geometry() {
    return geometryMessage(this.generation, this.bodies, [{ point: [0, 0, 0], normal: [0, 0, 1] }]);
  }
}

/** A recording of the synthetic run, as `recording.palpate`. */
export function recording(seconds) {
  const run = new Run();
  const parts = [Buffer.from('PALPATE1')];
  const record = (payload) => {
    const text = typeof payload === 'string';
    const bytes = Buffer.from(payload);
    parts.push(Buffer.from(Uint32Array.of(text ? 0 : 1, bytes.length).buffer), bytes, Buffer.alloc((8 - (bytes.length % 8)) % 8));
  };
  run.settings.stress = true;
  record(JSON.stringify(run.sceneMessage()));
  record(run.geometry());
  record(JSON.stringify(stateOf(run, { paused: false, recording: null, viewers: 0 })));
  for (let k = 0; k < seconds * 1000; ++k) {
    run.tick(0.001);
    if (run.fresh) {
      const { frame, samples } = run.takeMessages(true);
      record(frame);
      record(samples);
    }
  }
  return Buffer.concat(parts);
}

function stateOf(run, { paused, recording, viewers, busy = null }) {
  return {
    type: 'state', generation: run.generation, ...run.settings, paused, hand: run.hand, driver: run.driver, recording, busy, viewers,
    motion: run.motion, placing: run.placing,
  }; // prettier-ignore
}

// --- the server --------------------------------------------------------------------------------------------------------

export async function startMock({ dir, port = 0, replay = false } = {}) {
  const run = new Run();
  const viewers = new Map();
  let nextViewer = 1;
  let paused = false;
  let recordingTo = null;
  let busy = null;
  let recorded = null;
  const types = { '.html': 'text/html; charset=utf-8', '.js': 'text/javascript', '.css': 'text/css', '.svg': 'image/svg+xml' };
  const server = createServer(async (request, response) => {
    const url = new URL(request.url, 'http://localhost');
    const send = (status, type, body) => {
      response.writeHead(status, { 'content-type': type, 'content-security-policy': CSP, 'x-content-type-options': 'nosniff' });
      response.end(body);
    };
    const path = url.pathname === '/' ? '/index.html' : url.pathname;
    if (path === '/session.json') {
      send(200, 'application/json', JSON.stringify({ mode: replay ? 'replay' : 'view', protocol: 1, version: 'mock', name: 'bar', max_surface_bytes: 1 << 26 }));
    } else if (path === '/recording' && replay) {
      send(200, 'application/octet-stream', (recorded ??= recording(8)));
    } else if (path === '/surface' && request.method === 'POST') {
      const chunks = [];
      for await (const chunk of request) chunks.push(chunk);
      const text = Buffer.concat(chunks).toString('latin1');
      if (!/^(v |solid|ply|OFF)/m.test(text)) {
        send(422, 'application/json', JSON.stringify({ error: 'This file has no triangles.' }));
        return;
      }
      send(202, 'application/json', '{}');
      const name = url.searchParams.get('name') ?? 'surface';
      busy = 'Reading the surface';
      everyone(stateNow());
      setTimeout(() => {
        busy = null;
        if (url.searchParams.get('place') === '1') run.place(name, run.before ?? run.name);
        else run.start('surface', name);
        announce();
      }, 800);
    } else if (['/index.html', '/app.js', '/app.css', '/icon.svg'].includes(path)) {
      try {
        send(200, types[path.slice(path.lastIndexOf('.'))], await readFile(join(dir, path)));
      } catch {
        send(404, 'text/plain', 'not built');
      }
    } else {
      send(404, 'text/plain', 'no such page');
    }
  });
  const sockets = new WebSocketServer({ server, path: '/ws', maxPayload: 4096, perMessageDeflate: false });
  const stateNow = () => stateOf(run, { paused, recording: recordingTo, viewers: viewers.size, busy });
  const everyone = (message) => {
    const data = Buffer.isBuffer(message) ? message : JSON.stringify(message);
    for (const viewer of viewers.values()) viewer.socket.send(data);
  };
  const announce = () => {
    everyone(run.sceneMessage());
    everyone(run.geometry());
    everyone(stateNow());
    for (const viewer of viewers.values()) viewer.needsNodes = true;
  };
  sockets.on('connection', (socket) => {
    const number = nextViewer++;
    viewers.set(number, { socket, unanswered: 0, needsNodes: true });
    const reply = (m) => socket.send(JSON.stringify(m));
    reply({ type: 'welcome', protocol: 1, viewer: number, version: 'mock' });
    reply(run.sceneMessage());
    socket.send(run.geometry());
    everyone(stateNow());
    socket.on('message', (data) => {
      const m = JSON.parse(data.toString());
      const own = run.hand === number;
      switch (m.type) {
        case 'ack':
          viewers.get(number).unanswered = 0;
          return;
        case 'hand':
          if (own) {
            run.handSeq = m.seq;
            run.handAt = Date.now();
            run.target = [...m.position, ...m.rotation];
          }
          return;
        case 'take':
          if (!own && run.hand !== null && Date.now() - run.handAt < 2000) {
            reply({ type: 'notice', level: 'error', text: 'Another viewer holds the tool.' });
            return;
          }
          run.hand = number;
          run.handAt = Date.now();
          run.driver = 'hand';
          run.target = [...run.device];
          break;
        case 'release':
          if (own) run.hand = null;
          break;
        case 'play':
          run.driver = 'path';
          run.playedAt = run.time;
          run.hand = null;
          break;
        case 'pause':
          paused = true;
          break;
        case 'resume':
          paused = false;
          break;
        case 'step':
          if (paused) for (let k = 0; k < Math.round(run.settings.visual_step * 1000); ++k) run.tick(0.001);
          return;
        case 'reset':
          run.start(run.name, run.title);
          announce();
          return;
        case 'scene':
          run.start(m.name);
          announce();
          return;
        case 'place':
        case 'cancel':
          if (!run.placing) {
            reply({ type: 'notice', level: 'error', text: 'no surface waits to be placed' });
            return;
          }
          if (m.type === 'cancel') run.start(run.before);
          else run.start('surface', run.placing.name);
          if (m.type === 'place') reply({ type: 'notice', level: 'info', text: '960 tetrahedra, 275 nodes, 75 of them in the handle' });
          run.before = null;
          announce();
          return;
        case 'save':
          reply({ type: 'saved', name: `${run.name}.yaml`, text: `palpate: 1\nname: ${run.name}\nmethod: ${run.settings.method}\n` });
          return;
        case 'record':
          recordingTo = m.on ? 'out/view-1' : null;
          break;
        case 'set': {
          const { type: _, ...settings } = m;
          const changed = settings.handle !== undefined && settings.handle !== run.settings.handle;
          if (settings.visual_step !== undefined && !(settings.visual_step >= 0.001 && settings.visual_step <= 0.2)) {
            reply({ type: 'notice', level: 'error', text: 'visual_step must lie between 0.001 and 0.2 s' });
            break;
          }
          Object.assign(run.settings, settings);
          if (changed) {
            run.start(run.name, run.title);
            announce();
            return;
          }
          break;
        }
      }
      everyone(stateNow());
    });
    socket.on('close', () => {
      viewers.delete(number);
      if (run.hand === number) run.hand = null;
      everyone(stateNow());
    });
  });
  let last = performance.now();
  let due = 0;
  const pump = setInterval(() => {
    const now = performance.now();
    if (!paused && !run.placing) due += Math.min(now - last, 100) * run.settings.speed;
    last = now;
    for (; due >= 1; --due) run.tick(0.001);
    if (viewers.size === 0) {
      run.ticks = [];
      run.steps = [];
      return;
    }
    const anyNeeds = [...viewers.values()].some((v) => v.needsNodes);
    const { frame, samples } = run.takeMessages(anyNeeds);
    for (const viewer of viewers.values()) {
      if (samples) viewer.socket.send(samples);
      if (viewer.unanswered < 3) {
        viewer.socket.send(frame);
        ++viewer.unanswered;
        viewer.needsNodes = false;
      } else {
        viewer.needsNodes = true;
      }
    }
  }, 16);
  const stats = setInterval(() => {
    const bins = (scale) => Array.from({ length: 24 }, (_, i) => [scale * 1.5 ** (i - 8), Math.round(4000 * Math.exp(-((i - 9) ** 2) / 9))]);
    everyone({
      type: 'stats', ticks: Math.round(run.time * 1000), missed: 0, dropped: 0,
      tick_us: { p50: 0.9, p99: 1.8, max: 24, bins: bins(1) }, wake_us: { p50: 55, p99: 130, max: 900, bins: bins(50) },
      energy_J: 0.0123, realtime: 'SCHED_FIFO refused: Operation not permitted', server_share: 0.03,
    }); // prettier-ignore
  }, 500);
  await new Promise((done) => server.listen(port, '127.0.0.1', done));
  return {
    url: `http://127.0.0.1:${server.address().port}/`,
    async stop() {
      clearInterval(pump);
      clearInterval(stats);
      for (const viewer of viewers.values()) viewer.socket.terminate();
      sockets.close();
      server.closeAllConnections();
      await new Promise((done) => server.close(done));
    },
  };
}

if (process.argv[1] && resolve(process.argv[1]) === fileURLToPath(import.meta.url)) {
  const { values } = parseArgs({
    options: {
      port: { type: 'string', default: '0' },
      dir: { type: 'string', default: join(here, '../dist') },
      replay: { type: 'boolean', default: false },
      watch: { type: 'boolean', default: false },
    },
  });
  if (values.watch) {
    const { watch } = await import('node:fs');
    const again = () => buildPage(values.dir, { minify: false }).catch((error) => console.error(error.message));
    await again();
    let pending = null;
    watch(join(here, '../src'), () => {
      clearTimeout(pending);
      pending = setTimeout(again, 100);
    });
  }
  const mock = await startMock({ dir: values.dir, port: Number(values.port), replay: values.replay });
  console.log(mock.url);
}
