// Export of the charts as shown: a picture, or the values in the window as a table.

import { GAP_S, SERIES } from "/trails.js";

/** Lets the browser save `blob` as a file. */
function save(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** The charts below each other, with their titles, as a PNG file. */
export function png(name, charts, title, period) {
  const scale = window.devicePixelRatio || 1, style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  const margin = 16, caption = 22, head = 58;
  const width = Math.max(...charts.map(({ canvas }) => canvas.clientWidth)) + 2 * margin;
  const height = head + charts.reduce((sum, { canvas }) => sum + canvas.clientHeight + caption, 0) + margin;
  const picture = Object.assign(document.createElement("canvas"), { width: width * scale, height: height * scale });
  const ctx = picture.getContext("2d");
  ctx.scale(scale, scale);
  ctx.fillStyle = colour("paper");
  ctx.fillRect(0, 0, width, height);
  ctx.fillStyle = colour("ink");
  ctx.font = "600 15px system-ui, sans-serif";
  ctx.fillText(title, margin, 24, width - 2 * margin);
  ctx.font = "13px system-ui, sans-serif";
  ctx.fillText(period, margin, 44);
  let top = head;
  for (const { canvas, title } of charts) {
    ctx.fillStyle = colour("soft");
    ctx.fillText(title, margin, top + 15, width - 2 * margin);
    ctx.drawImage(canvas, margin, top + caption, canvas.clientWidth, canvas.clientHeight);
    top += canvas.clientHeight + caption;
  }
  picture.toBlob((blob) => save(blob, `${name}.png`));
}

/** Columns of the table: name, series, column. */
function columns(unit) {
  return [
    ["estimate_n", "estimate", 0], ["band_low_n", "estimate", 1], ["band_high_n", "estimate", 2], ["mode", "estimate", 3],
    ["measured_force_n", "measured", 0], ["residual_n", "residual", 0], ["velocity_m_s", "velocity", 0], ["displacement_m", "displacement", 0],
    [unit === "V" ? "command_v" : "current_a", "drive", 0], ["commanded_a", "command", 2], ["requested_n", "command", 0], ["expected_n", "command", 1],
  ];
}

/** The rows of the series `names` in the window, joined by their times. */
function joined(trails, names, rowsOf) {
  const all = new Map();
  for (const name of names) {
    const { rows, from, to } = rowsOf(trails[name]);
    for (let k = rows.find(from); k < rows.find(to + 1e-9); k++) {
      const key = rows.t[k].toFixed(4);
      if (!all.has(key)) all.set(key, {});
      all.get(key)[name] = rows.v.map((column) => column[k]);
    }
  }
  return [...all].sort(([a], [b]) => a - b);
}

/** Velocity at `time`, between the two points around it; it belongs to the middle of several samples of displacement. */
function velocityAt({ points }, time) {
  const k = points.find(time);
  if (k < points.end && points.t[k] === time) return points.v[0][k];
  if (k <= points.from || k >= points.end || points.t[k] - points.t[k - 1] > GAP_S) return NaN;
  const share = (time - points.t[k - 1]) / (points.t[k] - points.t[k - 1]);
  return points.v[0][k - 1] + share * (points.v[0][k] - points.v[0][k - 1]);
}

const number = (value) => (value === undefined || Number.isNaN(value) ? "" : String(Number(value.toPrecision(7))));

/**
 * The window as CSV. If points of the whole window are kept, a row is a time and its values; else a row is a tenth of a second with the
 * smallest and largest values. A value that is not known at a time is empty. Velocity is interpolated to the times of the other values.
 */
export function csvText(trails, { from, to }, unit) {
  const exact = !trails.precedes(from);
  const stamp = (time) => (trails.zero === null ? "" : (trails.zero / 1e9 + time).toFixed(4));
  const wanted = columns(unit);
  const heads = wanted.flatMap(([name]) => (exact ? [name] : [`${name}_min`, `${name}_max`]));
  const names = Object.keys(SERIES);
  const rows = exact
    ? joined(trails, names.filter((name) => name !== "velocity"), (trail) => ({ rows: trail.points, from, to }))
    : joined(trails, names, (trail) => ({ rows: trail.buckets, from, to }));
  if (exact) for (const [time, values] of rows) values.velocity = [velocityAt(trails.velocity, Number(time))];
  const lines = rows.map(([time, values]) => {
    const cells = wanted.flatMap(([, series, column]) => {
      const own = values[series];
      return exact ? [number(own?.[column])] : [number(own?.[2 * column]), number(own?.[2 * column + 1])];
    });
    return [time, stamp(Number(time)), ...cells].join(",");
  });
  return [["time_s", "stamp_s", ...heads].join(","), ...lines].join("\n") + "\n";
}

export function csv(name, trails, time, unit) {
  save(new Blob([csvText(trails, time, unit)], { type: "text/csv" }), `${name}.csv`);
}
