// Four traces at 1 kHz over a window of 10 s: the page's own plots, uPlot and Dygraphs, in headless Chromium. Writes a
// table. node bench/rivals/plots.mjs [--seconds 5] [--rounds 3] [--shots DIR]
import { createRequire } from 'node:module';
import { existsSync, mkdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';
import { openBrowser } from '../../web/e2e/harness.mjs';
import { kilobytes, median, processorMeter } from './browser.mjs';

const root = fileURLToPath(new URL('../..', import.meta.url));
const { build } = createRequire(join(root, 'web/package.json'))('esbuild');
const { values: options } = parseArgs({
  options: { seconds: { type: 'string', default: '5' }, rounds: { type: 'string', default: '3' }, shots: { type: 'string' } },
});

const WINDOW_S = 10;
const COLORS = ['#2a6fdb', '#d9622b', '#2a9d5c', '#8a4fbf'];
const dygraphs = ['/usr/share/javascript/dygraphs', join(root, '.cache/dygraphs/package/dist')].find((dir) => existsSync(dir));
const uplot = join(root, '.cache/uplot/package/dist');

// Each gives window.make(element) -> { push(time, row), draw() }.
const sources = {
  own: `
    import { Track } from './history.ts';
    import { Plot, TimeWindow } from './plots.ts';
    window.make = (element) => {
      const track = new Track(4, 1200000);
      const time = new TimeWindow();
      time.length = ${WINDOW_S};
      const series = ['x', 'y', 'z', 'all'].map((label, column) => ({ label, color: '--c' + column, track: () => track, column }));
      const plot = new Plot({ title: 'Force', unit: 'N', series }, time);
      element.append(plot.element);
      let read = 0;
      return {
        push: (t, row) => track.append(t, row),
        draw() {
          time.set(track.firstTime, track.lastTime);
          plot.draw();
          if (performance.now() - read < 90) return; // as in panel.ts
          read = performance.now();
          plot.read();
        },
      };
    };`,
  uPlot: `
    import uPlot from '${uplot}/uPlot.esm.js';
    window.make = (element) => {
      const columns = Array.from({ length: 5 }, () => new Float64Array(200000));
      let first = 0, end = 0;
      const axis = { size: 24, stroke: '#666', grid: { stroke: '#ddd', width: 1 }, font: '11px system-ui, sans-serif' };
      const plot = new uPlot({
        width: 420, height: 104, legend: { show: false }, scales: { x: { time: false } }, axes: [axis, axis],
        series: [{}, ...['x', 'y', 'z', 'all'].map((label, i) => ({ label, stroke: window.COLORS[i], width: 1.3, points: { show: false } }))],
      }, [[], [], [], [], []], element);
      return {
        push(t, row) {
          columns[0][end] = t;
          for (let i = 0; i < 4; ++i) columns[i + 1][end] = row[i];
          ++end;
        },
        draw() {
          while (columns[0][first] < columns[0][end - 1] - ${WINDOW_S}) ++first;
          plot.setData(columns.map((c) => c.subarray(first, end)));
        },
      };
    };`,
  Dygraphs: `
    window.make = (element) => {
      let rows = [];
      let plot = null;
      return {
        push: (t, row) => rows.push([t, ...row]),
        draw() {
          let first = 0;
          while (rows[first][0] < rows[rows.length - 1][0] - ${WINDOW_S}) ++first;
          if (first > 0) rows.splice(0, first);
          if (plot) plot.updateOptions({ file: rows });
          else {
            element.style.height = '104px';
            plot = new Dygraph(element, rows, {
              labels: ['t', 'x', 'y', 'z', 'all'], colors: window.COLORS, strokeWidth: 1.3, gridLineColor: '#ddd', axisLabelFontSize: 11,
            });
          }
        },
      };
    };`,
};

// plots.ts takes one short function from view3d.ts, which would bring three.js along.
const withoutView = {
  name: 'without-view',
  setup: ({ onLoad }) =>
    onLoad({ filter: /view3d\.ts$/ }, ({ path }) => {
      const contents = /export function niceAbove[^]*?\n}/.exec(readFileSync(path, 'utf8'))?.[0];
      if (!contents) throw new Error('view3d.ts has no niceAbove any more');
      return { contents, loader: 'ts' };
    }),
};

async function bundle(name) {
  const { outputFiles } = await build({
    stdin: { contents: sources[name], resolveDir: join(root, 'web/src'), loader: 'ts' },
    bundle: true, format: 'iife', target: 'es2022', minify: true, write: false, legalComments: 'none', plugins: [withoutView],
  });
  let script = outputFiles[0].text;
  let style = '';
  if (name === 'Dygraphs') {
    script = readFileSync(join(dygraphs, 'dygraph.min.js'), 'utf8') + '\n' + script;
    style = readFileSync(join(dygraphs, 'dygraph.min.css'), 'utf8');
  }
  if (name === 'uPlot') style = readFileSync(join(uplot, 'uPlot.min.css'), 'utf8');
  return { script, style, bytes: script.length + style.length };
}

/** Streams for a while on a page of its own: processor time of browser and page's script, frames. */
async function stream({ script, style }, name) {
  const context = await browser.newContext({ viewport: { width: 480, height: 240 } });
  const page = await context.newPage();
  page.on('pageerror', (error) => {
    throw error;
  });
  await page.setContent(`<style>${style}
    :root { --grid: #ddd; --soft: #666; --text: #222; --accent: #c00; ${COLORS.map((c, i) => `--c${i}: ${c};`).join(' ')} }
    #plot { width: 420px } .plot canvas { display: block; width: 420px; height: 104px }</style><div id="plot"></div>`);
  await page.evaluate((colors) => (window.COLORS = colors), COLORS);
  await page.addScriptTag({ content: script });
  const cdp = await context.newCDPSession(page);
  await cdp.send('Performance.enable', { timeDomain: 'threadTicks' });
  const metrics = async () => Object.fromEntries((await cdp.send('Performance.getMetrics')).metrics.map((m) => [m.name, m.value]));
  await page.evaluate((window_s) => {
    const plot = window.make(document.getElementById('plot'));
    const row = [0, 0, 0, 0];
    let sent = 0;
    // slow waves with a little noise, the same in every run
    let seed = 1;
    const noise = () => (seed = (seed * 16807) % 2147483647) / 2147483647 - 0.5;
    const until = (ms) => {
      for (; sent <= ms; ++sent) {
        const t = sent / 1000;
        for (let i = 0; i < 4; ++i) row[i] = (1 + 0.3 * i) * Math.sin((0.7 + 0.4 * i) * t) + 0.1 * noise();
        plot.push(t, row);
      }
    };
    until(1000 * window_s);
    const start = performance.now() - sent;
    window.frames_drawn = 0;
    const frame = () => {
      until(performance.now() - start);
      plot.draw();
      ++window.frames_drawn;
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }, WINDOW_S);
  await page.waitForTimeout(1000);
  const look = async () => ({ all: await processorTime(), page: await metrics(), frames: await page.evaluate('frames_drawn'), at: performance.now() });
  const before = await look();
  await page.waitForTimeout(1000 * Number(options.seconds));
  const after = await look();
  if (options.shots) {
    mkdirSync(options.shots, { recursive: true });
    await page.screenshot({ path: join(options.shots, `plots-${name}.png`) });
  }
  await context.close();
  const frames = after.frames - before.frames;
  const seconds = (after.at - before.at) / 1000;
  return {
    rate: frames / seconds,
    share: (after.all - before.all) / seconds,
    perFrame: (1000 * (after.all - before.all)) / frames,
    script: (1000 * (after.page.ScriptDuration - before.page.ScriptDuration)) / frames,
  };
}

const browser = await openBrowser();
if (!browser) throw new Error('no Chromium here');
const processorTime = await processorMeter(browser);
const bundles = {};
const runs = {};
for (const name of Object.keys(sources)) {
  bundles[name] = await bundle(name);
  runs[name] = [];
}
for (let round = 0; round < Number(options.rounds); ++round)
  for (const name of Object.keys(sources)) runs[name].push(await stream(bundles[name], name));
await browser.close();

const of = (name, key) => median(runs[name].map((run) => run[key]));
const against = (name, key) => `${of(name, key).toFixed(2)} (${(of(name, key) / of('own', key)).toFixed(2)})`;
console.log('Medians (times ours).\n');
console.log('| | kB, minified | frames a second | script a frame, ms | all of Chromium a frame, ms | share of a core |');
console.log('|---|---|---|---|---|---|');
for (const name of Object.keys(sources))
  console.log(
    `| ${name} | ${kilobytes(bundles[name].bytes)} | ${of(name, 'rate').toFixed(0)} | ${against(name, 'script')} | ${against(name, 'perFrame')} | ${(100 * of(name, 'share')).toFixed(0)} % |`,
  );
