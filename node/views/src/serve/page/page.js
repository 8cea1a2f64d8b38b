// The live page: listens to /events, keeps the last ten seconds of each damper, and draws.
//
// The page must never show an old value as a current one. There are three causes of old values, and the page reports each in words: the
// damper is silent (the server reports this), the server is silent (LOST_S), or this browser lags behind the received data (BEHIND_S).

import { SPAN_S, Range, colours, forceChart, loopChart, residualChart } from "/charts.js";

const LOST_S = 1;
const BEHIND_S = 1;
const SERIES = ["estimate", "measured", "residual", "velocity", "command"];
const NOTHING = "–";
const $ = (id) => document.getElementById(id);
const seconds = () => performance.now() / 1000;

/** Rows of the table: key in the snapshot, label, unit, digits (null: text). */
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

const dampers = new Map();
const view = { source: null, frozen: null, selected: 0, ink: colours(), said: new Map() };
const link = { heard: null, offset: null, behind: 0, arrivals: [], skipped: 0, words: "connecting", origin: "" };

// ---- words and numbers

function fixed(value, digits) {
  return value === null || value === undefined ? NOTHING : value.toFixed(digits).replace(/^-/, "−");
}

function plain(value) {
  if (value === true) return "yes";
  if (value === false) return "no";
  if (Array.isArray(value)) return value.length ? value.join(", ").toLowerCase().replaceAll("_", " ") : "none";
  return value === null || value === undefined || value === "" ? NOTHING : String(value);
}

/** An age in words; while the page is frozen, the age at the time of freezing. */
function ago(s) {
  const then = view.frozen !== null;
  if (s < 0.15) return then ? "at that time" : "now";
  return `${s < 100 ? `${s.toFixed(1)} s` : `${(s / 60).toFixed(0)} min`} ${then ? "before" : "ago"}`;
}

function look(state, path) {
  return path.split(".").reduce((value, key) => value?.[key], state);
}

function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// ---- one damper

class Damper {
  constructor(name) {
    this.state = null;
    this.era = null;
    this.trails = Object.fromEntries(SERIES.map((name) => [name, []]));
    this.ranges = { force: new Range(10), residual: new Range(5), loop: { force: new Range(10), velocity: new Range(0.01) } };
    this.offset = null;
    this.drawn = null;
    this.card = $("card").content.firstElementChild.cloneNode(true);
    this.card.setAttribute("aria-label", `damper ${name}`);
    put(this.card.querySelector("h2"), name);
    put(this.card.querySelector("caption"), `All values of damper ${name}`);
    this.find = (selector) => this.card.querySelector(selector);
    // If the workshop is enabled, it adds its own part to each card.
    document.dispatchEvent(new CustomEvent("mr-damper-card", { detail: { name, card: this.card } }));
    this.table = this.makeTable();
    this.card.addEventListener("focusin", () => select([...dampers.keys()].indexOf(name), false));
    this.card.addEventListener("pointerdown", () => select([...dampers.keys()].indexOf(name), false));
    for (const [figure, what] of [["force", "Force over time"], ["loop", "Force over velocity"], ["residual", "Residual over time"]]) {
      this.find(`figure.${figure} canvas`).setAttribute("aria-label", `${what}, damper ${name}; the newest values are in the table`);
    }
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

  /** Clears all trails; new points belong to `era`. */
  begin(era) {
    for (const name of SERIES) this.trails[name] = [];
    [this.era, this.offset, this.drawn] = [era, null, null];
  }

  add(points) {
    if (points.era !== this.era) this.begin(points.era);
    for (const name of SERIES) {
      const trail = this.trails[name];
      for (const point of points[name]) {
        if (!trail.length || point[0] > trail.at(-1)[0]) trail.push(point);
      }
      // Removed in one go from time to time, which is cheaper than removing one point each time.
      if (trail.length > 6000) trail.splice(0, trail.findIndex((point) => point[0] > trail.at(-1)[0] - SPAN_S - 1));
    }
    const newest = this.newest();
    if (newest !== null) {
      const offset = seconds() - newest;
      const jumps = this.offset === null || Math.abs(offset - this.offset) > 0.5;
      this.offset = jumps ? offset : this.offset + (offset - this.offset) * 0.05;
    }
    this.drawn = null;
  }

  newest() {
    const times = [this.trails.estimate, this.trails.measured].filter((trail) => trail.length).map((trail) => trail.at(-1)[0]);
    return times.length ? Math.max(...times) : null;
  }

  draw() {
    const newest = this.newest();
    // The chart scrolls between batches too, and stops soon after the last one.
    const edge = newest === null ? 0 : Math.min(seconds() - this.offset, newest + 0.1);
    if (this.drawn === edge) return;
    this.drawn = edge;
    const { trails, ranges, find } = this;
    forceChart(find("figure.force canvas"), trails, edge, ranges.force, view.ink);
    if (find(".pair").clientHeight > 0) {
      loopChart(find("figure.loop canvas"), trails, edge, ranges.loop, view.ink);
      residualChart(find("figure.residual canvas"), trails, edge, ranges.residual, view.ink);
    }
  }

  show(state) {
    this.state = state;
    const { card, find } = this;
    card.classList.remove("good", "warning", "bad", "silent");
    card.classList.add(state.level);
    put(find(".status"), state.status);
    const silent = state.level === "silent";
    const mode = silent ? "" : (state.estimate?.mode ?? "");
    find(".mode").className = `badge mode ${mode}`;
    put(find(".mode"), mode);
    put(find(".validity"), silent ? "" : (state.estimate?.validity ?? ""));
    find(".alarm").hidden = !state.residual?.alarm || state.residual.stale;
    for (const tile of card.querySelectorAll(".tile")) tile.classList.toggle("stale", state[tile.dataset.of]?.stale ?? true);
    this.showTiles(state);
    this.showTable(state);
    const rates = Object.entries(state.rates_hz).map(([topic, hz]) => `${topic.replaceAll("_", " ")} ${hz.toFixed(0)}`);
    put(find(".rates"), rates.length ? `Messages per second${link.origin === "zenoh" ? ", thinned by the Zenoh mirror" : ""}: ${rates.join(", ")}` : "No messages of this damper are being received.");
    this.showChanges(state.changes);
  }

  showTiles(state) {
    const big = (path, digits, unit) => {
      const element = this.find(`[data-big="${path}"]`);
      element.replaceChildren(`${fixed(look(state, path), digits)} `, Object.assign(document.createElement("small"), { textContent: unit }));
    };
    big("estimate.force_n", 1, "N");
    big("measured.force_n", 1, "N");
    big("residual.residual_n", 1, "N");
    big("command.current_a", 3, "A");
    const note = (name, reading, text) => {
      const element = this.find(`[data-note="${name}"]`);
      const old = reading?.stale ?? false;
      element.classList.toggle("old", old);
      put(element, old ? `old: ${ago(reading.age_s)}` : text);
    };
    const { estimate, measured, residual, command } = state;
    note("band", estimate, estimate ? `90 %: ${fixed(estimate.band_low_n, 0)} to ${fixed(estimate.band_high_n, 0)} N${estimate.band_calibrated ? "" : ", not calibrated"}` : "none received");
    // Only forces at the same time can be compared. Stamps in JSON are exact to about a microsecond here.
    const together = estimate && measured && Math.abs(measured.stamp_ns - estimate.stamp_ns) < 2e7;
    note("measured", measured, !measured ? "none received" : together ? `estimate differs by ${fixed(estimate.force_n - measured.force_n, 1)} N` : `received ${ago(measured.age_s)}`);
    note("residual", residual, residual ? `RMSE ${fixed(residual.windowed_rsse_n, 1)} N, NMSE ${fixed(residual.windowed_esr, 3)} over ${fixed(residual.window_s, 0)} s` : "none received");
    note("command", command, command ? `${fixed(command.achievable_min_n, 0)} to ${fixed(command.achievable_max_n, 0)} N achievable, ${fixed(command.force_requested_n, 0)} requested${command.limited_by === "none" ? "" : `; limited: ${plain(command.limited_by).replaceAll("_", " ")}`}` : "no force requested");
    this.showInterval(command);
  }

  /** Draws the achievable interval with the requested and the expected force; zero is in the middle. */
  showInterval(command) {
    const ends = [command?.achievable_min_n, command?.achievable_max_n].map((value) => value ?? null);
    const wanted = command?.force_requested_n ?? null, expected = command?.force_expected_n ?? null;
    this.reach = Math.max((this.reach ?? 1) * 0.99, ...[...ends, wanted, expected].map((value) => Math.abs(value ?? 0)), 1);
    const place = (value) => `${50 + (value / this.reach) * 48}%`;
    const span = this.find(".span");
    span.hidden = ends.includes(null);
    if (!span.hidden) {
      span.style.left = place(Math.min(...ends));
      span.style.right = `calc(100% - ${place(Math.max(...ends))})`;
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
      value.value = raw === null || raw === undefined ? "" : Array.isArray(raw) ? raw.join(" ") : String(raw);
      put(value, digits === null || typeof raw === "string" ? plain(raw) : fixed(typeof raw === "number" ? raw * times : null, digits));
      put(cells[0], unit.includes(".") ? (look(state, unit) ?? "") : unit);
      put(cells[1], reading ? ago(reading.age_s) : "never");
      row.className = !reading || reading.stale ? "old" : "";
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

// ---- all dampers

function show(states) {
  const names = states.map((state) => state.name);
  if (names.length !== dampers.size || names.some((name) => !dampers.has(name))) {
    const chosen = [...dampers.keys()][view.selected];
    const before = new Map(dampers);
    dampers.clear();
    for (const name of names) dampers.set(name, before.get(name) ?? new Damper(name));
    const focused = document.activeElement;
    $("dampers").replaceChildren(...[...dampers.values()].map((damper) => damper.card));
    if (focused instanceof HTMLElement && focused.isConnected) focused.focus({ preventScroll: true });
    document.body.classList.toggle("many", dampers.size > 1);
    select(Math.max(names.indexOf(chosen), 0), false);
  }
  $("empty").hidden = names.length > 0;
  for (const state of states) {
    dampers.get(state.name).show(state);
    // Announced to screen readers only when level, mode or alarm has changed.
    const matter = `${state.level} ${state.estimate?.mode} ${state.residual?.alarm}`;
    if (view.said.has(state.name) && view.said.get(state.name) !== matter) put($("announce"), `${state.name}: ${state.status}`);
    view.said.set(state.name, matter);
  }
}

function select(index, focus) {
  const all = [...dampers.values()];
  if (index < 0 || index >= all.length) return;
  view.selected = index;
  all.forEach(({ card }, k) => {
    card.classList.toggle("selected", k === index);
    card.setAttribute("aria-current", k === index ? "true" : "false");
  });
  all.forEach((damper) => (damper.drawn = null));
  if (focus) all[index].card.focus();
}

// ---- the stream

function connect() {
  view.source = new EventSource("/events");
  view.source.addEventListener("start", (event) => hear(JSON.parse(event.data), true));
  view.source.addEventListener("batch", (event) => hear(JSON.parse(event.data), false));
  view.source.addEventListener("workshop", (event) => document.dispatchEvent(new CustomEvent("mr-damper-workshop", { detail: JSON.parse(event.data) })));
  view.source.addEventListener("skipped", (event) => (link.skipped += Number(event.data)));
  view.source.onerror = () => {
    link.words = "connection to the server lost; retrying";
    // A browser does not retry after a response such as "16 pages are open already".
    if (view.source.readyState === EventSource.CLOSED) {
      const source = view.source;
      fetch("/events", { method: "HEAD" }).then((answer) => {
        if (answer.status === 503) link.words = "too many pages of this server are open; close one of them";
      }, () => {});
      setTimeout(() => view.source === source && !view.frozen && connect(), 2000);
    }
  };
}

function hear(news, first) {
  const now = seconds();
  if (first) {
    for (const name of view.said.keys()) if (!news.dampers.some((state) => state.name === name)) view.said.delete(name);
    for (const damper of dampers.values()) damper.begin(null);
    [link.offset, link.origin] = [null, news.source];
  }
  // The smallest transit time so far; the clocks may drift apart by 0.2 ms per second.
  const offset = now - news.now_s;
  link.offset = link.offset === null ? offset : Math.min(offset, link.offset + (now - link.heard) * 2e-4);
  [link.heard, link.behind, link.words] = [now, offset - link.offset, ""];
  link.arrivals.push(now);
  while (link.arrivals[0] < now - 1) link.arrivals.shift();
  if (news.dampers) show(news.dampers);
  for (const points of news.points ?? []) dampers.get(points.name)?.add(points);
}

function freeze() {
  view.frozen = view.frozen ? null : new Date();
  $("freeze").setAttribute("aria-pressed", String(view.frozen !== null));
  put($("freeze-text"), view.frozen ? "Continue" : "Freeze");
  // A frozen page receives nothing and shows the ages at the time of freezing. Continuing starts with all points of the last ten seconds.
  if (view.frozen) {
    view.source.close();
    for (const damper of dampers.values()) if (damper.state) damper.show(damper.state);
  }
  else connect();
}

/** Updates the banner (frozen, lost, behind) and the status of the connection. */
function tell() {
  const silence = link.heard === null ? Infinity : seconds() - link.heard;
  const lost = !view.frozen && silence > LOST_S;
  const behind = !view.frozen && !lost && link.behind > BEHIND_S;
  const banner = $("banner");
  banner.hidden = !(view.frozen || (lost && link.heard !== null) || behind);
  banner.classList.toggle("frozen", view.frozen !== null);
  if (view.frozen) put(banner, `Frozen at ${view.frozen.toLocaleTimeString()}: all values are from that time. Press space to continue.`);
  else if (lost) put(banner, `No data from the server for ${silence.toFixed(0)} s: the values shown are old.`);
  else if (behind) put(banner, `This browser is ${link.behind.toFixed(1)} s behind: the values shown are old.`);
  document.body.classList.toggle("lost", lost || behind);
  document.body.classList.toggle("frozen", view.frozen !== null);
  const status = $("link");
  status.className = `link ${view.frozen || (lost && link.words === "connecting") ? "" : lost ? "bad" : "good"}`;
  put(status, view.frozen ? "frozen" : lost ? link.words || "no data from the server" : `live, ${dampers.size} damper${dampers.size === 1 ? "" : "s"}`);
  const skipped = link.skipped ? `, ${link.skipped} batches skipped: this browser did not keep up` : "";
  put($("rate"), lost || view.frozen ? "" : `${link.arrivals.length} batches per second${skipped}`);
}

function frame() {
  for (const damper of dampers.values()) damper.draw();
  requestAnimationFrame(frame);
}

// ---- keys, colours, start

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || $("keys").open) return;
  // An input element that has the focus gets the keys.
  if (event.target.closest("input, select, textarea")) return;
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (step) select((view.selected + step + dampers.size) % dampers.size, true);
  else if (/^[1-9]$/.test(event.key)) select(Number(event.key) - 1, true);
  else if (event.key === "?") $("keys").showModal();
  // Space activates a button, summary or link that has the focus.
  else if (event.key === " " && !event.target.closest("button, summary, a")) freeze();
  else return;
  event.preventDefault();
});
$("freeze").addEventListener("click", freeze);
$("help").addEventListener("click", () => $("keys").showModal());
const recolour = () => {
  view.ink = colours();
  for (const damper of dampers.values()) damper.drawn = null;
};
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
addEventListener("resize", recolour);
connect();
setInterval(tell, 200);
tell();
frame();
