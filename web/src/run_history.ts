// Ticks and visual steps of the run as tracks, and their tables for download.
import { STEP, STEP_STRIDE, TICK, TICK_STRIDE, type Samples } from './protocol.ts';
import { Track } from './history.ts';

/** Columns of the tick track; wrenches are force x y z [N], torque x y z [N m]. */
export const TICKS = { sent: 0, raw: 6, vc: 12, flags: 18, sentForce: 19, vcForce: 20, sentTorque: 21, vcTorque: 22 };
const TICK_COLUMNS = 23;

/** Columns of the step track: those of the message without the time, then magnitudes. */
export const STEPS = {
  wrench: STEP.wrench - 1,
  milliseconds: STEP.milliseconds - 1,
  lateness: STEP.lateness - 1,
  found: STEP.found - 1,
  reduced: STEP.reduced - 1,
  active: STEP.active - 1,
  kinetic: STEP.kinetic - 1,
  elastic: STEP.elastic - 1,
  force: STEP_STRIDE - 1,
  torque: STEP_STRIDE,
};
const STEP_COLUMNS = STEP_STRIDE + 1;

const TWENTY_MINUTES_OF_TICKS = 1_200_000;
const TWENTY_MINUTES_OF_STEPS = 200_000;

const magnitude = (values: ArrayLike<number>, at: number): number =>
  Math.hypot(values[at] ?? 0, values[at + 1] ?? 0, values[at + 2] ?? 0);

export class RunHistory {
  readonly ticks = new Track(TICK_COLUMNS, TWENTY_MINUTES_OF_TICKS);
  readonly steps = new Track(STEP_COLUMNS, TWENTY_MINUTES_OF_STEPS);
  /** ticks that this page has not been sent */
  lost = 0;
  /** ticks received */
  received = 0;
  private readonly row = new Float32Array(Math.max(TICK_COLUMNS, STEP_COLUMNS));

  clear(): void {
    this.ticks.clear();
    this.steps.clear();
    this.lost = 0;
    this.received = 0;
  }

  /** `offset` [s] is added to the times; recordings of several runs need it. */
  append(samples: Samples, offset = 0): void {
    const row = this.row;
    if (samples.lost > 0) {
      this.lost += samples.lost;
      if (!this.ticks.empty) this.ticks.append(this.ticks.lastTime, row.fill(NaN)); // lines break here
    }
    for (let k = 0; k < samples.tickCount; ++k) {
      const at = k * TICK_STRIDE;
      const source = samples.ticks;
      for (let c = 0; c < 18; ++c) row[c] = source[at + TICK.sent + c] as number;
      row[TICKS.flags] = samples.tickBits[at + TICK.flags] as number;
      row[TICKS.sentForce] = magnitude(source, at + TICK.sent);
      row[TICKS.sentTorque] = magnitude(source, at + TICK.sent + 3);
      row[TICKS.vcForce] = magnitude(source, at + TICK.vc);
      row[TICKS.vcTorque] = magnitude(source, at + TICK.vc + 3);
      this.ticks.append(offset + samples.t0 + (source[at] as number), row);
    }
    this.received += samples.tickCount;
    for (let k = 0; k < samples.stepCount; ++k) {
      const at = k * STEP_STRIDE;
      const source = samples.steps;
      for (let c = 1; c < STEP_STRIDE; ++c) row[c - 1] = source[at + c] as number;
      row[STEPS.force] = magnitude(source, at + STEP.wrench);
      row[STEPS.torque] = magnitude(source, at + STEP.wrench + 3);
      this.steps.append(offset + samples.t0 + (source[at] as number), row);
    }
  }
}

const AXES = ['fx', 'fy', 'fz', 'tx', 'ty', 'tz'];
const wrenchNames = (prefix: string): string[] => AXES.map((a) => `${prefix}_${a}_${a[0] === 'f' ? 'N' : 'Nm'}`);

const TICK_HEADER = ['time_s', ...wrenchNames('sent'), ...wrenchNames('raw'), ...wrenchNames('vc'), 'flags'];
const STEP_HEADER = [
  'time_s',
  ...wrenchNames('visual'),
  ...['step', 'assemble', 'factorize', 'solve', 'contact', 'advance', 'linearization', 'lateness'].map((n) => `${n}_ms`),
  'contacts_found',
  'contacts',
  'contacts_active',
  'contacts_sticking',
  'contacts_sliding',
  'solver_iterations',
  'solver_residual_m_s',
  'penetration_m',
  'kinetic_energy_J',
  'elastic_energy_J',
  'status',
  'substeps',
];

/** Nine digits give back the same f32; no more than that was received. */
const shortest = (value: number): string => (Number.isFinite(value) ? String(Number(value.toPrecision(9))) : 'nan');

function* rows(track: Track, header: string[], columns: number): Generator<string> {
  yield header.join(',') + '\n';
  const part: string[] = [];
  for (let row = track.first; row < track.length; ++row) {
    if (Number.isNaN(track.value(0, row))) continue; // marks lost ticks
    let line = String(Number(track.time(row).toFixed(6)));
    for (let c = 0; c < columns; ++c) line += ',' + shortest(track.value(c, row));
    part.push(line);
    if (part.length === 4096) {
      yield part.join('\n') + '\n';
      part.length = 0;
    }
  }
  if (part.length > 0) yield part.join('\n') + '\n';
}

/** Parts of a CSV file: a row a tick. */
export const tickTable = (history: RunHistory): string[] => [
  ...rows(history.ticks, TICK_HEADER, TICK_HEADER.length - 1),
];

/** Parts of a CSV file: a row a visual step. */
export const stepTable = (history: RunHistory): string[] => [
  ...rows(history.steps, STEP_HEADER, STEP_HEADER.length - 1),
];
