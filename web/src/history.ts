// Every row received since the run began, in growing chunks of typed arrays, with the extrema of each block of rows beside
// them so that twenty minutes at 1 kHz can be drawn without looking at each value.

const CHUNK_ROWS = 16384;
const BLOCK_ROWS = 64;

interface Chunk {
  times: Float64Array;
  /** column after column */
  values: Float32Array;
  low: Float32Array;
  high: Float32Array;
}

/** Rows of `columns` values at rising times. Rows are counted from the first ever; the oldest go when `capacity` is full. */
export class Track {
  private chunks: Chunk[] = [];
  private dropped = 0;
  private end = 0;

  constructor(
    readonly columns: number,
    private readonly capacity: number,
  ) {}

  /** first row still held */
  get first(): number {
    return this.dropped;
  }

  /** one past the newest row */
  get length(): number {
    return this.end;
  }

  get empty(): boolean {
    return this.end === this.dropped;
  }

  clear(): void {
    this.chunks = [];
    this.dropped = 0;
    this.end = 0;
  }

  append(time: number, row: ArrayLike<number>): void {
    const slot = (this.end - this.dropped) % CHUNK_ROWS;
    if (slot === 0 && this.end - this.dropped === this.chunks.length * CHUNK_ROWS) this.grow();
    const chunk = this.chunks[this.chunks.length - 1] as Chunk;
    chunk.times[slot] = time;
    const block = Math.floor(slot / BLOCK_ROWS);
    const blocks = CHUNK_ROWS / BLOCK_ROWS;
    for (let c = 0; c < this.columns; ++c) {
      const value = row[c] ?? NaN;
      chunk.values[c * CHUNK_ROWS + slot] = value;
      const b = c * blocks + block;
      if (value < (chunk.low[b] as number)) chunk.low[b] = value;
      if (value > (chunk.high[b] as number)) chunk.high[b] = value;
    }
    ++this.end;
  }

  private grow(): void {
    if (this.chunks.length * CHUNK_ROWS >= this.capacity) {
      this.chunks.shift();
      this.dropped += CHUNK_ROWS;
    }
    const blocks = CHUNK_ROWS / BLOCK_ROWS;
    this.chunks.push({
      times: new Float64Array(CHUNK_ROWS),
      values: new Float32Array(CHUNK_ROWS * this.columns),
      low: new Float32Array(blocks * this.columns).fill(Infinity),
      high: new Float32Array(blocks * this.columns).fill(-Infinity),
    });
  }

  time(row: number): number {
    const at = row - this.dropped;
    return this.chunks[Math.floor(at / CHUNK_ROWS)]?.times[at % CHUNK_ROWS] ?? NaN;
  }

  value(column: number, row: number): number {
    const at = row - this.dropped;
    return this.chunks[Math.floor(at / CHUNK_ROWS)]?.values[column * CHUNK_ROWS + (at % CHUNK_ROWS)] ?? NaN;
  }

  get firstTime(): number {
    return this.empty ? 0 : this.time(this.dropped);
  }

  get lastTime(): number {
    return this.empty ? 0 : this.time(this.end - 1);
  }

  /** First row at or after `time`; `length` if there is none. */
  indexAt(time: number): number {
    let low = this.dropped;
    let high = this.end;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (this.time(middle) < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** Least and greatest value of a column in rows [from, to), NaN left out; `out` becomes +inf, -inf where there is none. */
  extrema(column: number, from: number, to: number, out: [number, number]): void {
    let least = Infinity;
    let greatest = -Infinity;
    const blocks = CHUNK_ROWS / BLOCK_ROWS;
    let at = Math.max(from, this.dropped) - this.dropped;
    const stop = Math.min(to, this.end) - this.dropped;
    while (at < stop) {
      const chunk = this.chunks[Math.floor(at / CHUNK_ROWS)] as Chunk;
      const slot = at % CHUNK_ROWS;
      if (slot % BLOCK_ROWS === 0 && at + BLOCK_ROWS <= stop) {
        const b = column * blocks + slot / BLOCK_ROWS;
        const low = chunk.low[b] as number;
        const high = chunk.high[b] as number;
        if (low < least) least = low;
        if (high > greatest) greatest = high;
        at += BLOCK_ROWS;
      } else {
        const value = chunk.values[column * CHUNK_ROWS + slot] as number;
        if (value < least) least = value;
        if (value > greatest) greatest = value;
        ++at;
      }
    }
    out[0] = least;
    out[1] = greatest;
  }
}

/**
 * What a line of `pixels` columns over [t0, t1) has to show: for each column of pixels that has rows first, least, greatest
 * and last value. Joined in this order the line covers the pixels that the line through all rows covers: no extremum is lost.
 * Returns the number of values in `out`, five a column: x, first, least, greatest, last.
 */
export function decimate(
  track: Track,
  column: number,
  t0: number,
  t1: number,
  pixels: number,
  out: Float32Array,
): number {
  if (track.empty || !(t1 > t0) || pixels < 1) return 0;
  const extrema: [number, number] = [0, 0];
  let n = 0;
  // One row before and one after, so that the line goes on to the edges.
  let from = Math.max(track.first, track.indexAt(t0) - 1);
  const stop = Math.min(track.length, track.indexAt(t1) + 1);
  const scale = pixels / (t1 - t0);
  while (from < stop && n + 5 <= out.length) {
    const x = Math.floor((track.time(from) - t0) * scale);
    let to = x < 0 ? from + 1 : track.indexAt(t0 + (x + 1) / scale);
    if (to <= from) to = from + 1;
    if (to > stop) to = stop;
    if (to === from + 1) {
      // A row of its own keeps its place between the pixels.
      const value = track.value(column, from);
      out[n] = (track.time(from) - t0) * scale;
      out[n + 1] = out[n + 2] = out[n + 3] = out[n + 4] = value;
    } else {
      track.extrema(column, from, to, extrema);
      out[n] = x + 0.5;
      out[n + 1] = track.value(column, from);
      out[n + 2] = extrema[0];
      out[n + 3] = extrema[1];
      out[n + 4] = track.value(column, to - 1);
    }
    n += 5;
    from = to;
  }
  return n;
}
