// The charts of a damper, each on a canvas: force and residual over time, force over velocity.
//
// A trail is a list of points in order of time. A point is a list that begins with its time in seconds; null means unknown and
// breaks a line. This file does not use the server or the clock: the time at the right edge is an argument.

export const SPAN_S = 10;
const LOOP_S = 2;
/** Number of steps in which a loop fades with age. */
const FADES = 5;
/** Points that are further apart than this, in seconds, are not connected. */
const GAP_S = 0.25;
const MODES = ["arx", "arx_coast", "model", "hold", "fault"];
const LEFT = 52, BOTTOM = 20, TOP = 8, RIGHT = 10;

/** Colours of the style sheet, which follow the light or dark mode. */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "soft", "rule", "paper", "measured", "estimate", "residual", "command", "band", ...MODES];
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
  hold(low, high) {
    if (!Number.isFinite(low) || !Number.isFinite(high)) [low, high] = [-this.least, this.least];
    const room = Math.max((high - low) * 0.06, this.least - (high - low) / 2);
    [low, high] = [low - room, high + room];
    const toward = (from, to, outward) => (from === null || outward ? to : from + (to - from) * 0.03);
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
  ctx.lineJoin = "round";
  return { ctx, width, height };
}

/** Maps from values to pixels, for the ranges x and y. */
function placing({ width, height }, x, y) {
  return {
    x: (value) => LEFT + ((value - x.low) / (x.high - x.low)) * (width - LEFT - RIGHT),
    y: (value) => TOP + (1 - (value - y.low) / (y.high - y.low)) * (height - TOP - BOTTOM),
  };
}

function axes({ ctx, width, height }, at, x, y, xTicks, ink) {
  ctx.lineWidth = 1;
  ctx.textBaseline = "middle";
  ctx.textAlign = "right";
  for (const [value, text] of ticks(y.low, y.high, Math.max(2, (height - TOP - BOTTOM) / 36))) {
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
    ctx.strokeStyle = Number(text) === 0 ? ink.soft : ink.rule;
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
function within(frame, draw) {
  const { ctx, width, height } = frame;
  ctx.save();
  ctx.beginPath();
  ctx.rect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM);
  ctx.clip();
  draw(ctx);
  ctx.restore();
}

function line(ctx, points, colour, width, gap = GAP_S) {
  ctx.strokeStyle = colour;
  ctx.lineWidth = width;
  ctx.beginPath();
  let last = null;
  for (const [t, x, y] of points) {
    if (y === null || x === null) last = null;
    else {
      if (last === null || t - last > gap) ctx.moveTo(x, y);
      else ctx.lineTo(x, y);
      last = t;
    }
  }
  ctx.stroke();
}

/** The points of a trail from the time `from` on, and the one before, so that a line begins at the edge. */
function recent(trail, from) {
  let low = 0, high = trail.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (trail[middle][0] < from) low = middle + 1;
    else high = middle;
  }
  return trail.slice(Math.max(0, low - 1));
}

function extremes(points, ...columns) {
  let low = Infinity, high = -Infinity;
  for (const point of points) {
    for (const column of columns) {
      const value = point[column];
      if (value !== null) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
  }
  return [low, high];
}

/** Seconds that a chart of this width shows, and its ticks. A phone shows half as many, so that lines stay distinguishable. */
function times({ width }) {
  const span = width < 480 ? SPAN_S / 2 : SPAN_S;
  const step = span / 5;
  return [span, [5, 4, 3, 2, 1, 0].map((k) => [-k * step, k === 5 ? `−${span} s` : k ? `−${k * step}` : "0"])];
}

function shadeModes(ctx, points, at, height, edge, ink) {
  for (let k = 0; k < points.length; ) {
    let end = k + 1;
    while (end < points.length && points[end][4] === points[k][4] && points[end][0] - points[end - 1][0] < GAP_S) end++;
    const until = end < points.length && points[end][0] - points[end - 1][0] < GAP_S ? points[end][0] : points[end - 1][0];
    ctx.fillStyle = ink[MODES[points[k][4]]] ?? ink.paper;
    ctx.globalAlpha = 0.55;
    ctx.fillRect(at.x(points[k][0] - edge), TOP, at.x(until - edge) - at.x(points[k][0] - edge), height - TOP - BOTTOM);
    k = end;
  }
  ctx.globalAlpha = 1;
}

function area(ctx, points, at, edge, colour) {
  ctx.fillStyle = colour;
  let part = [];
  const close = () => {
    if (part.length > 1) {
      ctx.beginPath();
      for (const [t, , low] of part) ctx.lineTo(at.x(t - edge), at.y(low));
      for (const [t, , , high] of part.reverse()) ctx.lineTo(at.x(t - edge), at.y(high));
      ctx.fill();
    }
    part = [];
  };
  for (const point of points) {
    if (point[2] === null || point[3] === null || (part.length && point[0] - part.at(-1)[0] > GAP_S)) close();
    if (point[2] !== null && point[3] !== null) part.push(point);
  }
  close();
}

/** Force over time: measured force, estimate with its band, and the mode as background. */
export function forceChart(canvas, trails, edge, range, ink) {
  const frame = begin(canvas);
  const [span, marks] = times(frame);
  const estimate = recent(trails.estimate, edge - span), measured = recent(trails.measured, edge - span);
  const [a, b] = extremes(estimate, 1, 2, 3), [c, d] = extremes(measured, 1);
  const x = { low: -span, high: 0 }, y = range.hold(Math.min(a, c), Math.max(b, d));
  const at = placing(frame, x, y);
  within(frame, (ctx) => shadeModes(ctx, estimate, at, frame.height, edge, ink));
  axes(frame, at, x, y, marks, ink);
  const placed = (points) => points.map(([t, value]) => [t, at.x(t - edge), value === null ? null : at.y(value)]);
  within(frame, (ctx) => {
    area(ctx, estimate, at, edge, ink.band);
    line(ctx, placed(measured), ink.measured, 2.4);
    line(ctx, placed(estimate), ink.estimate, 1.4);
  });
}

/** The residual over time. */
export function residualChart(canvas, trails, edge, range, ink) {
  const frame = begin(canvas);
  const [span, marks] = times(frame);
  const residual = recent(trails.residual, edge - span);
  const [low, high] = extremes(residual, 1);
  const x = { low: -span, high: 0 }, y = range.hold(Math.min(low, 0), Math.max(high, 0));
  const at = placing(frame, x, y);
  axes(frame, at, x, y, marks, ink);
  const placed = residual.map(([t, value]) => [t, at.x(t - edge), value === null ? null : at.y(value)]);
  within(frame, (ctx) => line(ctx, placed, ink.residual, 1.4));
}

/** Interpolates a trail at the times of `points`. */
export function paired(points, trail) {
  const found = [];
  let k = 0;
  for (const [t, value] of points) {
    while (k + 1 < trail.length && trail[k + 1][0] < t) k++;
    const [from, to] = [trail[k], trail[k + 1]];
    const known = from && to && from[0] <= t && t <= to[0] && to[0] - from[0] <= GAP_S && from[1] !== null && to[1] !== null;
    const share = known ? (t - from[0]) / (to[0] - from[0]) : 0;
    found.push([t, known ? from[1] + share * (to[1] - from[1]) : null, value]);
  }
  return found;
}

/** Force over velocity: measured force and estimate. */
export function loopChart(canvas, trails, edge, ranges, ink) {
  const frame = begin(canvas);
  const velocity = recent(trails.velocity, edge - LOOP_S - GAP_S);
  const of = (trail) => paired(recent(trail, edge - LOOP_S), velocity);
  const estimate = of(trails.estimate), measured = of(trails.measured);
  const [a, b] = extremes(estimate, 2), [c, d] = extremes(measured, 2), [slow, fast] = extremes(velocity, 1);
  const x = ranges.velocity.hold(Math.min(slow, 0), Math.max(fast, 0)), y = ranges.force.hold(Math.min(a, c), Math.max(b, d));
  const at = placing(frame, x, y);
  axes(frame, at, x, y, ticks(x.low, x.high, Math.max(2, frame.width / 90)), ink);
  const placed = (points) =>
    points.map(([t, v, f]) => [t, v === null ? null : at.x(v), f === null ? null : at.y(f)]);
  const paths = [[placed(measured), ink.measured, 2.2], [placed(estimate), ink.estimate, 1.3]];
  within(frame, (ctx) => {
    for (let part = 0; part < FADES; part++) {
      ctx.globalAlpha = (part + 1) / FADES;
      const from = edge - LOOP_S * (1 - part / FADES), to = from + LOOP_S / FADES;
      for (const [points, colour, width] of paths) {
        line(ctx, points.filter(([t]) => t >= from - GAP_S / 10 && t <= to), colour, width);
      }
    }
    ctx.globalAlpha = 1;
    const newest = placed(estimate).findLast(([, v, f]) => v !== null && f !== null);
    if (newest) {
      ctx.fillStyle = ink.estimate;
      ctx.beginPath();
      ctx.arc(newest[1], newest[2], 4, 0, 2 * Math.PI);
      ctx.fill();
    }
  });
  if (velocity.length === 0) {
    frame.ctx.fillStyle = ink.soft;
    frame.ctx.textAlign = "center";
    frame.ctx.fillText("no displacement received", (LEFT + frame.width) / 2, frame.height / 2);
  }
}
