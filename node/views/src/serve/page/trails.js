// What the page keeps of each damper: all points of the last minute, and extremes over tenths of a second for ten minutes.
//
// Memory is bounded: a trail is a window over typed arrays of constant size. Times are seconds since the damper's first sample; NaN
// is unknown and breaks a line.

/** Each series with its number of values, in the order of the stream. */
export const SERIES = { estimate: 4, measured: 1, residual: 1, velocity: 1, command: 3, displacement: 1, drive: 1 };
/** Points that are further apart than this, in seconds, are not connected. */
export const GAP_S = 0.25;
/** Points are kept for this time, s. The server sends at most 256 of them a second. */
export const POINTS_S = 62;
const MOST_POINTS = 256 * POINTS_S;
/** Buckets of the longest window, and some more. */
const MOST_BUCKETS = 6100;

/** Rows of numbers in order of time: the last `most` of them. */
class Rows {
  constructor(columns, most) {
    this.most = most;
    this.columns = columns;
    this.allocate(1024);
    this.from = this.end = 0;
  }

  allocate(size) {
    const old = this.t, values = this.v;
    this.t = new Float64Array(size);
    this.v = Array.from({ length: this.columns }, () => new Float32Array(size));
    if (old) {
      this.t.set(old);
      this.v.forEach((column, k) => column.set(values[k]));
    }
  }

  get length() {
    return this.end - this.from;
  }

  /** Adds a row `[time, value, ...]`, unless it is not later than the newest. */
  push(row) {
    if (this.end > this.from && row[0] <= this.t[this.end - 1]) return;
    if (this.end === this.t.length) this.makeRoom();
    this.t[this.end] = row[0];
    for (let k = 0; k < this.columns; k++) this.v[k][this.end] = row[k + 1] ?? NaN;
    this.end++;
    if (this.length > this.most) this.from = this.end - this.most;
  }

  /** Arrays grow up to twice the kept rows; then the kept rows move to the front, which is rare and cheap. */
  makeRoom() {
    if (this.t.length < 2 * this.most) return this.allocate(Math.min(2 * this.t.length, 2 * this.most));
    this.t.copyWithin(0, this.from, this.end);
    for (const column of this.v) column.copyWithin(0, this.from, this.end);
    [this.from, this.end] = [0, this.length];
  }

  /** Index of the first row at or after `time`. */
  find(time) {
    let low = this.from, high = this.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.t[middle] < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  first() {
    return this.length ? this.t[this.from] : null;
  }

  last() {
    return this.length ? this.t[this.end - 1] : null;
  }

  /** Removes the rows from `time` on. */
  cut(time) {
    this.end = this.find(time);
  }

  clear() {
    this.from = this.end = 0;
  }
}

/** A series: its points, and its buckets with the smallest and largest of each value. */
export class Trail {
  constructor(columns) {
    this.columns = columns;
    this.points = new Rows(columns, MOST_POINTS);
    this.buckets = new Rows(2 * columns, MOST_BUCKETS);
  }

  clear() {
    this.points.clear();
    this.buckets.clear();
  }

  /** The time from which points are drawn; before it, buckets. */
  border() {
    return this.points.first() ?? Infinity;
  }

  /** Smallest and largest of the columns between two times. */
  extremes(from, to, ...columns) {
    let low = Infinity, high = -Infinity;
    const hold = (value) => {
      if (value < low) low = value;
      if (value > high) high = value;
    };
    const { points, buckets } = this;
    const begin = points.find(from), end = points.find(to);
    for (const column of columns) for (let k = begin; k < end; k++) hold(points.v[column][k]);
    const until = buckets.find(Math.min(to, this.border()));
    for (let k = buckets.find(from); k < until; k++) for (const column of columns) {
      hold(buckets.v[2 * column][k]);
      hold(buckets.v[2 * column + 1][k]);
    }
    return [low, high];
  }

  /** The values at `time`: a list of numbers from points, of pairs from buckets; null without a value near it. */
  at(time) {
    const { points, buckets } = this;
    if (time >= this.border()) {
      let k = points.find(time);
      if (k > points.from && (k === points.end || time - points.t[k - 1] < points.t[k] - time)) k--;
      if (k >= points.end || Math.abs(points.t[k] - time) > GAP_S / 2) return null;
      return points.v.map((column) => column[k]);
    }
    const k = buckets.find(time + 1e-9) - 1;
    if (k < buckets.from || time - buckets.t[k] > GAP_S) return null;
    return Array.from({ length: this.columns }, (_, c) => [buckets.v[2 * c][k], buckets.v[2 * c + 1][k]]);
  }
}

/** All series of a damper. */
export class Trails {
  constructor() {
    for (const [name, columns] of Object.entries(SERIES)) this[name] = new Trail(columns);
    this.era = null;
    this.zero = null;
    this.bucket = 0.1;
    /** The time up to which the server was asked for buckets. */
    this.asked = -Infinity;
  }

  all() {
    return Object.keys(SERIES).map((name) => this[name]);
  }

  clear() {
    for (const trail of this.all()) trail.clear();
    this.asked = -Infinity;
  }

  /**
   * Adds points of the stream. Points of another era, or of another server, replace all earlier ones; then it returns true. `after`
   * is true if points before these may be missing, because the stream was interrupted: buckets then take the place of the earlier points.
   */
  add(points, after) {
    const zero = points.zero_ns ?? null;
    const anew = points.era !== this.era || zero !== this.zero;
    if (anew) {
      this.clear();
      [this.era, this.zero] = [points.era, zero];
    }
    for (const name of Object.keys(SERIES)) {
      const kept = this[name].points, rows = points[name] ?? [];
      if (after && rows.length && kept.length && rows[0][0] - kept.last() > GAP_S) kept.clear();
      for (const row of rows) kept.push(row);
    }
    return anew;
  }

  /** Adds buckets of `/history`. The newest bucket that is kept may have been incomplete, so it is replaced. */
  addHistory(history) {
    if (history.era !== this.era || (history.zero_ns ?? null) !== this.zero) return;
    this.bucket = history.bucket_s;
    for (const name of Object.keys(SERIES)) {
      const rows = history[name] ?? [], { buckets } = this[name];
      if (rows.length) buckets.cut(rows[0][0] - 1e-6);
      for (const row of rows) buckets.push(row);
    }
    this.asked = this.newest() ?? -Infinity;
  }

  newest() {
    const times = [this.estimate, this.measured].map(({ points }) => points.last()).filter((time) => time !== null);
    return times.length ? Math.max(...times) : null;
  }

  /** True if `from` is before the kept points, so that a chart from there needs buckets. */
  precedes(from) {
    const first = Math.min(...this.all().map((trail) => trail.border()));
    return Number.isFinite(first) && from < first - 0.05;
  }

  /** True if a chart from `from` on needs buckets that the page does not have. */
  lacks(from) {
    return this.precedes(from) && this.asked < Math.min(...this.all().map((trail) => trail.border())) + 1;
  }
}
