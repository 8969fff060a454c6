import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Track, decimate } from '../src/history.ts';
import { decodeBinary } from '../src/protocol.ts';
import { RunHistory, TICKS, stepTable, tickTable } from '../src/run_history.ts';
import { samplesBytes, tickRow } from './bytes.ts';

const noise = (i: number): number => Math.sin(i * 12.9898) * 43758.5453 - Math.floor(Math.sin(i * 12.9898) * 43758.5453);

function filled(rows: number, value: (i: number) => number): Track {
  const track = new Track(1, 1e7);
  for (let i = 0; i < rows; ++i) track.append(i * 0.001, [value(i)]);
  return track;
}

test('extrema over any range are those of the rows', () => {
  const track = filled(40_000, noise);
  const out: [number, number] = [0, 0];
  for (const [from, to] of [[0, 40_000], [5, 70], [63, 65], [16_000, 17_000], [100, 100], [16_384, 32_768]] as const) {
    track.extrema(0, from, to, out);
    let low = Infinity;
    let high = -Infinity;
    for (let i = from; i < to; ++i) {
      low = Math.min(low, track.value(0, i));
      high = Math.max(high, track.value(0, i));
    }
    assert.deepEqual(out, [low, high]);
  }
});

test('decimation loses no extremum', () => {
  const spike = 12_345;
  const track = filled(60_000, (i) => (i === spike ? 100 : i === spike + 1 ? -100 : noise(i)));
  const out = new Float32Array(5 * 4096);
  for (const pixels of [50, 333, 800]) {
    for (const [t0, t1] of [[0, 60], [10, 20], [12.3, 12.4]] as const) {
      const n = decimate(track, 0, t0, t1, pixels, out);
      assert.ok(n > 0 && n % 5 === 0);
      let low = Infinity;
      let high = -Infinity;
      for (let i = 0; i < n; i += 5) {
        low = Math.min(low, out[i + 2]!);
        high = Math.max(high, out[i + 3]!);
        assert.ok(out[i + 2]! <= out[i + 1]! && out[i + 1]! <= out[i + 3]!);
        assert.ok(out[i + 2]! <= out[i + 4]! && out[i + 4]! <= out[i + 3]!);
      }
      assert.equal(low, -100);
      assert.equal(high, 100);
    }
  }
});

test('few rows keep their places', () => {
  const track = filled(5, (i) => i);
  const out = new Float32Array(5 * 100);
  const n = decimate(track, 0, 0, 0.005, 100, out);
  assert.equal(n, 25);
  for (let i = 0; i < 5; ++i) assert.ok(Math.abs(out[5 * i]! - 20 * i) < 1e-3);
});

test('the oldest rows go first', () => {
  const track = new Track(1, 2 * 16_384);
  for (let i = 0; i < 100_000; ++i) track.append(i, [i]);
  assert.equal(track.length, 100_000);
  assert.ok(track.first >= 100_000 - 2 * 16_384);
  assert.equal(track.value(0, 99_999), 99_999);
  assert.equal(track.value(0, track.first), track.first);
  assert.equal(track.indexAt(90_000.5), 90_001);
});

test('history and its tables', () => {
  const history = new RunHistory();
  const step = Array.from({ length: 28 }, (_, i) => i / 8);
  for (const [t0, lost] of [[0, 0], [0.5, 4]] as const) {
    const message = decodeBinary(samplesBytes(t0, [tickRow(0, 1, 512), tickRow(0.001, 2)], [step], lost));
    assert.ok(message.type === 'samples');
    history.append(message);
  }
  assert.equal(history.received, 4);
  assert.equal(history.lost, 4);
  assert.ok(Math.abs(history.ticks.value(TICKS.sentForce, 0) - Math.hypot(1, 2, 3)) < 1e-6);
  const lines = tickTable(history).join('').trimEnd().split('\n');
  assert.equal(lines.length, 5); // the gap is no row
  assert.equal(lines[0]!.split(',').length, 20);
  assert.equal(lines[1], '0,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,512');
  assert.equal(lines[4]!.split(',')[0], '0.501');
  const steps = stepTable(history).join('').trimEnd().split('\n');
  assert.equal(steps.length, 3);
  assert.equal(steps[0]!.split(',').length, steps[1]!.split(',').length);
  assert.equal(steps[1]!.split(',')[1], '0.125');
});

test('CSV gives back the f32 that came', () => {
  const history = new RunHistory();
  const value = Math.fround(0.1234567891);
  const message = decodeBinary(samplesBytes(0, [{ values: [0, ...Array<number>(18).fill(value)], flags: 0 }], []));
  assert.ok(message.type === 'samples');
  history.append(message);
  const cell = tickTable(history).join('').split('\n')[1]!.split(',')[1]!;
  assert.equal(Math.fround(Number(cell)), value);
});
