// The charts of a damper, each on a canvas: lines over time, and force over velocity.
//
// This file does not use the server or the clock: the window of time is an argument. A line with more points than columns of pixels is
// drawn by the smallest and largest value of each column, so that no spike is lost.

import { GAP_S } from "/trails.js";

const LOOP_S = 2;
/** Number of steps in which a loop fades with age. */
const FADES = 5;
export const MODES = ["arx", "arx_coast", "model", "hold", "fault"];
export const LEFT = 52, RIGHT = 10;
const BOTTOM = 20, TOP = 8;

/** Colours of the style sheet, which follow the light or dark mode. */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "soft", "rule", "paper", "measured", "estimate", "estimate-wide", "residual", "command", "motion", "band", "focus", ...MODES];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

/** About `most` round values between low and high, with their labels. */
export function ticks(low, high, most) {
  const raw = (high - low) / Math.max(most, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const all = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++) {
    all.push([k * step, (k * step).toFixed(digits).replace(/^-(?=[\d.]*[1-9])/, "−").replace(/^-/, "")]);
  }
  return all;
}

/** A range that grows immediately and shrinks slowly, so that axes do not jitter. */
export class Range {
  constructor(least) {
    this.least = least;
    this.low = this.high = null;
  }

  /** Adapts the range to contain low and high. Infinite values mean that there are no points. */
  hold(low, high, atOnce = false) {
    if (!Number.isFinite(low) || !Number.isFinite(high)) [low, high] = [-this.least, this.least];
    const room = Math.max((high - low) * 0.06, this.least - (high - low) / 2);
    [low, high] = [low - room, high + room];
    const toward = (from, to, outward) => (from === null || outward || atOnce ? to : from + (to - from) * 0.03);
    this.low = toward(this.low, low, low < this.low);
    this.high = toward(this.high, high, high > this.high);
    return this;
  }
}

/** Clears a canvas and sets its resolution to the screen's; returns its context and its size in CSS pixels. */
function begin(canvas) {
  const scale = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const ctx = canvas.getContext("2d");
  ctx.setTransform(scale, 0, 0, scale, 0, 0);
  ctx.clearRect(0, 0, width, height);
  ctx.font = "12px system-ui, sans-serif";
  ctx.lineJoin = "bevel";
  return { ctx, width, height };
}

/** Maps from values to pixels, for the ranges x and y. */
function placing({ width, height }, x, y) {
  return {
    x: (value) => LEFT + ((value - x.low) / (x.high - x.low)) * (width - LEFT - RIGHT),
    y: (value) => TOP + (1 - (value - y.low) / (y.high - y.low)) * (height - TOP - BOTTOM),
  };
}

function axes({ ctx, width, height }, at, y, xTicks, ink) {
  ctx.lineWidth = 1;
  ctx.textBaseline = "middle";
  ctx.textAlign = "right";
  const most = (height - TOP - BOTTOM) / 34, coarse = ticks(y.low, y.high, Math.max(2.5, most));
  for (const [value, text] of coarse.length < 3 ? ticks(y.low, y.high, 5) : coarse) {
    ctx.strokeStyle = Number(text) === 0 ? ink.soft : ink.rule;
    ctx.beginPath();
    ctx.moveTo(LEFT, Math.round(at.y(value)) + 0.5);
    ctx.lineTo(width - RIGHT, Math.round(at.y(value)) + 0.5);
    ctx.stroke();
    ctx.fillStyle = ink.soft;
    ctx.fillText(text, LEFT - 6, at.y(value));
  }
  ctx.textBaseline = "alphabetic";
  for (const [value, text] of xTicks) {
    ctx.strokeStyle = ink.rule;
    ctx.beginPath();
    ctx.moveTo(Math.round(at.x(value)) + 0.5, TOP);
    ctx.lineTo(Math.round(at.x(value)) + 0.5, height - BOTTOM);
    ctx.stroke();
    ctx.fillStyle = ink.soft;
    ctx.textAlign = at.x(value) > width - 30 ? "right" : "center";
    ctx.fillText(text, Math.min(at.x(value), width - 2), height - 5);
  }
}

/** Draws with clipping to the area within the axes. */
function within({ ctx, width, height }, draw) {
  ctx.save();
  ctx.beginPath();
  ctx.rect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM);
  ctx.clip();
  draw(ctx);
  ctx.restore();
}

// ---- lines with many points

/** Result of `reduce`: time, smallest and largest value of each column of pixels; NaN breaks a line. */
const T = new Float64Array(16384), LOW = new Float64Array(16384), HIGH = new Float64Array(16384);

/**
 * Reduces a trail to one entry for each column of pixels between two times, and returns the number of entries. `low` and `high` are
 * columns of the trail. Columns of pixels are fixed in time, so that a scrolling line does not flicker.
 */
function reduce(trail, low, high, from, to, width) {
  const cell = Math.max(1e-9, (to - from) / Math.max(width, 1)), { points, buckets } = trail, border = trail.border();
  let n = 0, column = NaN, last = NaN;
  const add = (t, smallest, largest, gap) => {
    if (n + 2 > T.length) return;
    if (t - last > gap) column = T[n++] = NaN;
    last = t;
    if (Number.isNaN(smallest) || Number.isNaN(largest)) {
      column = T[n++] = NaN;
      return;
    }
    const own = Math.floor(t / cell);
    if (own === column) {
      if (smallest < LOW[n - 1]) LOW[n - 1] = smallest;
      if (largest > HIGH[n - 1]) HIGH[n - 1] = largest;
      return;
    }
    column = own;
    [T[n], LOW[n], HIGH[n]] = [t, smallest, largest];
    n++;
  };
  if (from < border) {
    const end = buckets.find(Math.min(to, border));
    for (let k = Math.max(buckets.from, buckets.find(from) - 1); k < end; k++) {
      add(buckets.t[k], buckets.v[2 * low][k], buckets.v[2 * high + 1][k], GAP_S);
    }
  }
  const end = Math.min(points.end, points.find(to) + 1), a = points.v[low], b = points.v[high];
  for (let k = Math.max(points.from, points.find(from) - 1); k < end; k++) add(points.t[k], a[k], b[k], GAP_S);
  return n;
}

/** A long path is drawn in pieces of this many columns: software drawing takes much longer for one path with many edges. */
const PIECE = 32;

function strokeReduced(ctx, n, at, scale) {
  ctx.beginPath();
  let open = false, x = 0, before = 0, edges = 0;
  for (let k = 0; k < n; k++) {
    if (Number.isNaN(T[k])) {
      open = false;
      continue;
    }
    if (open && ++edges % PIECE === 0) {
      ctx.stroke();
      ctx.beginPath();
      ctx.moveTo(x, before);
    }
    x = at.x(T[k]);
    const low = at.y(scale * LOW[k]);
    if (!open) ctx.moveTo(x, low);
    if (LOW[k] === HIGH[k]) ctx.lineTo(x, (before = low));
    else {
      const high = at.y(scale * HIGH[k]);
      // The end nearer to the line comes first.
      const lowFirst = open && Math.abs(before - low) < Math.abs(before - high);
      ctx.lineTo(x, lowFirst ? low : high);
      ctx.lineTo(x, (before = lowFirst ? high : low));
    }
    open = true;
  }
  ctx.stroke();
}

/** Fills between the smallest and largest values, as one rectangle for each column of pixels, which is faster than an area. */
function fillReduced(ctx, n, at) {
  for (let k = 0; k + 1 < n; k++) {
    if (Number.isNaN(T[k]) || Number.isNaN(T[k + 1])) continue;
    const x = Math.round(at.x(T[k])), high = at.y(HIGH[k]);
    ctx.fillRect(x, high, Math.round(at.x(T[k + 1])) - x, at.y(LOW[k]) - high);
  }
}

/** Shades the background by mode, and adds the modes to `seen`. */
function shadeModes(ctx, n, at, height, ink, seen) {
  ctx.globalAlpha = 0.55;
  for (let k = 0; k < n; ) {
    if (Number.isNaN(T[k])) {
      k++;
      continue;
    }
    let end = k + 1;
    while (end < n && !Number.isNaN(T[end]) && HIGH[end] === HIGH[k]) end++;
    const mode = MODES[HIGH[k]], until = end < n && !Number.isNaN(T[end]) ? T[end] : T[end - 1];
    seen.add(mode);
    ctx.fillStyle = ink[mode] ?? ink.paper;
    ctx.fillRect(at.x(T[k]), TOP, at.x(until) - at.x(T[k]), height - TOP - BOTTOM);
    k = end;
  }
  ctx.globalAlpha = 1;
}

/** Labels of the time axis: seconds before the end of a window that is followed, and the time itself in one that is held. */
function timeTicks({ width }, { from, to, live, label }) {
  const most = Math.max(2, (width - LEFT) / 90);
  if (!live) return ticks(from, to, most).map(([value, text]) => [value, label ? label(value, to - from) : `${text} s`]);
  const all = ticks(from - to, 0, most);
  return all.map(([value, text], k) => [to + value, Number(text) === 0 ? live : k === 0 ? `${text} s` : text]);
}

/**
 * Draws lines over time. `spec` has the lines, and optionally a band and the modes as background; `time` is the window with its
 * cursor. Returns the modes that are seen.
 */
export function timeChart(canvas, trails, spec, time, range, ink) {
  const frame = begin(canvas), { from, to } = time, seen = new Set(), pixels = frame.width - LEFT - RIGHT;
  let [low, high] = spec.zero ? [0, 0] : [Infinity, -Infinity];
  const include = (series, scale, ...columns) => {
    const [a, b] = trails[series].extremes(from, to, ...columns);
    [low, high] = [Math.min(low, scale * a), Math.max(high, scale * b)];
  };
  for (const { series, column, scale } of spec.lines) include(series, scale ?? 1, column ?? 0);
  if (spec.band) include("estimate", 1, 1, 2);
  const x = { low: from, high: to }, y = range.hold(low, high, !time.live), at = placing(frame, x, y);
  if (spec.modes) within(frame, (ctx) => shadeModes(ctx, reduce(trails.estimate, 3, 3, from, to, pixels), at, frame.height, ink, seen));
  axes(frame, at, y, timeTicks(frame, time), ink);
  within(frame, (ctx) => {
    if (spec.band) {
      ctx.fillStyle = ink.band;
      fillReduced(ctx, reduce(trails.estimate, 1, 2, from, to, pixels), at);
    }
    for (const { series, column, colour, width, scale, dash } of spec.lines) {
      [ctx.strokeStyle, ctx.lineWidth] = [ink[colour], width];
      ctx.setLineDash(dash ?? []);
      // A wide line needs fewer columns.
      const n = reduce(trails[series], column ?? 0, column ?? 0, from, to, width > 2 ? pixels / 2 : pixels);
      strokeReduced(ctx, n, at, scale ?? 1);
    }
    ctx.setLineDash([]);
    if (time.selected) {
      const [begins, ends] = time.selected.map(at.x);
      [ctx.fillStyle, ctx.globalAlpha] = [ink.focus, 0.18];
      ctx.fillRect(begins, TOP, ends - begins, frame.height - TOP - BOTTOM);
      ctx.globalAlpha = 1;
    }
    if (time.cursor !== null && time.cursor !== undefined) drawCursor(ctx, frame, at, trails, spec, time.cursor, ink);
  });
  return seen;
}

function drawCursor(ctx, frame, at, trails, spec, cursor, ink) {
  [ctx.strokeStyle, ctx.lineWidth] = [ink.ink, 1];
  ctx.beginPath();
  ctx.moveTo(Math.round(at.x(cursor)) + 0.5, TOP);
  ctx.lineTo(Math.round(at.x(cursor)) + 0.5, frame.height - BOTTOM);
  ctx.stroke();
  for (const { series, column, colour, dotColour, scale } of spec.lines) {
    const value = trails[series].at(cursor)?.[column ?? 0];
    if (typeof value !== "number" || Number.isNaN(value)) continue;
    dot(ctx, at.x(cursor), at.y((scale ?? 1) * value), ink[dotColour ?? colour], ink.paper);
  }
}

function dot(ctx, x, y, colour, edge) {
  ctx.beginPath();
  ctx.arc(x, y, 4, 0, 2 * Math.PI);
  [ctx.fillStyle, ctx.strokeStyle, ctx.lineWidth] = [colour, edge, 1.5];
  ctx.fill();
  ctx.stroke();
}

// ---- force over velocity

/** Points `[time, velocity, force]` of a trail, with the velocity interpolated at their times. */
function paired(points, velocity, from, to) {
  const found = [];
  const end = points.find(to + 1e-9);
  let k = velocity.from;
  for (let i = points.find(from); i < end; i++) {
    const t = points.t[i];
    while (k + 1 < velocity.end && velocity.t[k + 1] < t) k++;
    const known = k + 1 < velocity.end && velocity.t[k] <= t && t <= velocity.t[k + 1] && velocity.t[k + 1] - velocity.t[k] <= GAP_S;
    if (!known) continue;
    const share = (t - velocity.t[k]) / (velocity.t[k + 1] - velocity.t[k]);
    const v = velocity.v[0][k] + share * (velocity.v[0][k + 1] - velocity.v[0][k]), force = points.v[0][i];
    if (!Number.isNaN(v) && !Number.isNaN(force)) found.push([t, v, force]);
  }
  return found;
}

function strokeLoop(ctx, points, at) {
  ctx.beginPath();
  let last = -Infinity;
  for (const [t, v, force] of points) {
    if (t - last > GAP_S) ctx.moveTo(at.x(v), at.y(force));
    else ctx.lineTo(at.x(v), at.y(force));
    last = t;
  }
  ctx.stroke();
}

/** Force over velocity in the last two seconds of the window, or around the cursor: measured force and estimate. */
export function loopChart(canvas, trails, time, ranges, ink) {
  const frame = begin(canvas), ends = time.cursor ?? time.to, begins = ends - LOOP_S;
  const velocity = trails.velocity.points;
  const [estimate, measured] = [trails.estimate, trails.measured].map(({ points }) => paired(points, velocity, begins, ends));
  const extremes = (column) => {
    let low = Infinity, high = -Infinity;
    for (const list of [estimate, measured]) for (const point of list) {
      if (point[column] < low) low = point[column];
      if (point[column] > high) high = point[column];
    }
    return [low, high];
  };
  const [slow, fast] = extremes(1), [a, b] = extremes(2);
  const x = ranges.velocity.hold(Math.min(slow, 0), Math.max(fast, 0), !time.live), y = ranges.force.hold(a, b, !time.live);
  const at = placing(frame, x, y);
  axes(frame, at, y, ticks(x.low, x.high, Math.max(2, frame.width / 90)), ink);
  within(frame, (ctx) => {
    for (let part = 0; part < FADES; part++) {
      const from = begins + (LOOP_S * part) / FADES, to = from + LOOP_S / FADES, fade = (part + 1) / FADES;
      for (const [points, colour, width] of [[estimate, ink["estimate-wide"], 3.5], [measured, ink.measured, 1]]) {
        [ctx.globalAlpha, ctx.strokeStyle, ctx.lineWidth] = [fade, colour, width];
        strokeLoop(ctx, points.filter(([t]) => t >= from - GAP_S / 10 && t <= to), at);
      }
    }
    ctx.globalAlpha = 1;
    for (const [points, colour] of [[measured, ink.measured], [estimate, ink.estimate]]) {
      const newest = points.at(-1);
      if (newest) dot(ctx, at.x(newest[1]), at.y(newest[2]), colour, ink.paper);
    }
  });
  if (estimate.length + measured.length === 0) {
    frame.ctx.fillStyle = ink.soft;
    frame.ctx.textAlign = "center";
    const why = velocity.length === 0 ? "no displacement received" : "points of this time are not kept: the last minute only";
    frame.ctx.fillText(why, (LEFT + frame.width) / 2, frame.height / 2);
  }
}
