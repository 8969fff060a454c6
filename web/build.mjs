// Builds the page: node build.mjs --outdir DIR. DIR gets index.html, app.js, app.css and icon.svg and needs nothing else.
import { build } from 'esbuild';
import { copyFile, mkdir, readFile, stat } from 'node:fs/promises';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';

const here = dirname(fileURLToPath(import.meta.url));

export async function buildPage(outdir, { minify = true } = {}) {
  await mkdir(outdir, { recursive: true });
  const licenses = await readFile(join(here, 'LICENSES.txt'), 'utf8');
  await build({
    entryPoints: { app: join(here, 'src/main.ts') },
    outdir,
    bundle: true,
    format: 'iife',
    target: 'es2022',
    minify,
    charset: 'utf8',
    legalComments: 'none', // the whole license texts are in the banner
    banner: { js: `/*!\n${licenses.trimEnd()}\n*/` },
    logLevel: 'warning',
  });
  await build({
    entryPoints: { app: join(here, 'src/app.css') },
    outdir,
    minify,
    charset: 'utf8',
    logLevel: 'warning',
  });
  for (const name of ['index.html', 'icon.svg']) await copyFile(join(here, 'src', name), join(outdir, name));
  let bytes = 0;
  for (const name of ['index.html', 'app.js', 'app.css', 'icon.svg']) bytes += (await stat(join(outdir, name))).size;
  return bytes;
}

if (process.argv[1] && resolve(process.argv[1]) === fileURLToPath(import.meta.url)) {
  const { values } = parseArgs({
    options: { outdir: { type: 'string', default: join(here, 'dist') }, debug: { type: 'boolean', default: false } },
  });
  const bytes = await buildPage(resolve(values.outdir), { minify: !values.debug });
  console.log(`${values.outdir}: ${(bytes / 1024).toFixed(0)} kB`);
}
