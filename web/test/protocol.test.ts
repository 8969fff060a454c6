import assert from 'node:assert/strict';
import { test } from 'node:test';
import { tiedNodes, toolIsTied } from '../src/attached.ts';
import { decodeBinary, decodeRecording, decodeText, encodeCommand } from '../src/protocol.ts';
import { Replay } from '../src/replay.ts';
import { frameBytes, geometryBytes, recordingBytes, samplesBytes, sceneText, tickRow } from './bytes.ts';

/** Deterministic, so that a failure comes back. */
function random(seed: number): () => number {
  let state = seed >>> 0;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

test('geometry', () => {
  const g = decodeBinary(geometryBytes());
  assert.ok(g.type === 'geometry');
  assert.equal(g.generation, 7);
  const body = g.bodies[0]!;
  assert.deepEqual([...body.nodes], [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1]);
  assert.deepEqual([...body.held], [0, 0, 0, 1]);
  assert.deepEqual([...body.tetrahedra], [0, 1, 2, 3]);
  assert.deepEqual([...body.vertexWeights.subarray(0, 4)], [0.25, 0.25, 0.25, 0.25]);
  assert.deepEqual([...body.triangles], [0, 1, 2]);
  assert.ok(body.tool && !body.rigid);
  assert.deepEqual(g.obstacles[0], { shape: 'plane', point: [0, 0, -1], normal: [0, 0, 1] });
  const surface = g.obstacles[1]!;
  assert.ok(surface.shape === 'surface');
  assert.equal(surface.vertices.length, 9);
});

test('frame', () => {
  const f = decodeBinary(frameBytes());
  assert.ok(f.type === 'frame');
  assert.equal(f.step, 45);
  assert.equal(f.handSeq, 12);
  assert.equal(f.time, 1.5);
  assert.equal(f.flags, 512);
  assert.deepEqual(f.device.rotation, [1, 0, 0, 0]);
  assert.ok(Math.abs(f.handle.position[2] - 0.3) < 1e-7);
  assert.deepEqual([...f.wrench.subarray(0, 3)], [1, 2, 3]);
  assert.equal(f.nodes.length, 12);
  assert.deepEqual([...f.stress], [10, 20, 30, 40]);
  assert.equal(f.contacts[8], 2);
});

test('samples', () => {
  const step = Array.from({ length: 28 }, (_, i) => i);
  const s = decodeBinary(samplesBytes(2, [tickRow(0, 1, 0xffffffff), tickRow(0.001, 2)], [step], 3));
  assert.ok(s.type === 'samples');
  assert.equal(s.lost, 3);
  assert.equal(s.tickCount, 2);
  assert.equal(s.tickBits[19], 0xffffffff);
  assert.equal(s.ticks[20 + 1], 2);
  assert.equal(s.steps[27], 27);
});

test('a message cut anywhere is invalid and says why', () => {
  for (const whole of [geometryBytes(), frameBytes(), samplesBytes(0, [tickRow(0, 1)], [Array(28).fill(0) as number[]])]) {
    assert.notEqual(decodeBinary(whole).type, 'invalid');
    for (let size = 0; size < whole.byteLength; ++size) {
      const cut = decodeBinary(whole.slice(0, size));
      assert.ok(cut.type === 'invalid' && cut.reason.length > 0, `${size} of ${whole.byteLength} bytes`);
    }
  }
});

test('garbage never throws', () => {
  const next = random(1);
  for (let k = 0; k < 3000; ++k) {
    const bytes = new Uint8Array(Math.floor(next() * 200));
    for (let i = 0; i < bytes.length; ++i) bytes[i] = Math.floor(next() * 256);
    if (bytes.length > 4) bytes.set([1 + (k % 3), 0, 0, 0]);
    decodeBinary(bytes.buffer);
    decodeText(String.fromCharCode(...bytes));
  }
  for (const whole of [geometryBytes(), frameBytes(), samplesBytes(0, [tickRow(0, 1)], [])]) {
    for (let k = 0; k < 3000; ++k) {
      const bytes = new Uint8Array(whole.slice(0));
      for (let flips = 0; flips < 4; ++flips) bytes[Math.floor(next() * bytes.length)] = Math.floor(next() * 256);
      decodeBinary(bytes.buffer);
    }
  }
  for (const source of ['', '{', '[]', 'null', '7', '{"type":1}', '{"type":"scene","scenes":{},"bodies":[1,null]}']) {
    assert.ok(decodeText(source).type !== undefined);
  }
});

test('counts larger than the message make no arrays', () => {
  const bytes = new Uint8Array(geometryBytes());
  bytes.set([255, 255, 255, 255], 16);
  assert.equal(decodeBinary(bytes.buffer).type, 'invalid');
});

test('indices out of range and values not finite are refused', () => {
  const node = new Uint8Array(geometryBytes());
  node.set([9, 0, 0, 0], 16 + 20 + 48 + 16); // first node of the tetrahedron
  assert.equal(decodeBinary(node.buffer).type, 'invalid');
  const nan = new Uint8Array(frameBytes());
  nan.set([0, 0, 192, 127], 24);
  assert.equal(decodeBinary(nan.buffer).type, 'invalid');
});

test('text messages keep to what the manual says and stand what it does not', () => {
  const scene = decodeText(sceneText());
  assert.ok(scene.type === 'scene');
  assert.equal(scene.device.peakForce, 3.3);
  assert.equal(scene.bodies[0]!.youngsModulus, 2e4);
  assert.deepEqual(scene.bodies[0]!.attachments, []);
  const state = decodeText('{"type":"state","visual_step":0.02,"hand":3,"recording":null,"busy":"meshing","driver":"hand"}');
  assert.ok(state.type === 'state');
  assert.equal(state.visualStep, 0.02);
  assert.equal(state.hand, 3);
  assert.equal(state.busy, 'meshing');
  const stats = decodeText('{"type":"stats","tick_us":{"p50":1,"bins":[[1,2],[2,3],["x"]]}}');
  assert.ok(stats.type === 'stats');
  assert.deepEqual(stats.tickUs.bins, [
    [1, 2],
    [2, 3],
  ]);
});

test('commands', () => {
  assert.equal(encodeCommand({ type: 'ack', frame: 3 }), '{"type":"ack","frame":3}');
  assert.equal(encodeCommand({ type: 'hand', seq: 1, position: [NaN, 0, 0], rotation: [1, 0, 0, 0] }), null);
  assert.equal(encodeCommand({ type: 'scene', name: 'x'.repeat(5000) }), null);
});

const state = JSON.stringify({ type: 'state', generation: 7, handle: 'tip', method: 'hsl' });
const run = [
  sceneText(),
  geometryBytes(),
  state,
  frameBytes(0.1, 1),
  samplesBytes(0, [tickRow(0.1, 1), tickRow(0.15, 5)], []),
  frameBytes(0.2, 2),
];

test('recording', () => {
  const recording = decodeRecording(recordingBytes(run));
  assert.ok('messages' in recording);
  assert.equal(recording.complaint, null);
  assert.deepEqual(
    recording.messages.map((m) => m.type),
    ['scene', 'geometry', 'state', 'frame', 'samples', 'frame'],
  );
  assert.ok('type' in decodeRecording(new ArrayBuffer(3)));
  const whole = recordingBytes(run);
  for (let size = 8; size < whole.byteLength; size += 5) {
    const cut = decodeRecording(whole.slice(0, size));
    assert.ok('messages' in cut);
  }
});

test('attachments: kinds, and nodes that there are', () => {
  const json = JSON.parse(sceneText()) as { bodies: Record<string, unknown>[] };
  json.bodies[0]!['attachments'] = [
    { name: 'root', kind: 'fixed', nodes: [0, -1, 1.5, 'x', 2] },
    { name: 'seam', kind: 'glued', nodes: [2, 9], to: 'organ' },
    { name: 'ligament', kind: 'springs', nodes: [3] },
    null,
    { name: 'of tomorrow', kind: 'magnet' },
  ];
  const scene = decodeText(JSON.stringify(json));
  assert.ok(scene.type === 'scene');
  const { attachments } = scene.bodies[0]!;
  assert.deepEqual(
    attachments.map((a) => [a.name, a.kind, a.nodes, a.to]),
    [
      ['root', 'fixed', [0, 2], ''],
      ['seam', 'glued', [2, 9], 'organ'],
      ['ligament', 'springs', [3], ''],
      ['of tomorrow', 'fixed', [], ''],
    ],
  );
  const [tool] = scene.bodies;
  const organ = { ...tool!, name: 'organ', kind: 'soft' as const };
  assert.ok(toolIsTied(scene.bodies));
  assert.ok(!toolIsTied([{ ...tool!, attachments: [] }, organ]));
  assert.ok(toolIsTied([{ ...tool!, attachments: [] }, { ...organ, attachments: [{ ...attachments[1]!, to: 'tool' }] }]));
  assert.deepEqual([...tiedNodes(attachments, 4)], [1, 0, 0, 0, 0, 0, 1, 0, 1, 0, 1, 0]);
});

test('replay: the frames around a time, and time that rises over a second scene', () => {
  const replay = Replay.read(recordingBytes([...run, sceneText(8), geometryBytes(8), frameBytes(0, 1, 8), frameBytes(0.5, 2, 8)]));
  assert.ok(typeof replay !== 'string');
  assert.equal(replay.parts.length, 2);
  replay.seek(0.125);
  const moment = replay.moment()!;
  assert.equal(moment.part, 0);
  assert.equal(moment.a.step, 1);
  assert.ok(Math.abs(moment.t - 0.25) < 1e-6);
  const wrench = new Float32Array(6);
  replay.wrench(moment.a, wrench);
  assert.equal(wrench[0], 1);
  replay.seek(0.45);
  assert.equal(replay.moment()!.part, 1);
  assert.ok(Math.abs(replay.end - 0.7) < 1e-9);
  assert.equal(typeof Replay.read(recordingBytes([sceneText()])), 'string');
});
