// An opened damper: its values, its charts over a window of time, and the values at the cursor.

import { LEFT, RIGHT, Range, loopChart, timeChart } from "/charts.js";
import { csv, png } from "/export.js";
import { SPANS, follow, hold, moveCursor, pan, range, windowAt, zoom } from "/range.js";
import { $, NOTHING, ago, alarmed, big, fixed, look, plain, put, span } from "/words.js";

/** Rows of the table: key in the snapshot, label, unit, digits (null: text), factor. */
const ROWS = [
  ["estimate.force_n", "force, estimated", "N", 1],
  ["estimate.band_low_n", "90 % band, from", "N", 1],
  ["estimate.band_high_n", "90 % band, to", "N", 1],
  ["estimate.band_calibrated", "band is calibrated", "", null],
  ["estimate.std_dev_n", "standard deviation", "N", 1],
  ["estimate.mode", "mode", "", null],
  ["estimate.validity", "validity", "", null],
  ["estimate.reasons", "reasons", "", null],
  ["estimate.input_age_s", "age of the drive at the estimate", "ms", 1, 1000],
  ["estimate.model", "model", "", null],
  ["measured.force_n", "force, measured", "N", 1],
  ["residual.predicted_n", "force, simulated (free run)", "N", 1],
  ["residual.residual_n", "residual", "N", 1],
  ["residual.normalised", "residual over expected RMSE", "", 2],
  ["residual.windowed_rsse_n", "RMSE over the window", "N", 1],
  ["residual.windowed_esr", "NMSE over the window", "", 4],
  ["residual.window_s", "window", "s", 1],
  ["residual.alarm", "residual alarm", "", null],
  ["command.current_a", "current, commanded", "A", 3],
  ["command.force_requested_n", "force, requested", "N", 1],
  ["command.force_expected_n", "force, expected", "N", 1],
  ["command.achievable_min_n", "achievable, from", "N", 1],
  ["command.achievable_max_n", "achievable, to", "N", 1],
  ["command.achievable", "requested force achievable", "", null],
  ["command.dissipative", "requested force dissipative", "", null],
  ["command.limited_by", "limited by", "", null],
  ["drive.value", "drive, measured", "drive.unit", 3],
];

// The estimate is a wide pale line and measured force a thin dark one on it, so that both are seen where they agree.
const ESTIMATE = { series: "estimate", colour: "estimate-wide", dotColour: "estimate", width: 4 };
const MEASURED = { series: "measured", colour: "measured", width: 1 };
const COMMANDED = { series: "command", column: 2, colour: "command", width: 1.6, dash: [6, 3] };
/** The charts over time: class of the figure, text alternative, lines, smallest half range. */
const CHARTS = {
  force: { what: "Force over time", lines: [ESTIMATE, MEASURED, { series: "command", column: 0, colour: "command", width: 1.2, dash: [6, 3] }], band: true, modes: true, least: 10 },
  residual: { what: "Residual over time", lines: [{ series: "residual", colour: "residual", width: 1 }], zero: true, least: 5 },
  velocity: { what: "Velocity over time", lines: [{ series: "velocity", colour: "motion", width: 1 }], zero: true, least: 0.01 },
  displacement: { what: "Displacement over time", lines: [{ series: "displacement", scale: 1000, colour: "motion", width: 1 }], least: 0.5 },
  drive: { what: "Drive over time", lines: [{ series: "drive", colour: "measured", width: 1 }, COMMANDED], zero: true, least: 0.05 },
  current: { what: "Commanded current over time", lines: [COMMANDED], zero: true, least: 0.05 },
};
/** Only the force of small charts: one for each damper in the overview. */
export const SUMMARY_CHART = { lines: [ESTIMATE, MEASURED], band: true, modes: true };
/** Age from which a chart has stopped, s. */
export const STOPPED_S = 1;

/** A value of a point, or the smallest and largest of a bucket. */
function reading(value, digits, scale = 1) {
  if (value === undefined || value === null) return NOTHING;
  if (Array.isArray(value)) return `${fixed(scale * value[0], digits)} to ${fixed(scale * value[1], digits)}`;
  return fixed(scale * value, digits);
}

/** Shows a badge for mode and validity, and the alarm. */
export function showBadges(find, state) {
  const silent = state.level === "silent", mode = silent ? "" : (state.estimate?.mode ?? "");
  find(".mode").className = `badge mode ${mode}`;
  put(find(".mode"), mode);
  put(find(".validity"), silent ? "" : (state.estimate?.validity ?? ""));
  find(".alarm").hidden = !alarmed(state);
}

export function bandText(estimate) {
  if (estimate.band_low_n === null && estimate.band_high_n === null) return "no estimate in this mode";
  return `90 %: ${fixed(estimate.band_low_n, 0)} to ${fixed(estimate.band_high_n, 0)} N${estimate.band_calibrated ? "" : ", not calibrated"}`;
}

export class Detail {
  /** `damper` has the trails, the state and the time at which the newest value is drawn. */
  constructor(damper) {
    this.damper = damper;
    this.ranges = { loop: { force: new Range(10), velocity: new Range(0.01) } };
    for (const [name, { least }] of Object.entries(CHARTS)) this.ranges[name] = new Range(least);
    this.drawn = [null, null];
    this.pointer = null;
    this.card = $("card").content.firstElementChild.cloneNode(true);
    this.card.setAttribute("aria-label", `damper ${damper.name}`);
    this.find = (selector) => this.card.querySelector(selector);
    put(this.find("h2"), damper.name);
    put(this.find("caption"), `All values of damper ${damper.name}`);
    this.table = this.makeTable();
    this.canvases = {};
    for (const [name, { what }] of [...Object.entries(CHARTS), ["loop", { what: "Force over velocity" }]]) {
      this.canvases[name] = this.find(`figure.${name} canvas`);
      this.canvases[name].setAttribute("aria-label", `${what}, damper ${damper.name}; the newest values are in the table`);
    }
    for (const name of Object.keys(CHARTS)) this.listen(this.canvases[name]);
    this.find("select.span").append(...SPANS.map((s) => new Option(s < 60 ? `${s} s` : `${s / 60} min`, s)));
    this.find("select.span").addEventListener("change", (event) => {
      follow();
      range.span = Number(event.target.value);
      this.redraw();
    });
    this.find(".bar").addEventListener("click", (event) => this.act(event.target.closest("[data-do]")?.dataset.do));
    this.find(".readout").addEventListener("keydown", (event) => this.key(event));
    // If the workshop is enabled, it adds its own part to each card.
    document.dispatchEvent(new CustomEvent("mr-damper-card", { detail: { name: damper.name, card: this.card } }));
  }

  makeTable() {
    const body = this.find("tbody");
    return ROWS.map(([path, label, unit, digits, times]) => {
      const row = body.insertRow();
      const head = row.appendChild(document.createElement("th"));
      head.scope = "row";
      head.textContent = label;
      const value = row.insertCell().appendChild(document.createElement("data"));
      value.dataset.path = path;
      value.parentNode.className = "num";
      const cells = [row.insertCell(), row.insertCell()];
      cells[1].className = "num age";
      return { row, path, value, unit, digits, times: times ?? 1, cells };
    });
  }

  // ---- window and cursor

  /** The window as the charts need it. */
  time() {
    const { damper } = this, edge = damper.edge();
    const stopped = damper.state !== null && damper.age() > STOPPED_S;
    return { ...windowAt(edge), cursor: range.cursor, selected: range.selected, live: range.held ? "" : stopped ? "last" : "now", label: (t, length) => this.clock(t, length) };
  }

  /** A time of the damper as time of day, if its stamps are times of day, else in seconds since the first sample. */
  clock(t, length) {
    const { zero } = this.damper.trails;
    // Stamps before the year 2001 are not times of day, but of a simulation.
    if (zero === null || zero < 1e18) return `${t.toFixed(length < 2 ? 2 : 1)} s`;
    const date = new Date(zero / 1e6 + t * 1000), digits = length < 2 ? 3 : length < 20 ? 1 : 0;
    const parts = { hour: "2-digit", minute: "2-digit", second: "2-digit", ...(digits ? { fractionalSecondDigits: digits } : {}) };
    return date.toLocaleTimeString("en-GB", parts);
  }

  timeOf(canvas, clientX) {
    const { from, to } = windowAt(this.damper.edge()), box = canvas.getBoundingClientRect();
    const share = (clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
    return from + Math.min(Math.max(share, 0), 1) * (to - from);
  }

  listen(canvas) {
    canvas.addEventListener("pointermove", (event) => {
      range.cursor = this.timeOf(canvas, event.clientX);
      this.pointer = { canvas, x: event.clientX };
      if (this.begun !== undefined && Math.abs(event.clientX - this.begunAt) > 4) range.selected = [this.begun, range.cursor].sort((a, b) => a - b);
      this.redraw();
    });
    canvas.addEventListener("pointerleave", () => {
      if (this.begun === undefined) this.leave();
    });
    canvas.addEventListener("pointerdown", (event) => {
      // A finger only moves the cursor, because it also scrolls the page.
      if (event.pointerType === "mouse" && event.button === 0) {
        [this.begun, this.begunAt] = [this.timeOf(canvas, event.clientX), event.clientX];
        canvas.setPointerCapture(event.pointerId);
        event.preventDefault();
      }
    });
    const end = () => {
      if (range.selected) hold(...range.selected);
      this.begun = undefined;
      this.redraw();
    };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("dblclick", () => this.act("follow"));
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.shiftKey) return;
      event.preventDefault();
      zoom((event.deltaY || event.deltaX) > 0 ? 1.25 : 0.8, this.damper.edge(), this.timeOf(canvas, event.clientX));
      this.redraw();
    }, { passive: false });
  }

  leave() {
    range.cursor = this.pointer = null;
    this.redraw();
  }

  act(what) {
    const edge = this.damper.edge(), { from, to } = windowAt(edge), centre = range.cursor ?? (from + to) / 2;
    const actions = {
      in: () => zoom(0.5, edge, centre),
      out: () => zoom(2, edge, centre),
      earlier: () => pan(-0.5, edge),
      later: () => pan(0.5, edge),
      follow,
      png: () => this.export("png"),
      csv: () => this.export("csv"),
    };
    if (!actions[what]) return;
    actions[what]();
    this.redraw();
  }

  key(event) {
    const step = { ArrowLeft: -0.01, ArrowRight: 0.01, PageDown: -0.1, PageUp: 0.1, Home: -1, End: 1 }[event.key];
    if (step === undefined && !(event.key === "Escape" && range.cursor !== null)) return;
    if (step === undefined) range.cursor = null;
    else moveCursor(event.shiftKey ? 10 * step : step, this.damper.edge());
    this.pointer = null;
    this.redraw();
    event.preventDefault();
    event.stopPropagation();
  }

  redraw() {
    this.drawn = [null, null];
  }

  // ---- charts

  /** The charts that are shown, with their titles. */
  shown() {
    const all = [...Object.keys(CHARTS), "loop"].filter((name) => this.canvases[name].clientHeight > 0);
    return all.map((name) => ({ name, canvas: this.canvases[name], title: this.find(`figure.${name} figcaption`).innerText.replace(/\s+/g, " ") }));
  }

  /** Draws half of the charts: `phase` is 0 or 1 in turn, so that a frame has half of the work. */
  draw(ink, phase) {
    const time = this.time();
    // A window that follows the newest value is drawn again when it has moved by half a pixel.
    const step = time.live ? (0.5 * (time.to - time.from)) / Math.max(this.canvases.force.clientWidth, 1) : 0;
    if (this.drawn[phase] !== null && Math.abs(time.to - this.drawn[phase]) <= step) return;
    this.drawn[phase] = time.to;
    if (this.pointer && time.live) time.cursor = range.cursor = this.timeOf(this.pointer.canvas, this.pointer.x);
    const { trails } = this.damper;
    for (const [k, [name, spec]] of Object.entries(CHARTS).entries()) {
      if (k % 2 !== phase || this.canvases[name].clientHeight === 0) continue;
      const own = name === "drive" && this.damper.state?.drive?.unit === "V" ? { ...spec, lines: spec.lines.slice(0, 1) } : spec;
      const modes = timeChart(this.canvases[name], trails, own, time, this.ranges[name], ink);
      if (spec.modes) for (const item of this.find(".modes").children) item.hidden = !modes.has(item.className);
    }
    if (phase === 1) loopChart(this.canvases.loop, trails, time, this.ranges.loop, ink);
    this.showCursor(time);
    this.damper.need(time.from);
  }

  /** The values at the cursor: beside the names of the lines, and in words for screen readers. */
  showCursor(time) {
    const { trails } = this.damper, { cursor } = time, bar = this.find(".readout");
    const at = (series) => (cursor === null ? null : trails[series].at(cursor));
    const estimate = at("estimate"), command = at("command");
    const band = (k, end) => (Array.isArray(estimate?.[k]) ? estimate[k][end] : estimate?.[k]);
    const values = {
      estimate: reading(estimate?.[0], 1),
      band: estimate ? `${fixed(band(1, 0), 0)} to ${fixed(band(2, 1), 0)}` : NOTHING,
      measured: reading(at("measured")?.[0], 1),
      requested: reading(command?.[0], 1),
      commanded: reading(command?.[2], 3),
      residual: reading(at("residual")?.[0], 1),
      velocity: reading(at("velocity")?.[0], 4),
      displacement: reading(at("displacement")?.[0], 3, 1000),
      drive: reading(at("drive")?.[0], 3),
    };
    for (const element of this.card.querySelectorAll("[data-at]")) put(element, cursor === null ? "" : values[element.dataset.at]);
    const length = time.to - time.from;
    const when = cursor === null ? "" : time.live ? `${fixed(cursor - time.to, 2)} s` : this.clock(cursor, Math.min(length, 1.9));
    const held = range.held ? `Held: ${this.clock(time.from, length)} to ${this.clock(time.to, length)}, ${span(length)}. Newest values are not shown. ` : "";
    put(bar, `${held}${cursor === null ? (held ? "" : "Point at a chart, or use the arrow keys here, to read values") : `at ${when}`}`);
    bar.classList.toggle("held", Boolean(range.held));
    const low = time.live ? -length : time.from, high = time.live ? 0 : time.to;
    bar.setAttribute("aria-valuemin", low.toFixed(2));
    bar.setAttribute("aria-valuemax", high.toFixed(2));
    bar.setAttribute("aria-valuenow", (cursor === null ? high : time.live ? cursor - time.to : cursor).toFixed(2));
    // Set only if there is a cursor, so that a screen reader does not read a text that changes all the time.
    const words = `${when}: estimate ${values.estimate} N, measured ${values.measured} N, residual ${values.residual} N, velocity ${values.velocity} m/s`;
    bar.setAttribute("aria-valuetext", cursor === null ? "no cursor" : words);
    const select = this.find("select.span"), value = range.held || !SPANS.includes(range.span) ? "" : String(range.span);
    if (select.value !== value) select.value = value;
    this.find('[data-do="follow"]').disabled = range.held === null;
    this.find('[data-do="later"]').disabled = range.held === null;
  }

  async export(kind) {
    const time = this.time();
    // Before the kept points the table has buckets, and it needs the newest of them.
    if (kind === "csv" && this.damper.trails.precedes(time.from)) await this.damper.fetch();
    const { name } = this.damper, stamp = this.clock(time.to, 1).replaceAll(":", "-").replace(" s", "s");
    const file = `${name.replaceAll("/", "_")}_${stamp}`;
    if (kind === "csv") csv(file, this.damper.trails, time, this.damper.state?.drive?.unit ?? "A");
    else png(file, this.shown(), `${name}: ${this.damper.state?.status ?? ""}`, `${this.clock(time.from, 1)} to ${this.clock(time.to, 1)}`);
  }

  // ---- values

  show(state) {
    const { card, find } = this;
    card.classList.remove("good", "warning", "bad", "silent");
    card.classList.add(state.level);
    put(find(".status"), state.status);
    showBadges(find, state);
    for (const tile of card.querySelectorAll(".tile")) {
      const reading = state[tile.dataset.of];
      tile.classList.toggle("stale", reading?.stale ?? false);
      tile.classList.toggle("never", !reading);
    }
    this.showTiles(state);
    this.showTable(state);
    this.showFigures(state);
    const rates = Object.entries(state.rates_hz).map(([topic, hz]) => `${topic.replaceAll("_", " ")} ${hz.toFixed(0)}`);
    const thinned = this.damper.origin() === "zenoh" ? ", thinned by the Zenoh mirror" : "";
    put(find(".rates"), rates.length ? `Messages per second${thinned}: ${rates.join(", ")}` : "No messages of this damper are being received.");
    this.showChanges(state.changes);
  }

  /** Shows the figures of what has been received, and the ages of those that have stopped. */
  showFigures(state) {
    const { find } = this, volts = state.drive?.unit === "V";
    const hide = (selector, hidden) => {
      if (find(selector).hidden === hidden) return;
      find(selector).hidden = hidden;
      this.redraw();
    };
    hide("figure.residual", !state.residual);
    hide("figure.drive", !state.drive);
    hide("figure.current", !state.command || Boolean(state.drive && !volts));
    hide(".requested", !state.command);
    hide(".commanded", !state.command || volts);
    put(find("figure.drive .what"), volts ? "Command voltage, V" : "Current, A");
    for (const [name, { lines }] of Object.entries(CHARTS)) {
      const figure = find(`figure.${name}`), label = figure.querySelector(".stopped"), age = this.damper.age(lines[0].series);
      const stopped = age > STOPPED_S && Number.isFinite(age);
      figure.classList.toggle("old", stopped);
      label.hidden = !stopped;
      if (stopped) put(label, `stopped, newest value ${ago(age)}`);
    }
    find("figure.loop").classList.toggle("old", this.damper.age() > STOPPED_S);
  }

  showTiles(state) {
    for (const [path, digits, unit] of [["estimate.force_n", 1, "N"], ["measured.force_n", 1, "N"], ["residual.residual_n", 1, "N"], ["command.current_a", 3, "A"]]) {
      big(this.find(`[data-big="${path}"]`), look(state, path), digits, unit);
    }
    const note = (name, reading, text) => {
      const element = this.find(`[data-note="${name}"]`), old = reading?.stale ?? false;
      element.classList.toggle("old", old);
      put(element, old ? `old: ${ago(reading.age_s)}` : text);
    };
    const { estimate, measured, residual, command } = state;
    note("band", estimate, estimate ? bandText(estimate) : "none received");
    // Only forces at the same time can be compared. Stamps in JSON are exact to about a microsecond here.
    const together = estimate && measured && Math.abs(measured.stamp_ns - estimate.stamp_ns) < 2e7;
    note("measured", measured, !measured ? "not received (optional)" : together ? `estimate differs by ${fixed(estimate.force_n - measured.force_n, 1)} N` : `received ${ago(measured.age_s)}`);
    note("residual", residual, residual ? residualText(residual) : "needs measured force");
    note("command", command, command ? `${fixed(command.achievable_min_n, 0)} to ${fixed(command.achievable_max_n, 0)} N achievable, ${fixed(command.force_requested_n, 0)} requested${command.limited_by === "none" ? "" : `; limited: ${plain(command.limited_by).replaceAll("_", " ")}`}` : "no force requested");
    this.showInterval(command);
  }

  /** Draws the achievable interval with the requested and the expected force; zero is in the middle. */
  showInterval(command) {
    this.find(".track").hidden = !command;
    const ends = [command?.achievable_min_n, command?.achievable_max_n].map((value) => value ?? null);
    const wanted = command?.force_requested_n ?? null, expected = command?.force_expected_n ?? null;
    this.reach = Math.max((this.reach ?? 1) * 0.99, ...[...ends, wanted, expected].map((value) => Math.abs(value ?? 0)), 1);
    const place = (value) => `${50 + (value / this.reach) * 48}%`;
    const bar = this.find(".track .span");
    bar.hidden = ends.includes(null);
    if (!bar.hidden) {
      bar.style.left = place(Math.min(...ends));
      bar.style.right = `calc(100% - ${place(Math.max(...ends))})`;
    }
    for (const [name, value] of [["wanted", wanted], ["expected", expected]]) {
      const mark = this.find(`.${name}`);
      mark.hidden = value === null;
      if (value !== null) mark.style.left = place(value);
    }
  }

  showTable(state) {
    for (const { row, path, value, unit, digits, times, cells } of this.table) {
      const reading = state[path.split(".")[0]];
      const raw = look(state, path);
      const text = raw === null || raw === undefined ? "" : Array.isArray(raw) ? raw.join(" ") : String(raw);
      if (value.value !== text) value.value = text;
      put(value, digits === null || typeof raw === "string" ? plain(raw) : fixed(typeof raw === "number" ? raw * times : null, digits));
      put(cells[0], unit.includes(".") ? (look(state, unit) ?? "") : unit);
      put(cells[1], reading ? ago(reading.age_s) : "never");
      row.className = !reading ? "never" : reading.stale ? "old" : "";
    }
  }

  showChanges(changes) {
    const list = this.find(".changes ol");
    while (list.children.length > Math.max(changes.length, 1)) list.lastChild.remove();
    while (list.children.length < Math.max(changes.length, 1)) list.append(document.createElement("li"));
    if (!changes.length) put(list.firstChild, "none since the server of this page started");
    changes.forEach(({ from, to, reason, age_s }, k) => put(list.children[k], `${ago(age_s)}: ${from} to ${to}, ${reason}`));
  }
}

export function residualText(residual) {
  return `RMSE ${fixed(residual.windowed_rsse_n, 1)} N, NMSE ${fixed(residual.windowed_esr, 3)} over ${fixed(residual.window_s, 0)} s`;
}
