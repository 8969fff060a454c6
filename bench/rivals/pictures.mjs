// Pictures of a run: `palpate run --pictures`, and the viewer's own page in headless Chromium. Writes a table.
// node bench/rivals/pictures.mjs --program build/release/palpate --out DIR [--rounds 3] SCENE...
import { spawnSync } from 'node:child_process';
import { readdirSync, statSync, writeFileSync } from 'node:fs';
import { basename, join } from 'node:path';
import { parseArgs } from 'node:util';
import { openBrowser, openPage, programServers } from '../../web/e2e/harness.mjs';
import { kilobytes, median, processorMeter } from './browser.mjs';

const { values: options, positionals: scenes } = parseArgs({
  allowPositionals: true,
  options: { program: { type: 'string' }, out: { type: 'string' }, rounds: { type: 'string', default: '3' } },
});
const DURATION_S = 1.5;
const PICTURES = 12;
const VIEWPORT = { width: 1000, height: 560 }; // a panel takes some of it
const rounds = Number(options.rounds);

/** Processor seconds of a run with so many pictures. */
function run(scene, out, pictures) {
  const arguments_ = ['run', scene, '--duration', String(DURATION_S), '--pictures', String(pictures), '--out', out];
  const timed = spawnSync('bash', ['-c', 'TIMEFORMAT="%U %S"; time "$@" > /dev/null', 'bash', options.program, ...arguments_], { encoding: 'utf8' });
  if (timed.status !== 0) throw new Error(timed.stderr);
  const [user, system] = timed.stderr.trim().split('\n').pop().split(' ').map(Number);
  return user + system;
}

/** From the start of a browser to the last of the pictures. */
async function photograph(recording, out) {
  const server = await programServers({ program: options.program, recording }).replay();
  const start = performance.now();
  const browser = await openBrowser();
  if (!browser) throw new Error('no Chromium here');
  const processorTime = await processorMeter(browser);
  const { page, problems, close } = await openPage(browser, server.url, { viewport: VIEWPORT, bypassCSP: true });
  await page.waitForFunction('palpate.replayTime > 0');
  await page.click('#replay-play');
  const ready = { wall: performance.now() - start, processor: await processorTime() };
  await page.addStyleTag({ content: '#stage > :not(canvas) { opacity: 0 }' }); // the picture without the controls
  const end = Number(await page.getAttribute('#replay-time', 'max'));
  const walls = [];
  const sizes = [];
  const before = await processorTime();
  for (let i = 0; i < PICTURES; ++i) {
    const time = Number(((end * (i + 0.5)) / PICTURES).toFixed(3));
    const began = performance.now();
    const drawn = await page.evaluate('palpate.pictures');
    await page.locator('#replay-time').fill(String(time));
    await page.waitForFunction(([t, n]) => Math.abs(palpate.replayTime - t) < 0.01 && palpate.pictures > n, [time, drawn]);
    const png = await page.locator('#stage canvas').first().screenshot();
    walls.push(performance.now() - began);
    sizes.push(png.length);
    writeFileSync(join(out, `page-${i + 1}.png`), png);
  }
  const after = await processorTime();
  await close();
  await browser.close();
  await server.stop();
  if (problems.length > 0) throw new Error(problems.join('\n'));
  return { ready, wall: median(walls), processor: (1000 * (after - before)) / PICTURES, size: median(sizes) };
}

console.log('Milliseconds of processor time (times ours); start: browser and page until the first picture.\n');
console.log('| Scene | ours, a picture | kB | page, a picture | kB | start, processor | start, waited |');
console.log('|---|---|---|---|---|---|---|');
for (const scene of scenes) {
  const out = join(options.out, basename(scene, '.yaml'));
  const own = [];
  const page = [];
  for (let round = 0; round < rounds; ++round) {
    const without = run(scene, `${out}-bare`, 0);
    own.push((1000 * (run(scene, out, PICTURES) - without)) / PICTURES);
    page.push(await photograph(out, out));
  }
  const pictures = readdirSync(out).filter((name) => /^picture-\d+\.png$/.test(name));
  const size = median(pictures.map((name) => statSync(join(out, name)).size));
  const of = (key) => median(page.map(key));
  console.log(
    `| ${basename(scene, '.yaml')} | ${median(own).toFixed(0)} | ${kilobytes(size)} | ${of((p) => p.processor).toFixed(0)} (${(of((p) => p.processor) / median(own)).toFixed(1)}) | ${kilobytes(of((p) => p.size))} | ${(1000 * of((p) => p.ready.processor)).toFixed(0)} | ${of((p) => p.ready.wall).toFixed(0)} |`,
  );
}
