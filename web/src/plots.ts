// Plots of the run over one common stretch of time. Own canvas code: a line is drawn from first, least, greatest and last
// value of each pixel column (history.ts), so that 1 kHz is shown without loss.
import { decimate, type Track } from './history.ts';
import { niceAbove } from './view3d.ts';

export interface SeriesSpec {
  label: string;
  /** CSS variable with the color */
  color: string;
  track: () => Track;
  column: number;
  /** values hold until the next row */
  hold?: boolean;
  dash?: number[];
  width?: number;
}

export interface PlotSpec {
  title: string;
  unit: string;
  series: SeriesSpec[];
  /** shown values times this */
  scale?: number;
  digits?: number;
  /** a level worth seeing, such as a deadline; null: none */
  level?: () => number | null;
  /** the axis starts at zero */
  fromZero?: boolean;
  /** least height of the axis */
  span?: number;
}

const LEFT = 40;
const RIGHT = 4;
const TOP = 6;
const BOTTOM = 16;

const colors = new Map<string, string>();

function cssColor(name: string): string {
  let color = colors.get(name);
  if (color === undefined) {
    color = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    colors.set(name, color);
  }
  return color;
}

/** Colors are read anew: the theme has changed. */
export const forgetColors = (): void => colors.clear();

function ticksBetween(low: number, high: number, count: number): number[] {
  const step = niceAbove((high - low) / count);
  const out: number[] = [];
  for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-9 * step; ++k) out.push(k * step);
  return out;
}

const short = (value: number): string => {
  const size = Math.abs(value);
  if (size === 0) return '0';
  if (size >= 1000) return value.toFixed(0);
  if (size < 0.001) return value.toExponential(0);
  return String(Number(value.toPrecision(3)));
};

/** The stretch of time all plots show. */
export class TimeWindow {
  /** s */
  length = 10;
  /** right edge while one looks back; null: now */
  private held: number | null = null;
  /** time under the pointer, or of the replay; null: none */
  cursor: number | null = null;
  onFollow: (following: boolean) => void = () => {};
  private newest = 0;
  private oldest = 0;

  set(oldest: number, newest: number): void {
    this.oldest = oldest;
    this.newest = newest;
  }

  get following(): boolean {
    return this.held === null;
  }

  get end(): number {
    return this.held ?? this.newest;
  }

  get start(): number {
    // "All" is what there is.
    const wanted = this.length >= 1200 ? Math.max(2, this.newest - this.oldest) : this.length;
    return this.end - wanted;
  }

  /** Looks at another stretch: the right edge moves by `seconds`. */
  pan(seconds: number): void {
    this.hold(this.end + seconds);
  }

  hold(end: number): void {
    const least = this.oldest + (this.end - this.start) * 0.2;
    this.held = Math.max(least, end);
    if (this.held >= this.newest) this.held = null;
    this.onFollow(this.held === null);
  }

  zoom(factor: number, about: number): void {
    const length = Math.min(1199, Math.max(0.02, (this.end - this.start) * factor));
    const share = (this.end - about) / (this.end - this.start);
    this.length = length;
    if (!this.following || about < this.end) this.hold(about + share * length);
  }

  now(): void {
    this.held = null;
    this.onFollow(true);
  }
}

/** What part of time a plot shows, and where times and values are on its canvas. */
interface Frame {
  start: number;
  end: number;
  /** of the area between the axes */
  w: number;
  h: number;
  x: (time: number) => number;
  y: (value: number) => number;
}

export class Plot {
  readonly element = document.createElement('section');
  readonly canvas = document.createElement('canvas');
  private readonly context: CanvasRenderingContext2D;
  private readonly values: HTMLElement[] = [];
  private readonly keys = document.createElement('div');
  private readonly buffer = new Float32Array(5 * 4096);
  private low = 0;
  private high = 0;
  private visible = true;

  constructor(
    readonly spec: PlotSpec,
    private readonly window: TimeWindow,
    extra: HTMLElement | null = null,
  ) {
    this.element.className = 'plot';
    const header = document.createElement('header');
    const title = document.createElement('h3');
    title.textContent = `${spec.title} `;
    const unit = document.createElement('small');
    unit.textContent = spec.unit;
    title.append(unit);
    header.append(title);
    if (extra) header.append(extra);
    this.keys.className = 'keys';
    header.append(this.keys);
    this.element.append(header, this.canvas);
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute('role', 'img');
    this.canvas.setAttribute('aria-label', `${spec.title} over time, ${spec.unit}; arrow keys move the reading`);
    this.context = this.canvas.getContext('2d') as CanvasRenderingContext2D;
    this.setSeries(spec.series);
    this.listen();
    new IntersectionObserver(([entry]) => {
      this.visible = entry?.isIntersecting ?? true;
    }).observe(this.canvas);
  }

  setSeries(series: SeriesSpec[]): void {
    this.spec.series = series;
    this.keys.replaceChildren();
    this.values.length = 0;
    for (const { label, color } of series) {
      const key = document.createElement('span');
      const swatch = document.createElement('i');
      swatch.style.color = `var(${color})`;
      const value = document.createElement('b');
      key.append(swatch, label, ' ', value);
      this.keys.append(key);
      this.values.push(value);
    }
    this.low = this.high = 0;
  }

  private listen(): void {
    const { canvas, window: time } = this;
    const width = (): number => Math.max(1, canvas.clientWidth - LEFT - RIGHT);
    const timeAt = (e: MouseEvent): number => {
      const x = e.clientX - canvas.getBoundingClientRect().left - LEFT;
      return time.start + (Math.min(Math.max(x, 0), width()) / width()) * (time.end - time.start);
    };
    let dragging = false;
    canvas.addEventListener('pointerdown', (e) => {
      dragging = true;
      canvas.setPointerCapture(e.pointerId);
    });
    canvas.addEventListener('pointerup', () => (dragging = false));
    canvas.addEventListener('pointermove', (e) => {
      time.cursor = timeAt(e);
      if (dragging && e.movementX !== 0) time.pan((-e.movementX / width()) * (time.end - time.start));
    });
    canvas.addEventListener('pointerleave', () => {
      dragging = false;
      time.cursor = null;
    });
    canvas.addEventListener('dblclick', () => time.now());
    canvas.addEventListener(
      'wheel',
      (e) => {
        if (!e.ctrlKey && document.activeElement !== canvas) return; // the panel scrolls
        e.preventDefault();
        time.zoom(1.2 ** Math.max(-3, Math.min(3, e.deltaY / 100)), timeAt(e));
      },
      { passive: false },
    );
    canvas.addEventListener('keydown', (e) => {
      const span = time.end - time.start;
      const step = (e.shiftKey ? 0.1 : 0.01) * span;
      const at = time.cursor ?? time.end;
      if (e.key === 'ArrowLeft') time.cursor = Math.max(time.start, at - step);
      else if (e.key === 'ArrowRight') time.cursor = Math.min(time.end, at + step);
      else if (e.key === 'Escape') time.cursor = null;
      else if (e.key === '+') time.zoom(1 / 1.3, at);
      else if (e.key === '-') time.zoom(1.3, at);
      else return;
      e.preventDefault();
    });
    canvas.addEventListener('blur', () => (time.cursor = null));
  }

  /** Values beside the names: under the cursor, else the newest. */
  read(): void {
    const { spec, window: time } = this;
    spec.series.forEach((series, i) => {
      const track = series.track();
      const { column } = series;
      let row = track.length - 1;
      const at = time.cursor ?? (time.following ? null : time.end);
      if (at !== null) {
        row = track.indexAt(at + 1e-9) - 1; // the last at or before
        if (row < track.first) row = -1;
      }
      const value = row >= track.first ? track.value(column, row) : NaN;
      const text = Number.isFinite(value) ? (value * (spec.scale ?? 1)).toFixed(spec.digits ?? 2) : '-';
      const element = this.values[i];
      if (element && element.textContent !== text) element.textContent = text;
    });
  }

  draw(): void {
    const { canvas, context: c, spec } = this;
    if (!this.visible || canvas.clientWidth === 0) return;
    const frame = this.frame();
    this.drawAxes(frame);
    c.save();
    c.beginPath();
    c.rect(LEFT, 0, frame.w + RIGHT, canvas.clientHeight);
    c.clip();
    this.drawLevel(frame);
    for (const series of spec.series) this.drawSeries(series, frame);
    this.drawCursor(frame);
    c.restore();
  }

  /** An empty canvas as large as it is shown, and where values and times are on it. */
  private frame(): Frame {
    const { canvas, context: c, spec } = this;
    const { start, end } = this.window;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const width = canvas.clientWidth;
    const height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    const w = width - LEFT - RIGHT;
    const h = height - TOP - BOTTOM;
    this.rescale(start, end);
    return {
      start,
      end,
      w,
      h,
      x: (t) => LEFT + ((t - start) / (end - start)) * w,
      y: (v) => TOP + h - ((v * (spec.scale ?? 1) - this.low) / (this.high - this.low)) * h,
    };
  }

  private drawAxes({ start, end, w, h, x, y }: Frame): void {
    const { context: c, spec } = this;
    c.font = '11px system-ui, sans-serif';
    c.lineWidth = 1;
    c.strokeStyle = cssColor('--grid');
    c.fillStyle = cssColor('--soft');
    c.textAlign = 'right';
    c.textBaseline = 'middle';
    c.beginPath();
    for (const v of ticksBetween(this.low, this.high, 4)) {
      const at = Math.round(y(v / (spec.scale ?? 1))) + 0.5;
      c.moveTo(LEFT, at);
      c.lineTo(LEFT + w, at);
      c.fillText(short(v), LEFT - 6, at);
    }
    c.textAlign = 'center';
    c.textBaseline = 'top';
    for (const t of ticksBetween(start, end, 6)) {
      if (t < 0) continue;
      const at = Math.round(x(t)) + 0.5;
      c.moveTo(at, TOP);
      c.lineTo(at, TOP + h);
      if (at > LEFT + 8 && at < LEFT + w + RIGHT - 14) c.fillText(`${short(Number(t.toFixed(6)))} s`, at, TOP + h + 4);
    }
    c.stroke();
  }

  private drawLevel({ w, y }: Frame): void {
    const { context: c, spec } = this;
    const level = spec.level?.() ?? null;
    if (level === null) return;
    c.strokeStyle = cssColor('--accent');
    c.setLineDash([4, 4]);
    c.beginPath();
    c.moveTo(LEFT, y(level));
    c.lineTo(LEFT + w, y(level));
    c.stroke();
    c.setLineDash([]);
  }

  private drawSeries(series: SeriesSpec, { start, end, w, x, y }: Frame): void {
    const { context: c, buffer } = this;
    const track = series.track();
    const n = decimate(track, series.column, start, end, Math.max(1, Math.round(w)), buffer);
    c.lineJoin = 'round';
    c.strokeStyle = cssColor(series.color);
    c.lineWidth = series.width ?? 1.3;
    c.setLineDash(series.dash ?? []);
    c.beginPath();
    let pen = false;
    let previous = 0;
    for (let i = 0; i < n; i += 5) {
      const at = LEFT + (buffer[i] as number);
      const first = buffer[i + 1] as number;
      const least = buffer[i + 2] as number;
      const greatest = buffer[i + 3] as number;
      const last = buffer[i + 4] as number;
      if (!Number.isFinite(first) || !Number.isFinite(least)) {
        pen = false;
        continue;
      }
      if (!pen) c.moveTo(at, y(first));
      else if (series.hold) c.lineTo(at, previous);
      pen = true;
      c.lineTo(at, y(first));
      if (least !== greatest) for (const v of [least, greatest, last]) c.lineTo(at, y(v));
      previous = y(Number.isFinite(last) ? last : first);
    }
    if (pen && series.hold) c.lineTo(Math.min(LEFT + w, x(Math.max(end, track.lastTime))), previous);
    c.stroke();
    c.setLineDash([]);
  }

  private drawCursor({ start, end, h, x }: Frame): void {
    const { context: c } = this;
    const { cursor } = this.window;
    if (cursor === null || cursor < start || cursor > end) return;
    c.strokeStyle = cssColor('--text');
    c.globalAlpha = 0.55;
    c.lineWidth = 1;
    const at = Math.round(x(cursor)) + 0.5;
    c.beginPath();
    c.moveTo(at, TOP);
    c.lineTo(at, TOP + h);
    c.stroke();
    c.globalAlpha = 1;
  }

  /** The axis grows at once and shrinks when there is much room. */
  private rescale(start: number, end: number): void {
    const { spec } = this;
    let low = spec.fromZero ? 0 : Infinity;
    let high = spec.fromZero ? 0 : -Infinity;
    const extrema: [number, number] = [0, 0];
    for (const series of spec.series) {
      const track = series.track();
      track.extrema(series.column, track.indexAt(start), track.indexAt(end) + 1, extrema);
      low = Math.min(low, extrema[0] * (spec.scale ?? 1));
      high = Math.max(high, extrema[1] * (spec.scale ?? 1));
    }
    if (!Number.isFinite(low) || !Number.isFinite(high)) {
      low = 0;
      high = 0;
    }
    const least = spec.span ?? 1e-6;
    if (high - low < least) {
      const middle = spec.fromZero ? least / 2 : (low + high) / 2;
      low = middle - least / 2;
      high = middle + least / 2;
    }
    const margin = 0.08 * (high - low);
    if (!spec.fromZero) low -= margin;
    high += margin;
    const size = this.high - this.low;
    const outside = low < this.low || high > this.high;
    if (!(size > 0) || outside || high - low < 0.6 * size) {
      const step = niceAbove((high - low) / 8);
      this.low = spec.fromZero ? 0 : Math.floor(low / step) * step;
      this.high = Math.ceil(high / step) * step;
    }
  }
}

/** Bars of a histogram with a logarithmic axis of time, us. */
export class HistogramPlot {
  readonly element = document.createElement('section');
  private readonly canvas = document.createElement('canvas');
  private readonly context: CanvasRenderingContext2D;
  private readonly keys = document.createElement('div');
  private bins: [number, number][] = [];
  private hover = -1;
  private summary = '';

  constructor(
    private readonly title: string,
    private readonly color: string,
  ) {
    this.element.className = 'plot histogram';
    const header = document.createElement('header');
    const heading = document.createElement('h3');
    heading.textContent = title;
    this.keys.className = 'keys';
    header.append(heading, this.keys);
    this.element.append(header, this.canvas);
    this.canvas.setAttribute('role', 'img');
    this.context = this.canvas.getContext('2d') as CanvasRenderingContext2D;
    this.canvas.addEventListener('pointermove', (e) => {
      this.hover = e.clientX - this.canvas.getBoundingClientRect().left;
      this.draw();
    });
    this.canvas.addEventListener('pointerleave', () => {
      this.hover = -1;
      this.draw();
    });
  }

  set(h: { p50: number; p99: number; max: number; bins: [number, number][] }): void {
    let first = h.bins.findIndex(([, count]) => count > 0);
    if (first < 0) first = 0;
    let last = h.bins.length - 1;
    while (last > first && (h.bins[last]?.[1] ?? 0) === 0) --last;
    this.bins = h.bins.slice(Math.max(0, first - 1), last + 2);
    this.summary = `median ${short(h.p50)} us, 99 % ${short(h.p99)} us, max ${short(h.max)} us`;
    this.canvas.setAttribute('aria-label', `${this.title}: ${this.summary}`);
    this.draw();
  }

  draw(): void {
    const { canvas, context: c, bins } = this;
    const width = canvas.clientWidth;
    const height = canvas.clientHeight;
    if (width === 0) return;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    let most = 1;
    for (const [, count] of bins) most = Math.max(most, count);
    const w = width / Math.max(1, bins.length);
    const base = height - 16;
    const logMost = Math.log1p(most);
    c.font = '11px system-ui, sans-serif';
    c.textAlign = 'center';
    c.textBaseline = 'top';
    let text = this.summary;
    const every = Math.max(1, Math.ceil(bins.length / 6));
    bins.forEach(([edge, count], i) => {
      const top = base - (Math.log1p(count) / logMost) * (base - 4); // rare long ticks are what one looks for
      const under = this.hover >= i * w && this.hover < (i + 1) * w;
      c.fillStyle = cssColor(under ? '--text' : this.color);
      c.fillRect(i * w + 1, top, Math.max(1, w - 2), base - top);
      if (under) text = `up to ${short(edge)} us: ${count}`;
      c.fillStyle = cssColor('--soft');
      const last = Math.min(width - 16, Math.max(12, (i + 1) * w));
      if (i % every === every - 1) c.fillText(short(edge), last, base + 3);
    });
    c.fillStyle = cssColor('--grid');
    c.fillRect(0, base, width, 1);
    if (this.keys.textContent !== text) this.keys.textContent = text;
  }
}
