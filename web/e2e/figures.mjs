// What a viewer costs and how late it sees its own hand, without a browser's drawing:
//   node e2e/figures.mjs --program ../build/release/palpate --scene ../scenes/bunnies.yaml [--seconds 15]
// A viewer that reads and acknowledges every frame takes the hand and moves it 60 times a second.
import { parseArgs } from 'node:util';
import WebSocket from 'ws';
import { programServers } from './harness.mjs';

const KIND_FRAME = 2;
const KIND_SAMPLES = 3;
const NODE_VALUES = 24 + 4 * (3 * 7 + 6 + 1); // offset of a frame's count of node values
const SETTLE_S = 3;

const { values: options } = parseArgs({
  options: { program: { type: 'string' }, scene: { type: 'string' }, seconds: { type: 'string', default: '15' } },
});
const server = await programServers(options).running();
const socket = new WebSocket(new URL('ws', server.url).href.replace('http', 'ws'), { origin: new URL(server.url).origin });
const counts = { frames: 0, withNodes: 0, bytes: 0, lost: 0 };
const shares = [];
const delays = [];
const underway = new Map(); // sequence of a hand message -> when it was sent [ms]
let start;
let measuring = false;

socket.on('message', (data, binary) => {
  if (!binary) {
    const message = JSON.parse(data);
    if (message.type === 'scene') start = message.start;
    if (message.type === 'stats' && measuring) shares.push(message.server_share);
    return;
  }
  if (measuring) counts.bytes += data.length;
  const kind = data.readUInt32LE(0);
  if (kind === KIND_SAMPLES && measuring) counts.lost += data.readUInt32LE(16);
  if (kind !== KIND_FRAME) return;
  if (measuring) {
    ++counts.frames;
    counts.withNodes += data.readUInt32LE(NODE_VALUES) > 0 ? 1 : 0;
  }
  const taken = data.readUInt32LE(12);
  for (const [sequence, sent] of underway) {
    if (sequence > taken) continue;
    delays.push(performance.now() - sent);
    underway.delete(sequence);
  }
  socket.send(JSON.stringify({ type: 'ack', frame: data.readUInt32LE(8) }));
});
await new Promise((resolve, reject) => socket.once('open', resolve).once('error', reject));

const wait = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));
await wait(SETTLE_S);
socket.send('{"type":"take"}');
measuring = true;
let sequence = 0;
const hand = setInterval(() => {
  const [x, y, z] = start.position;
  underway.set(++sequence, performance.now());
  socket.send(JSON.stringify({ type: 'hand', seq: sequence, position: [x + 0.01 * Math.sin(sequence / 20), y, z], rotation: start.rotation }));
}, 16);
const seconds = Number(options.seconds);
await wait(seconds);
clearInterval(hand);
socket.terminate();
await server.stop();

const percentile = (values, share) => [...values].sort((a, b) => a - b)[Math.floor(share * (values.length - 1))] ?? NaN;
console.log(`frames a second         ${(counts.frames / seconds).toFixed(1)}, with nodes ${(counts.withNodes / seconds).toFixed(1)}`);
console.log(`kB a second             ${(counts.bytes / seconds / 1000).toFixed(0)}`);
console.log(`ticks lost              ${counts.lost}`);
console.log(`server, share of a core ${(100 * percentile(shares, 0.5)).toFixed(1)} %, at most ${(100 * percentile(shares, 1)).toFixed(1)} %`);
console.log(`hand to frame, ms       ${percentile(delays, 0.5).toFixed(1)}, 95 % ${percentile(delays, 0.95).toFixed(1)}`);
