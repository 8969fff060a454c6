// End-to-end tests of the page in headless Chromium.
//   node e2e/run.mjs --mock                              against the stand-in of test/mock.mjs
//   node e2e/run.mjs --program build/release/palpate --scene scenes/alien.yaml [--recording DIR]
// Options: --only TEXT (or TEXT|TEXT), --patience SECONDS (60), --shots DIR (pictures of both themes, wide and narrow).
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';
import { buildPage } from '../build.mjs';
import { freePort, mockServers, openBrowser, openPage, patience, programServers } from './harness.mjs';

const here = dirname(fileURLToPath(import.meta.url));
const { values: options } = parseArgs({
  options: {
    mock: { type: 'boolean', default: false },
    program: { type: 'string' },
    scene: { type: 'string', default: 'scenes/alien.yaml' },
    recording: { type: 'string' },
    only: { type: 'string', default: '' },
    shots: { type: 'string' },
    patience: { type: 'string', default: '60' },
  },
});
if (!options.mock && !options.program) {
  console.error('usage: node e2e/run.mjs --mock | --program PATH [--scene FILE] [--recording DIR]');
  process.exit(2);
}

patience.ms = 1000 * Number(options.patience);
const dist = join(here, '../dist');
let weight = 0;
if (options.mock) weight = await buildPage(dist);
const servers = options.mock ? await mockServers(dist) : programServers(options);
const browser = await openBrowser();
if (!browser) {
  console.log('skipped: no Chromium here; PALPATE_CHROMIUM may name one');
  process.exit(77);
}
const tests = [];
const test = (name, run) => tests.push({ name, run });

const get = (page, name) => page.evaluate((key) => window.palpate[key], name);
const until = (page, condition, argument) => page.waitForFunction(condition, argument);
const noProblems = (problems, allowed = /$^/) => assert.deepEqual(problems.filter((p) => !allowed.test(p)), []);

/** Runs `body` with a running server and a page on it. */
const running = (body, pageOptions) => async () => {
  const server = await servers.running();
  try {
    const opened = await openPage(browser, server.url, pageOptions);
    try {
      await body(opened.page, opened, server);
      noProblems(opened.problems);
    } finally {
      await opened.close();
    }
  } finally {
    await server.stop();
  }
};

/** Takes the tool with the mouse. It may be under way, and pictures rare here: a miss is tried again. */
const grab = async (page) => {
  for (let tries = 0; tries < 8; ++tries) {
    const at = await page.evaluate(() => window.palpate.handleScreen());
    await page.mouse.move(at.x, at.y);
    await page.mouse.down();
    if (await get(page, 'holding')) {
      await until(page, () => window.palpate.state.hand === window.palpate.viewer);
      return at;
    }
    await page.mouse.up();
  }
  throw new Error('the tool cannot be taken');
};

test('loads, runs and weighs little', running(async (page, _, server) => {
  const first = await get(page, 'firstPicture');
  console.log(`    first picture after ${first.toFixed(0)} ms`);
  await until(page, () => window.palpate.ticks > 500 && window.palpate.frames > 5);
  assert.ok(await get(page, 'connected'));
  let bytes = 0;
  for (const path of ['', 'app.js', 'app.css', 'icon.svg']) bytes += (await (await fetch(new URL(path, server.url))).arrayBuffer()).byteLength;
  console.log(`    page weight ${(bytes / 1024).toFixed(0)} kB${weight ? ` (built: ${(weight / 1024).toFixed(0)} kB)` : ''}`);
  assert.ok(bytes < 1.5e6);
  assert.ok((await page.title()).includes('Palpate'));
}));

test('a drag moves the device, and pressing down is felt in the plot', running(async (page) => {
  const before = await get(page, 'device');
  const at = await grab(page);
  const y = 260;
  for (let i = 1; i <= 12; ++i) {
    await page.mouse.move(at.x, at.y + (y * i) / 12);
    await page.waitForTimeout(40);
  }
  await until(page, () => window.palpate.lastForce > 0.2);
  await until(page, (z) => window.palpate.device.position[2] < z - 0.005, before.position[2]);
  await until(page, () => Number(document.querySelector('#plots .plot:first-child .keys span:last-child b').textContent) !== 0);
  await until(page, () => window.palpate.delay > 0);
  console.log(`    force ${(await get(page, 'lastForce')).toFixed(2)} N, hand to picture ${(await get(page, 'delay')).toFixed(0)} ms here`);
  await page.mouse.up();
  await until(page, () => !window.palpate.holding && window.palpate.state.hand === null);
}));

test('wheel changes depth while holding, Shift turns, beside the tool the camera turns', running(async (page) => {
  const at = await grab(page);
  const start = await get(page, 'device');
  for (let i = 0; i < 6; ++i) await page.mouse.wheel(0, -100);
  await until(page, (p) => {
    const q = window.palpate.device.position;
    return Math.hypot(q[0] - p[0], q[1] - p[1]) > 0.01;
  }, start.position);
  await page.keyboard.down('Shift');
  await page.mouse.move(at.x + 60, at.y, { steps: 6 });
  await page.keyboard.up('Shift');
  await until(page, (q) => Math.abs(window.palpate.device.rotation.reduce((s, x, i) => s + x * q[i], 0)) < 0.995, start.rotation);
  await page.mouse.up();
  await until(page, () => !window.palpate.holding);
  const box = await page.locator('#view').boundingBox();
  const seen = await page.evaluate(() => window.palpate.handleScreen());
  await page.mouse.move(box.x + 30, box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + 160, box.y + box.height / 2 - 40, { steps: 5 });
  assert.equal(await get(page, 'holding'), false);
  await page.mouse.up();
  await until(page, (p) => {
    const q = window.palpate.handleScreen();
    return Math.hypot(q.x - p.x, q.y - p.y) > 1;
  }, seen);
}));

test('keys alone: hold, move, turn, let go', running(async (page) => {
  await page.locator('#view').focus();
  const start = await get(page, 'device');
  await page.keyboard.down('ArrowUp');
  await until(page, () => window.palpate.holding);
  await until(page, (z) => window.palpate.device.position[2] > z + 0.005, start.position[2]);
  await page.keyboard.up('ArrowUp');
  await page.keyboard.press('Escape');
  await until(page, () => !window.palpate.holding);
  await page.keyboard.press('?');
  await page.waitForSelector('#help-dialog[open]');
  await page.keyboard.press('Escape');
  await page.waitForSelector('#help-dialog:not([open])', { state: 'attached' });
}));

test('touch holds the tool', running(async (page) => {
  const client = await page.context().newCDPSession(page);
  const touch = (type, points) => client.send('Input.dispatchTouchEvent', { type, touchPoints: points });
  let at;
  for (let tries = 0; tries < 8 && !(await get(page, 'holding')); ++tries) {
    if (at) await touch('touchEnd', []);
    at = await page.evaluate(() => window.palpate.handleScreen());
    await touch('touchStart', [{ x: at.x, y: at.y }]);
  }
  assert.ok(await get(page, 'holding'));
  for (let i = 1; i <= 6; ++i) await touch('touchMove', [{ x: at.x + 8 * i, y: at.y }]);
  await touch('touchEnd', []);
  await until(page, () => !window.palpate.holding);
}, { hasTouch: true }));

test('handle, method, step, friction, stiffness, speed', running(async (page) => {
  const { handles, methods } = await get(page, 'scene');
  const generation = await get(page, 'generation');
  await page.selectOption('#method', methods.at(-1));
  await until(page, (m) => window.palpate.state.method === m, methods.at(-1));
  for (const [id, key, to] of [['visual-step', 'visualStep', '50'], ['friction', 'friction', '2'], ['stiffness', 'stiffness', '1']]) {
    await page.locator(`#${id}`).fill(to);
    const want = { visualStep: 0.05, friction: 2, stiffness: 2 }[key];
    await until(page, ([k, v]) => Math.abs(window.palpate.state[k] - v) < 1e-6, [key, want]);
  }
  await page.selectOption('#speed', '0.25');
  await until(page, () => window.palpate.state.speed === 0.25);
  await page.selectOption('#handle', handles.at(-1));
  await until(page, ([h, g]) => window.palpate.state.handle === h && window.palpate.generation > g, [handles.at(-1), generation]);
  await until(page, () => window.palpate.ticks > 50);
}));

test('pause, single step, reset', running(async (page) => {
  await page.click('#pause');
  await until(page, () => window.palpate.state.paused);
  await page.waitForTimeout(300);
  const ticks = await get(page, 'ticks');
  await page.click('#step');
  await until(page, (t) => window.palpate.ticks > t, ticks);
  await page.waitForTimeout(400);
  const after = await get(page, 'ticks');
  assert.ok(after - ticks <= 200, `${after - ticks} ticks in one step`);
  const generation = await get(page, 'generation');
  await page.click('#reset');
  await until(page, (g) => window.palpate.generation > g, generation);
  if ((await get(page, 'state')).paused) await page.click('#pause');
  await until(page, () => !window.palpate.state.paused && window.palpate.ticks > 100);
}));

test('another scene', running(async (page) => {
  const { name, scenes } = await get(page, 'scene');
  const other = scenes.find((s) => s.name !== name && /ball|block|alien$/.test(s.name)) ?? scenes.find((s) => s.name !== name);
  await page.selectOption('#scene', other.name);
  await until(page, (n) => window.palpate.scene.name === n && window.palpate.ticks > 50, other.name);
}));

const OBJ = ['v 0 0 0', 'v 0.08 0 0', 'v 0 0.08 0', 'v 0 0 0.08', 'f 1 3 2', 'f 1 2 4', 'f 2 3 4', 'f 3 1 4'].join('\n');

const drop = (page, name, content) =>
  page.evaluate(([file, data]) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([data], file));
    for (const type of ['dragenter', 'dragover', 'drop']) {
      document.getElementById('view').dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: transfer }));
    }
  }, [name, content]);

const waiting = (page, name) => until(page, (n) => window.palpate.state.placing?.name === n && window.palpate.placement, name);
const started = async (page) => {
  await page.click('#place-start');
  await until(page, () => window.palpate.state.placing === null && window.palpate.ticks > 100);
};

test('a dropped surface is placed and becomes the tool; a wrong file is refused in words', running(async (page) => {
  const generation = await get(page, 'generation');
  await drop(page, 'notes.txt', 'hello');
  await page.waitForSelector('.notice.error');
  await drop(page, 'own.obj', OBJ);
  await waiting(page, 'own.obj');
  const ticks = await get(page, 'ticks');
  await page.waitForTimeout(300);
  assert.equal(await get(page, 'ticks'), ticks); // nothing runs yet
  await started(page);
  assert.ok((await get(page, 'generation')) > generation + 1);
  await until(page, () => window.palpate.handleScreen());
  await grab(page);
  await page.mouse.up();
}));

/** A block of 8 x 4 x 2 file units with a fine grid on it, as OBJ. */
function gridBlock() {
  const n = [16, 8, 4];
  const points = [];
  const index = new Map();
  const vertex = (p) => {
    const key = p.join();
    if (!index.has(key)) {
      points.push(p.map((x) => x / 2));
      index.set(key, points.length);
    }
    return index.get(key);
  };
  const faces = [];
  for (let axis = 0; axis < 3; ++axis) {
    const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    for (const side of [0, n[axis]]) {
      for (let i = 0; i < n[u]; ++i) {
        for (let j = 0; j < n[v]; ++j) {
          const at = (di, dj) => {
            const p = [0, 0, 0];
            [p[axis], p[u], p[v]] = [side, i + di, j + dj];
            return vertex(p);
          };
          const quad = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
          faces.push(`f ${(side ? quad : quad.reverse()).join(' ')}`);
        }
      }
    }
  }
  return [...points.map((p) => `v ${p.join(' ')}`), ...faces].join('\n');
}

const setRange = (page, id, value) => page.locator(`#${id}`).fill(String(value));

test('a surface is turned, scaled, refined; a box or a brush chooses the handle', running(async (page) => {
  if (!options.program) return; // the stand-in reads neither surfaces nor bad messages
  const before = (await get(page, 'scene')).name;
  await drop(page, 'block.obj', gridBlock());
  await waiting(page, 'block.obj');
  assert.ok(await page.locator('#placing').isVisible());
  assert.ok(!(await page.locator('#plots').isVisible()));
  const sides = () => page.locator('#place-sides').textContent();
  assert.equal(await sides(), '150 mm x 75 mm x 37.5 mm');
  await page.click('#turn-y');
  assert.equal(await sides(), '37.5 mm x 75 mm x 150 mm');
  await page.selectOption('#turn-step', '15');
  await page.click('#turn-z-back');
  const { rotation } = await get(page, 'placement');
  const turned = [Math.cos(Math.PI / 4), 0, Math.sin(Math.PI / 4), 0];
  const [c, s] = [Math.cos(-Math.PI / 24), Math.sin(-Math.PI / 24)];
  const expected = [c * turned[0], -s * turned[2], c * turned[2], s * turned[0]]; // first about y, then about z
  rotation.forEach((x, i) => assert.ok(Math.abs(x - expected[i]) < 1e-9, `${rotation} is not ${expected}`));
  await page.click('#turn-reset');
  // the unit: 8 of the file's are 8 mm, 80 mm, 8 m, 203 mm
  await page.selectOption('#place-unit', 'cm');
  assert.ok(Math.abs((await get(page, 'placement')).size - 0.08) < 1e-12);
  assert.equal(await sides(), '80 mm x 40 mm x 20 mm');
  await page.selectOption('#place-unit', 'm');
  assert.ok(await page.locator('#place-start').isDisabled());
  assert.match(await sides(), /is possible/);
  await page.selectOption('#place-unit', '');
  await page.locator('#place-size').fill('120');
  await setRange(page, 'place-count', 2.48);
  const { size, tetrahedra } = await get(page, 'placement');
  assert.ok(Math.abs(size - 0.12) < 1e-12);
  assert.equal(tetrahedra, 300);
  // a box around the end at x = 0
  await page.click('#held-box');
  await setRange(page, 'box-z-from', 0);
  await setRange(page, 'box-x-to', 30);
  const inBox = await get(page, 'heldVertices');
  assert.ok(inBox > 50 && inBox < 250, `${inBox} vertices in the box`);
  const box = await get(page, 'placement');
  assert.ok(box.min[0] < -0.06 && Math.abs(box.max[0] + 0.024) < 1e-6, `${box.min} to ${box.max}`);
  assert.ok(box.min[2] < 0 && box.max[2] > 0.03);
  if (options.shots) await page.screenshot({ path: join(options.shots, 'placing-box.png') });
  // a brush
  await page.click('#held-painted');
  assert.ok(await page.locator('#place-start').isDisabled());
  const at = await page.evaluate(() => window.palpate.toolScreen());
  const stroke = async (dx) => {
    await page.mouse.move(at.x, at.y);
    await page.mouse.down();
    await page.mouse.move(at.x + dx, at.y, { steps: 6 });
    await page.mouse.up();
  };
  await stroke(40);
  const once = await get(page, 'heldVertices');
  await stroke(-60);
  const twice = await get(page, 'heldVertices');
  assert.ok(once > 0 && twice > once, `${once}, then ${twice} vertices painted`);
  await page.click('#brush-undo');
  assert.equal(await get(page, 'heldVertices'), once);
  await setRange(page, 'brush', 25);
  assert.ok((await get(page, 'heldVertices')) > once);
  if (options.shots) await page.screenshot({ path: join(options.shots, 'placing-brush.png') });
  // beside the surface the camera turns, and nothing is painted
  const painted = await get(page, 'heldVertices');
  const stage = await page.locator('#view').boundingBox();
  await page.mouse.move(stage.x + 20, stage.y + 60);
  await page.mouse.down();
  await page.mouse.move(stage.x + 120, stage.y + 90, { steps: 4 });
  await page.mouse.up();
  assert.equal(await get(page, 'heldVertices'), painted);
  await page.click('#place-cancel');
  await until(page, (name) => window.palpate.state.placing === null && window.palpate.scene.name === name, before);
  await until(page, () => window.palpate.ticks > 50);
  // and again, to the end
  await drop(page, 'block.obj', gridBlock());
  await waiting(page, 'block.obj');
  await page.click('#held-painted');
  await setRange(page, 'brush', 25);
  await stroke(30);
  await started(page);
  assert.match(await page.locator('.notice').last().textContent(), /tetrahedra, \d+ nodes, \d+ of them in the handle/);
  if (options.shots) await page.screenshot({ path: join(options.shots, 'placed.png') });
  // the scene as a file, which loads again beside the surface
  const text = await saved(page, 'block.yaml');
  assert.match(text, /file: block\.obj/);
  await runProgram({ 'block.yaml': text, 'block.obj': gridBlock() }, ['run', 'block.yaml', '--duration', '0.1', '--pictures', '0']);
}));

const contentOf = async (download) => {
  const chunks = [];
  for await (const chunk of await download.createReadStream()) chunks.push(chunk);
  return Buffer.concat(chunks);
};

const saved = async (page, name) => {
  await page.click('#save');
  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#save-scene')]);
  assert.equal(download.suggestedFilename(), name);
  return (await contentOf(download)).toString('utf8');
};

/** The program in a folder of its own, with these files. */
const runProgram = async (files, args) => {
  const cwd = mkdtempSync(join(tmpdir(), 'palpate-e2e-'));
  try {
    for (const [file, text] of Object.entries(files)) writeFileSync(join(cwd, file), text);
    const { status, stdout, stderr } = spawnSync(resolve(options.program), args, { cwd, encoding: 'utf8' });
    assert.equal(status, 0, stderr);
    return stdout;
  } finally {
    rmSync(cwd, { recursive: true, force: true });
  }
};

test('the scene as a file is the scene as it is', running(async (page) => {
  const { handles, methods } = await get(page, 'scene');
  await page.selectOption('#handle', handles.at(-1));
  await until(page, (h) => window.palpate.state.handle === h, handles.at(-1));
  await page.selectOption('#method', methods.at(-1));
  await until(page, (m) => window.palpate.state.method === m, methods.at(-1));
  const { name } = await get(page, 'scene');
  const text = await saved(page, `${name}.yaml`);
  assert.match(text, new RegExp(`method: ${methods.at(-1)}`));
  if (!options.program) return;
  const said = await runProgram({ 'again.yaml': text }, ['validate', 'again.yaml']);
  assert.match(said, new RegExp(`handle ${handles.at(-1)}: `));
  assert.match(said, new RegExp(`with ${methods.at(-1)},`));
}));

test('who comes late starts the motion again', running(async (page, _, server) => {
  if ((await get(page, 'state')).motion === 'none') return;
  await grab(page); // ends the motion, as its own end does
  await page.mouse.up();
  await until(page, () => window.palpate.state.motion === 'over' && window.palpate.state.hand === null);
  const late = await openPage(browser, server.url);
  await late.page.waitForSelector('#again:not([hidden])');
  if (options.shots) await late.page.screenshot({ path: join(options.shots, 'late.png') });
  await late.page.click('#again');
  await until(page, () => window.palpate.state.driver === 'path' && window.palpate.state.motion === 'playing');
  await late.page.waitForSelector('#again', { state: 'hidden' });
  noProblems(late.problems);
  await late.close();
}));

test('messages that no page would send are refused in one line, and the run goes on', running(async (page) => {
  if (!options.program) return; // the stand-in reads neither surfaces nor bad messages
  const place = { type: 'place', size: 0.1, rotation: [1, 0, 0, 0], tetrahedra: 100, handle: 'top' };
  const hostile = [
    place, // nothing waits
    { ...place, tetrahedra: 1e12 },
    { ...place, size: -1 },
    { ...place, rotation: [0, 0, 0, 0] },
    { ...place, handle: 'painted', centers: Array(600).fill(0), radius: 0.1 },
    { ...place, handle: 'box', min: [1, 1, 1], max: [0, 0, 0] },
    { ...place, file: '/etc/passwd' },
    { type: 'cancel' },
    { type: 'save', name: '../../x' }, // is only a save
    '{"type":"place"',
    '[[[[[[[[[[',
  ];
  const answers = await page.evaluate(
    (messages) =>
      new Promise((done) => {
        const url = new URL('ws', location.href);
        url.protocol = 'ws:';
        const socket = new WebSocket(url);
        const out = [];
        socket.onopen = () => messages.forEach((m) => socket.send(typeof m === 'string' ? m : JSON.stringify(m)));
        socket.onmessage = ({ data }) => {
          if (typeof data !== 'string') return;
          const m = JSON.parse(data);
          if (m.type === 'notice' || m.type === 'saved') out.push(m.type === 'saved' ? 'saved' : m.text);
          if (out.length === messages.length) {
            socket.close();
            done(out);
          }
        };
      }),
    hostile,
  );
  console.log(answers.map((line) => `    ${line}`).join('\n'));
  assert.equal(answers.filter((line) => line === 'saved').length, 1);
  for (const line of answers) assert.ok(!line.includes('\n') && line.length < 300, line);
  const ticks = await get(page, 'ticks');
  await until(page, (t) => window.palpate.ticks > t + 50, ticks);
}));

test('on a phone neither messages nor the status bar cover the plots', running(async (page) => {
  if (await page.evaluate(() => document.body.classList.contains('no-panel'))) await page.click('#toggle-panel');
  await page.waitForTimeout(300);
  for (const name of ['a.txt', 'a-file-with-a-rather-long-name-that-takes-several-lines-on-a-phone.txt', 'c.txt', 'd.txt']) {
    await drop(page, name, 'hello');
  }
  await page.waitForSelector('.notice.error:last-child');
  const boxes = await page.evaluate(() => {
    const box = (e) => {
      const { left, top, right, bottom } = e.getBoundingClientRect();
      return { left, top, right, bottom };
    };
    return {
      panel: box(document.getElementById('panel')),
      others: [...document.querySelectorAll('.notice, #notices, #status, #again, #holder, .bar, .float')].map((e) => ({
        name: e.id || e.className,
        ...box(e),
      })),
      scroll: [document.documentElement.scrollWidth, document.documentElement.scrollHeight],
      size: [innerWidth, innerHeight],
    };
  });
  const { panel } = boxes;
  assert.ok(panel.bottom - panel.top > 200 && panel.right - panel.left > 380, JSON.stringify(panel));
  for (const o of boxes.others) {
    const covers = o.left < panel.right - 1 && o.right > panel.left + 1 && o.top < panel.bottom - 1 && o.bottom > panel.top + 1;
    assert.ok(!covers, `${o.name} covers the plots: ${JSON.stringify(o)} over ${JSON.stringify(panel)}`);
    assert.ok(o.left >= -1 && o.right <= boxes.size[0] + 1 && o.bottom <= boxes.size[1] + 1, `${o.name} leaves the page: ${JSON.stringify(o)}`);
  }
  assert.deepEqual(boxes.scroll, boxes.size);
  const plots = await page.locator('#plots .plot canvas').first().boundingBox();
  assert.ok(plots.y + plots.height <= panel.bottom, 'the first plot is not in sight whole');
  if (options.shots) await page.screenshot({ path: join(options.shots, 'phone.png') });
  // a finger paints, too
  await drop(page, 'block.obj', gridBlock());
  await waiting(page, 'block.obj');
  await page.locator('#held-painted').tap();
  await setRange(page, 'brush', 25);
  const client = await page.context().newCDPSession(page);
  const at = await page.evaluate(() => window.palpate.toolScreen());
  for (const [type, touchPoints] of [['touchStart', [at]], ['touchMove', [{ x: at.x + 20, y: at.y }]], ['touchEnd', []]]) {
    await client.send('Input.dispatchTouchEvent', { type, touchPoints });
  }
  await until(page, () => window.palpate.heldVertices > 0);
  if (options.shots) await page.screenshot({ path: join(options.shots, 'phone-placing.png') });
  await page.click('#place-start');
  await until(page, () => window.palpate.state.placing === null && window.palpate.ticks > 50);
}, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 1 }));

test('a lost server: a banner, and on again by itself', async () => {
  const port = await freePort();
  let server = await servers.running(port);
  const { page, problems, close } = await openPage(browser, server.url);
  try {
    await server.stop();
    await page.waitForSelector('#banner:not([hidden])');
    assert.match(await page.locator('#banner').textContent(), /Lost the server, trying again/);
    server = await servers.running(port);
    await until(page, () => window.palpate.connected && document.getElementById('banner').hidden);
    const frames = await get(page, 'frames');
    await until(page, (n) => window.palpate.frames > n + 3, frames);
    noProblems(problems, /WebSocket|ERR_CONNECTION_REFUSED/); // the browser's own words on a lost socket
  } finally {
    await close();
    await server.stop();
  }
});

test('two viewers see the same run, one hand', running(async (page, _, server) => {
  const second = await openPage(browser, server.url);
  await until(page, () => window.palpate.state.viewers === 2);
  await grab(page);
  const holder = await get(page, 'viewer');
  await until(second.page, (n) => window.palpate.state.hand === n, holder);
  await second.page.waitForSelector('#holder:not([hidden])');
  await second.page.selectOption('#method', 'vc');
  await until(page, () => window.palpate.state.method === 'vc');
  noProblems(second.problems);
  await second.close();
  await until(page, () => window.palpate.state.viewers === 1);
  await page.mouse.up();
}));

test('what is shown: frames, forces, contacts, mesh, colors', running(async (page) => {
  for (const id of ['show-frames', 'show-contacts', 'show-mesh']) {
    await page.click(`#${id}`);
    assert.equal(await page.getAttribute(`#${id}`, 'aria-pressed'), 'true');
  }
  await page.selectOption('#color', 'stress');
  await until(page, () => window.palpate.state.stress);
  await until(page, () => document.getElementById('legend-high').textContent.length > 0);
  await page.selectOption('#color', 'displacement');
  await until(page, () => /mm/.test(document.getElementById('legend-high').textContent));
  await page.click('#camera-follow');
  await page.click('#camera-home');
}));

test('downloads: ticks, steps, picture', running(async (page) => {
  await until(page, () => window.palpate.ticks > 300);
  for (const [id, suffix, check] of [
    ['save-ticks', '-ticks.csv', (text) => text.split('\n').length > 300 && text.startsWith('time_s,sent_fx_N')],
    ['save-steps', '-steps.csv', (text) => text.startsWith('time_s,visual_fx_N')],
    ['save-picture', '.png', (text) => text.slice(1, 4) === 'PNG'],
  ]) {
    await page.click('#save');
    const [download] = await Promise.all([page.waitForEvent('download'), page.click(`#${id}`)]);
    assert.ok(download.suggestedFilename().endsWith(suffix));
    assert.ok(check((await contentOf(download)).toString('latin1')), id);
  }
}));

test('replay: plays, scrubs, plots in step', async () => {
  const server = await servers.replay();
  if (!server) {
    console.log('    (no recording given)');
    return;
  }
  try {
    const { page, problems, close } = await openPage(browser, server.url);
    await until(page, () => window.palpate.replayTime > 0.1);
    await page.click('#replay-play');
    const end = Number(await page.getAttribute('#replay-time', 'max'));
    const late = Number((end * 0.6).toFixed(3));
    await page.locator('#replay-time').fill(String(late));
    await until(page, (t) => Math.abs(window.palpate.replayTime - t) < 0.01 && Math.abs(window.palpate.cursor - t) < 0.01, late);
    const hand = await page.evaluate(() => window.palpate.handleScreen());
    await page.locator('#replay-time').fill(String(Number((end * 0.1).toFixed(3))));
    await until(page, (p) => {
      const q = window.palpate.handleScreen();
      return Math.hypot(q.x - p.x, q.y - p.y) > 0.5;
    }, hand);
    assert.ok((await get(page, 'ticks')) > 100);
    noProblems(problems);
    await close();
  } finally {
    await server.stop();
  }
});

test('every control has a name, focus goes in reading order', running(async (page) => {
  await page.click('#help');
  const nameless = await page.evaluate(() =>
    [...document.querySelectorAll('button, input, select, canvas[tabindex], [role=img]')]
      .filter((e) => {
        const labelled = e.getAttribute('aria-labelledby');
        const name =
          e.getAttribute('aria-label') ??
          (labelled ? document.getElementById(labelled)?.textContent : null) ??
          (e.labels?.length ? e.labels[0].textContent : null) ??
          (e.tagName === 'BUTTON' ? e.textContent : null);
        return !name?.trim();
      })
      .map((e) => e.id || e.outerHTML.slice(0, 80)),
  );
  assert.deepEqual(nameless, []);
  await page.keyboard.press('Escape');
  await page.evaluate(() => {
    document.activeElement?.blur();
    window.scrollTo(0, 0);
  });
  await page.locator('#scene').focus();
  const order = [];
  for (let k = 0; k < 40; ++k) {
    order.push(await page.evaluate(() => document.activeElement?.id || document.activeElement?.tagName));
    await page.keyboard.press('Tab');
  }
  const position = (id) => order.indexOf(id);
  for (const [a, b] of [['scene', 'handle'], ['handle', 'method'], ['method', 'pause'], ['pause', 'record'], ['record', 'save'], ['save', 'view'], ['view', 'show-frames'], ['show-frames', 'zoom-in'], ['zoom-in', 'visual-step'], ['visual-step', 'window']]) {
    assert.ok(position(a) >= 0 && position(b) > position(a), `${a} before ${b} in ${order.join(' ')}`);
  }
}));

const contrast = (page) =>
  page.evaluate(() => {
    const parse = (text) => {
      const m = /rgba?\(([^)]+)\)/.exec(text);
      const [r, g, b, a = 1] = m ? m[1].split(/[ ,/]+/).map(Number) : [0, 0, 0, 0];
      return { r, g, b, a };
    };
    const luminance = ({ r, g, b }) => {
      const f = (x) => (x / 255 <= 0.03928 ? x / 255 / 12.92 : ((x / 255 + 0.055) / 1.055) ** 2.4);
      return 0.2126 * f(r) + 0.7152 * f(g) + 0.0722 * f(b);
    };
    const style = getComputedStyle(document.documentElement);
    const probe = document.createElement('span');
    document.body.append(probe);
    const variable = (name) => {
      probe.style.color = style.getPropertyValue(name);
      return parse(getComputedStyle(probe).color);
    };
    // The scene's background is a gradient: its darker and lighter ends count.
    const behind = (e) => {
      for (let p = e; p; p = p.parentElement) {
        const color = parse(getComputedStyle(p).backgroundColor);
        if (color.a > 0.8) return [color];
        if (p.id === 'stage') return [variable('--sky'), variable('--horizon')];
      }
      return [variable('--page')];
    };
    const out = [];
    for (const e of document.querySelectorAll('body *')) {
      const text = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
      if (!text || !e.checkVisibility({ visibilityProperty: true }) || e.closest('[disabled], option, .hidden, .symbols')) continue;
      const color = parse(getComputedStyle(e).color);
      for (const ground of behind(e)) {
        const [a, b] = [luminance(color), luminance(ground)].sort((x, y) => y - x);
        const ratio = (a + 0.05) / (b + 0.05);
        if (ratio < 4.5) out.push(`${e.id || e.className || e.tagName} "${e.textContent.trim().slice(0, 20)}" ${ratio.toFixed(2)}`);
      }
    }
    // Lines of plots: 3 to 1.
    for (const name of ['--x', '--y', '--z', '--felt', '--visual', '--vc']) {
      const [a, b] = [luminance(variable(name)), luminance(variable('--panel'))].sort((x, y) => y - x);
      if ((a + 0.05) / (b + 0.05) < 3) out.push(`line ${name}`);
    }
    probe.remove();
    return out;
  });

for (const colorScheme of ['light', 'dark']) {
  test(`text can be read, ${colorScheme}`, running(async (page) => {
    assert.equal(await page.evaluate(() => document.documentElement.dataset.theme), colorScheme);
    await page.selectOption('#color', 'displacement');
    await page.waitForTimeout(1500);
    assert.deepEqual(await contrast(page), []);
    await page.click('#help');
    assert.deepEqual(await contrast(page), []);
    await page.keyboard.press('Escape');
    await drop(page, 'own.obj', OBJ);
    await waiting(page, 'own.obj');
    for (const id of ['held-box', 'held-painted']) {
      await page.click(`#${id}`);
      assert.deepEqual(await contrast(page), []);
    }
    await page.selectOption('#place-unit', 'm'); // 8 cm as 0.08 m is possible
    await page.selectOption('#place-unit', 'mm'); // and as 0.08 mm is not
    assert.ok(await page.locator('#place-sides.wrong').isVisible());
    assert.deepEqual(await contrast(page), []);
    await page.click('#place-cancel');
    await until(page, () => window.palpate.state.placing === null);
    await page.click('#theme');
    assert.notEqual(await page.evaluate(() => document.documentElement.dataset.theme), colorScheme);
    assert.deepEqual(await contrast(page), []);
  }, { colorScheme }));
}

if (options.shots) {
  mkdirSync(options.shots, { recursive: true });
  for (const colorScheme of ['light', 'dark']) {
    for (const [kind, viewport] of [['wide', { width: 1360, height: 800 }], ['narrow', { width: 400, height: 820 }]]) {
      test(`picture: ${colorScheme}, ${kind}`, running(async (page) => {
        await page.waitForTimeout(6000);
        await page.screenshot({ path: join(options.shots, `${colorScheme}-${kind}.png`) });
      }, { colorScheme, viewport, deviceScaleFactor: 1 }));
    }
  }
}

let failed = 0;
for (const { name, run } of tests.filter((t) => options.only.split('|').some((part) => t.name.includes(part)))) {
  const start = performance.now();
  try {
    await run();
    console.log(`ok   ${name} (${((performance.now() - start) / 1000).toFixed(1)} s)`);
  } catch (error) {
    ++failed;
    console.log(`FAIL ${name}\n     ${error.stack?.split('\n').slice(0, 8).join('\n     ')}`);
  }
}
await browser.close();
console.log(failed ? `${failed} failed` : `all passed, server: ${servers.name}`);
process.exit(failed ? 1 : 0);
