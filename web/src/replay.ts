// A recorded run: its frames by time, its samples as history.
import { decodeRecording, type Frame, type Geometry, type RunState, type SceneInfo } from './protocol.ts';
import { RunHistory, TICKS } from './run_history.ts';

/** Frames between two changes of scene or handle. */
interface Part {
  scene: SceneInfo;
  geometry: Geometry;
  state: RunState | null;
  /** added to the times of its messages, so that time rises through the whole recording, s */
  offset: number;
  frames: Frame[];
}

export interface ReplayMoment {
  part: number;
  a: Frame;
  b: Frame;
  /** share of the way from a to b */
  t: number;
}

export class Replay {
  readonly parts: Part[] = [];
  /** s */
  start = 0;
  end = 0;
  time = 0;
  playing = true;
  speed = 1;
  readonly history = new RunHistory();

  private constructor(readonly complaint: string | null) {}

  /** Reads a recording. A text says why it cannot be shown. */
  static read(buffer: ArrayBuffer): Replay | string {
    const recording = decodeRecording(buffer);
    if ('type' in recording) return recording.reason;
    const replay = new Replay(recording.complaint);
    const history = replay.history;
    let scene: SceneInfo | null = null;
    let part: Part | null = null;
    let newest = 0;
    for (const message of recording.messages) {
      switch (message.type) {
        case 'scene':
          scene = message;
          break;
        case 'geometry':
          if (scene) {
            part = { scene, geometry: message, state: null, offset: replay.parts.length === 0 ? 0 : newest, frames: [] };
            replay.parts.push(part);
          }
          break;
        case 'state':
          if (part) part.state = message;
          break;
        case 'frame':
          if (part && message.generation === part.geometry.generation && message.nodes.length > 0) {
            const frame = { ...message, time: message.time + part.offset };
            // A server may record more than one frame of a step.
            if (frame.time < newest && part.frames.length > 0) break;
            part.frames.push(frame);
            newest = Math.max(newest, frame.time);
          }
          break;
        case 'samples':
          if (part && message.generation === part.geometry.generation) {
            history.append(message, part.offset);
            newest = Math.max(newest, history.ticks.lastTime);
          }
          break;
        default:
      }
    }
    const frames = replay.parts.flatMap((p) => p.frames);
    const first = frames[0];
    if (!first) return 'the recording holds no frames';
    replay.start = first.time;
    replay.end = Math.max((frames[frames.length - 1] as Frame).time, history.ticks.lastTime);
    replay.time = replay.start;
    return replay;
  }

  advance(seconds: number): void {
    if (!this.playing) return;
    this.time += seconds * this.speed;
    if (this.time >= this.end) {
      this.time = this.end;
      this.playing = false;
    }
  }

  seek(time: number): void {
    this.time = Math.min(this.end, Math.max(this.start, time));
  }

  play(on: boolean): void {
    if (on && this.time >= this.end) this.time = this.start;
    this.playing = on;
  }

  /** Goes to the next or previous frame. */
  stepFrame(forward: boolean): void {
    this.playing = false;
    const times = this.parts.flatMap((p) => p.frames.map((f) => f.time));
    const next = forward
      ? times.find((t) => t > this.time + 1e-9)
      : [...times].reverse().find((t) => t < this.time - 1e-9);
    if (next !== undefined) this.time = next;
  }

  /** The two frames around the present time. */
  moment(): ReplayMoment | null {
    let index = -1;
    this.parts.forEach((part, i) => {
      const first = part.frames[0];
      if (first && (first.time <= this.time || index < 0)) index = i;
    });
    const part = this.parts[index];
    if (!part) return null;
    let low = 0;
    let high = part.frames.length;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if ((part.frames[middle] as Frame).time <= this.time) low = middle + 1;
      else high = middle;
    }
    const a = part.frames[Math.max(0, low - 1)] as Frame;
    const b = part.frames[Math.min(part.frames.length - 1, low)] as Frame;
    const span = b.time - a.time;
    return { part: index, a, b, t: span > 0 ? Math.min(1, Math.max(0, (this.time - a.time) / span)) : 0 };
  }

  /** The wrench sent at the present time; that of frame `a` where the recording has no ticks. */
  wrench(a: Frame, out: Float32Array): void {
    const { ticks } = this.history;
    const row = ticks.indexAt(this.time + 1e-9) - 1;
    if (row < ticks.first) {
      out.set(a.wrench);
      return;
    }
    for (let i = 0; i < 6; ++i) out[i] = ticks.value(TICKS.sent + i, row) || 0;
  }
}
