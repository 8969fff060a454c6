// A server (the program, or the stand-in) and a browser for end-to-end tests.
import { spawn } from 'node:child_process';
import { existsSync } from 'node:fs';
import { createServer } from 'node:net';
import { chromium } from 'playwright-core';

const CHROMIUM = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];
const ARGUMENTS = [
  '--headless',
  '--no-sandbox',
  '--disable-gpu',
  '--use-angle=swiftshader',
  '--enable-unsafe-swiftshader',
  '--disable-quic',
  '--no-first-run',
  '--disable-background-networking',
  '--disable-component-update',
  '--disable-sync',
];

/** How long a page may take to do what is waited for; longer on a busy machine. */
export const patience = { ms: 60_000 };

export async function openBrowser() {
  const executablePath = process.env.PALPATE_CHROMIUM ?? CHROMIUM.find((path) => existsSync(path));
  if (!executablePath) return null;
  return chromium.launch({ executablePath, args: ARGUMENTS });
}

export async function freePort() {
  const server = createServer();
  await new Promise((done) => server.listen(0, '127.0.0.1', done));
  const { port } = server.address();
  await new Promise((done) => server.close(done));
  return port;
}

const children = new Set();
process.on('exit', () => children.forEach((child) => child.kill('SIGKILL')));
for (const signal of ['SIGINT', 'SIGTERM', 'SIGHUP']) process.on(signal, () => process.exit(1));

/** Starts `program ...args --port N` and waits for the line with its address. */
function spawnProgram(program, args, port) {
  const child = spawn(program, [...args, '--port', String(port)], { stdio: ['ignore', 'pipe', 'inherit'] });
  children.add(child);
  child.once('exit', () => children.delete(child));
  return new Promise((resolve, reject) => {
    let output = '';
    const late = setTimeout(() => {
      child.kill('SIGKILL');
      reject(new Error(`${program} ${args.join(' ')} named no address within 60 s: ${output}`));
    }, 60_000);
    child.stdout.on('data', (data) => {
      output += data;
      const url = /http:\/\/[^\s]+/.exec(output)?.[0];
      if (!url) return;
      clearTimeout(late);
      resolve({
        url,
        async stop() {
          if (child.exitCode !== null) return;
          const gone = new Promise((done) => child.once('exit', done));
          child.kill('SIGINT');
          const stubborn = setTimeout(() => child.kill('SIGKILL'), 10_000);
          await gone;
          clearTimeout(stubborn);
        },
      });
    });
    child.once('exit', (code) => {
      clearTimeout(late);
      reject(new Error(`${program} ended with ${code} before it named an address: ${output}`));
    });
  });
}

/** What tests need of a server: `running(port)` and `replay()` start one. */
export function programServers({ program, scene, recording }) {
  return {
    name: program,
    running: (port = 0) => spawnProgram(program, ['view', scene], port),
    replay: () => (recording ? spawnProgram(program, ['replay', recording], 0) : null),
  };
}

export async function mockServers(dir) {
  const { startMock } = await import('../test/mock.mjs');
  return {
    name: 'stand-in',
    running: (port = 0) => startMock({ dir, port }),
    replay: () => startMock({ dir, replay: true }),
  };
}

/** A page that remembers what went wrong on it. */
export async function openPage(browser, url, options = {}) {
  // without a graphics processor, pictures are what takes the time: a quarter of their pixels is enough to judge by
  const context = await browser.newContext({ viewport: { width: 1100, height: 700 }, deviceScaleFactor: 0.5, ...options });
  // nor need there be many of them
  await context.addInitScript((ms) => {
    const next = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (draw) => window.setTimeout(() => next(draw), ms);
    window.cancelAnimationFrame = window.clearTimeout.bind(window);
  }, 150);
  const page = await context.newPage();
  page.setDefaultTimeout(patience.ms);
  const problems = [];
  page.on('console', (message) => {
    if (message.type() === 'error') problems.push(message.text());
  });
  page.on('pageerror', (error) => problems.push(error.message));
  page.on('request', (request) => {
    const target = new URL(request.url());
    if (!['data:', 'blob:'].includes(target.protocol) && target.host !== new URL(url).host) problems.push(`asks ${target.host}`);
  });
  await page.goto(url);
  await page.waitForFunction(() => window.palpate?.firstPicture > 0);
  return { page, problems, close: () => context.close() };
}
