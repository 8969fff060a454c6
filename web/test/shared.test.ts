// What the page and the program are both held to: see tests/protocol/shared_messages_test.cpp, which writes and checks
// messages.json. PALPATE_WRITE_PROTOCOL=1 makes this test write commands.json.
import assert from 'node:assert/strict';
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import {
  CONTACT,
  CONTACT_STRIDE,
  STEP,
  STEP_STRIDE,
  TICK,
  TICK_STRIDE,
  decodeBinary,
  decodeSession,
  decodeText,
  encodeCommand,
  type BinaryMessage,
  type Command,
  type Frame,
  type Quat,
  type Samples,
  type Settings,
} from '../src/protocol.ts';

// Tests run from the folder of package.json.
const path = (name: string): string => join(process.cwd(), 'test', name);
const read = (name: string): unknown => JSON.parse(readFileSync(path(name), 'utf8'));

interface Messages {
  session: string;
  texts: string[];
  binary: { bytes: string; fields: Record<string, unknown> }[];
}
const messages = read('messages.json') as Messages;

/** A value with the page's names: keys as the program's, but for capitals in place of underscores. */
function named(value: unknown): unknown {
  if (Array.isArray(value)) return value.map(named);
  if (typeof value !== 'object' || value === null) return value;
  return Object.fromEntries(
    Object.entries(value).map(([key, item]) => [key.replace(/_([a-zA-Z])/g, (_, c: string) => c.toUpperCase()), named(item)]),
  );
}

/** Rows of numbers as objects by column; a column reaches to the next one. */
function rows(values: Float32Array, stride: number, columns: Record<string, number>, bits?: Uint32Array): unknown[] {
  const names = Object.keys(columns);
  return Array.from({ length: values.length / stride }, (_, row) =>
    Object.fromEntries(
      names.map((name, k) => {
        const from = row * stride + columns[name]!;
        const to = row * stride + (columns[names[k + 1] ?? ''] ?? stride);
        const source = bits && name === 'flags' ? bits : values;
        return [name, to - from === 1 ? source[from] : Array.from(source.subarray(from, to))];
      }),
    ),
  );
}

/** What was decoded, arrays as plain ones and rows by column. */
function plain(message: BinaryMessage): unknown {
  if (message.type === 'frame') {
    const { contacts, ...rest } = message satisfies Frame;
    return lists({ ...rest, contacts: rows(contacts, CONTACT_STRIDE, CONTACT) });
  }
  if (message.type === 'samples') {
    const { ticks, tickBits, steps, tickCount, stepCount, ...rest } = message satisfies Samples;
    assert.equal(ticks.length, tickCount * TICK_STRIDE);
    assert.equal(steps.length, stepCount * STEP_STRIDE);
    return { ...rest, ticks: rows(ticks, TICK_STRIDE, TICK, tickBits), steps: rows(steps, STEP_STRIDE, STEP) };
  }
  return lists(message);
}

function lists(value: unknown): unknown {
  if (ArrayBuffer.isView(value)) return Array.from(value as Float32Array);
  if (Array.isArray(value)) return value.map(lists);
  if (typeof value !== 'object' || value === null) return value;
  return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, lists(item)]));
}

// Field by field, neither more nor less than what the program says.
test('the page reads what the program writes: text', () => {
  for (const text of messages.texts) assert.deepEqual(decodeText(text), named(JSON.parse(text)));
  assert.deepEqual(decodeSession(JSON.parse(messages.session)), named(JSON.parse(messages.session)));
});

test('the page reads what the program writes: binary', () => {
  for (const { bytes, fields } of messages.binary) {
    const buffer = Uint8Array.from(bytes.match(/../g)!.map((digits) => parseInt(digits, 16))).buffer;
    assert.deepEqual(plain(decodeBinary(buffer)), named(fields));
  }
});

test('every kind of message is among them', () => {
  const kinds = messages.texts.map((text) => (JSON.parse(text) as { type: string }).type);
  assert.deepEqual([...new Set(kinds)].sort(), ['notice', 'saved', 'scene', 'state', 'stats', 'welcome']);
  assert.deepEqual([...new Set(messages.binary.map((m) => m.fields['type']))], ['geometry', 'frame', 'samples']);
});

// One of every kind, with every setting: the types demand it.
const settings: Required<Settings> = {
  method: 'vc',
  handle: 'top',
  visual_step: 0.02,
  friction: 0,
  stiffness: 3,
  speed: 0.1,
  stress: true,
};
const commands: { [T in Command['type']]: Command & { type: T } } = {
  hand: { type: 'hand', seq: 4294967295, position: [0.25, -0.5, 0.125], rotation: [0.5, 0.5, -0.5, 0.5] },
  take: { type: 'take' },
  release: { type: 'release' },
  play: { type: 'play' },
  set: { type: 'set', ...settings },
  pause: { type: 'pause' },
  resume: { type: 'resume' },
  step: { type: 'step' },
  reset: { type: 'reset' },
  scene: { type: 'scene', name: 'bunny' },
  record: { type: 'record', on: true },
  place: {
    type: 'place',
    size: 0.125,
    rotation: [0.5, 0.5, -0.5, 0.5],
    tetrahedra: 450,
    handle: 'painted',
    centers: [0.25, -0.5, 0.125, 0, 0, 0.5],
    radius: 0.0625,
  },
  cancel: { type: 'cancel' },
  save: { type: 'save' },
  ack: { type: 'ack', frame: 17 },
};

test('the program is tested to read what the page writes', () => {
  const placed = { type: 'place' as const, size: 0.25, rotation: [1, 0, 0, 0] as Quat, tetrahedra: 10 };
  const others: Command[] = [
    { ...placed, handle: 'box', min: [-0.5, 0, 0.125], max: [0.5, 0.25, 0.125] },
    { ...placed, handle: 'top' },
  ];
  const written = [...Object.values(commands), ...others].map((command) => encodeCommand(command));
  if (process.env['PALPATE_WRITE_PROTOCOL'] !== undefined) writeFileSync(path('commands.json'), JSON.stringify(written, null, 1) + '\n');
  assert.deepEqual(written, read('commands.json'));
});
