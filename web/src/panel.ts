// The plots beside the scene.
import { element, input, setText } from './dom.ts';
import type { Track } from './history.ts';
import { HistogramPlot, Plot, TimeWindow, type SeriesSpec } from './plots.ts';
import type { Stats } from './protocol.ts';
import { STEPS, TICKS, type RunHistory } from './run_history.ts';

const AXES: [string, string][] = [
  ['x', '--x'],
  ['y', '--y'],
  ['z', '--z'],
];

/** What the method plot shows: offset within a wrench, or the magnitudes' columns. */
const DIRECTIONS: { label: string; sent: number; vc: number; visual: number; torque: boolean }[] = [
  { label: 'force, size', sent: TICKS.sentForce, vc: TICKS.vcForce, visual: STEPS.force, torque: false },
  ...['x', 'y', 'z'].map((axis, i) => ({
    label: `force ${axis}`,
    sent: TICKS.sent + i,
    vc: TICKS.vc + i,
    visual: STEPS.wrench + i,
    torque: false,
  })),
  { label: 'torque, size', sent: TICKS.sentTorque, vc: TICKS.vcTorque, visual: STEPS.torque, torque: true },
  ...['x', 'y', 'z'].map((axis, i) => ({
    label: `torque ${axis}`,
    sent: TICKS.sent + 3 + i,
    vc: TICKS.vc + 3 + i,
    visual: STEPS.wrench + 3 + i,
    torque: true,
  })),
];

export class Panel {
  readonly time = new TimeWindow();
  readonly plots: Plot[] = [];
  private readonly tick = new HistogramPlot('Tick', '--z');
  private readonly wake = new HistogramPlot('Wake-up', '--y');
  private lastRead = 0;

  constructor(
    private history: RunHistory,
    visualStep: () => number | null,
  ) {
    const ticks = (): Track => this.history.ticks;
    const steps = (): Track => this.history.steps;
    const axes = (from: number): SeriesSpec[] =>
      AXES.map(([label, color], i) => ({ label, color, track: ticks, column: from + i }));
    this.add({ title: 'Force', unit: 'N', series: axes(TICKS.sent), span: 0.2 });
    this.add({ title: 'Torque', unit: 'mN m', series: axes(TICKS.sent + 3), scale: 1000, digits: 1, span: 5 });
    this.addMethod();
    this.add({
      title: 'Energy',
      unit: 'mJ',
      series: [
        { label: 'elastic', color: '--visual', track: steps, column: STEPS.elastic, hold: true },
        { label: 'kinetic', color: '--z', track: steps, column: STEPS.kinetic, hold: true },
      ],
      scale: 1000,
      span: 0.1,
      fromZero: true,
    });
    this.add({
      title: 'Visual step',
      unit: 'ms',
      series: [
        { label: 'step', color: '--felt', track: steps, column: STEPS.milliseconds, hold: true },
        { label: 'contact', color: '--x', track: steps, column: STEPS.milliseconds + 4, hold: true },
        { label: 'factor', color: '--z', track: steps, column: STEPS.milliseconds + 2, hold: true },
        { label: 'linear', color: '--vc', track: steps, column: STEPS.milliseconds + 6, hold: true },
      ],
      span: 1,
      fromZero: true,
      digits: 1,
      level: () => {
        const step = visualStep();
        return step === null ? null : step * 1000;
      },
    });
    element('histograms').append(this.tick.element, this.wake.element);
  }

  private add(spec: ConstructorParameters<typeof Plot>[0], extra: HTMLElement | null = null): Plot {
    const plot = new Plot(spec, this.time, extra);
    this.plots.push(plot);
    element('plots').append(plot.element);
    return plot;
  }

  /** Felt at 1 kHz, computed at each visual step, and what virtual coupling would give: what the method is for. */
  private addMethod(): void {
    const ticks = (): Track => this.history.ticks;
    const steps = (): Track => this.history.steps;
    const choice = document.createElement('select');
    choice.setAttribute('aria-label', 'Direction');
    choice.title = 'Direction';
    choice.append(...DIRECTIONS.map(({ label }, i) => new Option(label, String(i))));
    const series = (): SeriesSpec[] => {
      const d = DIRECTIONS[Number(choice.value)] ?? DIRECTIONS[0]!;
      return [
        { label: 'coupling', color: '--vc', track: ticks, column: d.vc, dash: [5, 3] },
        { label: 'visual', color: '--visual', track: steps, column: d.visual, hold: true, width: 1.6 },
        { label: 'felt', color: '--felt', track: ticks, column: d.sent, width: 1.6 },
      ];
    };
    const plot = this.add({ title: 'Method', unit: '', series: series(), span: 0.2 }, choice);
    choice.addEventListener('change', () => {
      const torque = DIRECTIONS[Number(choice.value)]?.torque === true;
      plot.spec.scale = torque ? 1000 : 1;
      plot.spec.digits = torque ? 1 : 2;
      plot.spec.span = torque ? 5 : 0.2;
      plot.setSeries(series());
      setText(plot.element.querySelector('small') as HTMLElement, torque ? 'mN m' : 'N');
    });
    setText(plot.element.querySelector('small') as HTMLElement, 'N');
  }

  /** Another run's history. */
  show(history: RunHistory): void {
    this.history = history;
    this.time.cursor = null;
    this.time.now();
  }

  stats(stats: Stats): void {
    this.tick.set(stats.tickUs);
    this.wake.set(stats.wakeUs);
    const share = `Server: ${(100 * stats.serverShare).toFixed(1)} % of a core.`;
    setText(element('realtime'), stats.realtime === null ? share : `${share} Real time: ${stats.realtime}.`);
  }

  redrawHistograms(): void {
    this.tick.draw();
    this.wake.draw();
  }

  draw(now: number): void {
    const { ticks, steps } = this.history;
    this.time.set(Math.min(ticks.firstTime, steps.firstTime), Math.max(ticks.lastTime, steps.lastTime));
    for (const plot of this.plots) plot.draw();
    if (now - this.lastRead > 90) {
      this.lastRead = now;
      for (const plot of this.plots) plot.read();
    }
  }
}

/** A slider that tells its value while it moves and sends it at most ten times a second. */
export class Slider {
  private readonly control: HTMLInputElement;
  private readonly shown: HTMLElement;
  private touchedAt = -Infinity;
  private timer = 0;

  constructor(
    id: string,
    private readonly toValue: (position: number) => number,
    private readonly toPosition: (value: number) => number,
    private readonly format: (value: number) => string,
    send: (value: number) => void,
  ) {
    this.control = input(id);
    this.shown = element(`${id}-value`);
    this.control.addEventListener('input', () => {
      this.touchedAt = performance.now();
      this.tell();
      if (this.timer) return;
      this.timer = window.setTimeout(() => {
        this.timer = 0;
        send(this.value);
      }, 100);
    });
  }

  get value(): number {
    return this.toValue(Number(this.control.value));
  }

  private tell(): void {
    const text = this.format(this.value);
    setText(this.shown, text);
    this.control.setAttribute('aria-valuetext', text);
  }

  /** What the program says; not while one moves it. */
  set(value: number): void {
    if (performance.now() - this.touchedAt < 800) return;
    this.control.value = String(this.toPosition(value));
    setText(this.shown, this.format(value));
    this.control.setAttribute('aria-valuetext', this.format(value));
  }
}
