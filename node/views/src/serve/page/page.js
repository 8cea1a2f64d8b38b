// The live page: listens to /events, keeps the last minutes of each damper, and draws all dampers or the opened one.
//
// The page must never show an old value as a current one. There are three causes of old values, and the page reports each in words: the
// damper is silent (the server reports this), the server is silent (LOST_S), or this browser lags behind the received data (BEHIND_S).

import { colours } from "/charts.js";
import { Detail } from "/detail.js";
import { Summary, arrange, count } from "/overview.js";
import { follow } from "/range.js";
import { Trails } from "/trails.js";
import { $, addressOf, named, put, seconds, setPast } from "/words.js";

const LOST_S = 1;
const BEHIND_S = 1;
/** After a failed request for history, the next one waits for this time, s. */
const RETRY_S = 5;

const dampers = new Map();
const view = { source: null, frozen: null, opened: null, ink: colours(), said: new Map() };
const link = { heard: null, offset: null, behind: 0, arrivals: [], frames: [], skipped: 0, gap: false, words: "connecting", origin: "" };

// ---- one damper

class Damper {
  constructor(name) {
    this.name = name;
    this.state = null;
    this.heard = 0;
    this.trails = new Trails();
    this.offset = null;
    this.fetching = false;
    this.fetched = -Infinity;
    this.detail = new Detail(this);
    this.summary = new Summary(this);
  }

  add(points, after) {
    if (this.trails.add(points, after)) {
      this.offset = null;
      if (this.name === view.opened) follow();
    }
    const newest = this.trails.newest();
    if (newest !== null) {
      const offset = seconds() - newest;
      const jumps = this.offset === null || Math.abs(offset - this.offset) > 0.5;
      this.offset = jumps ? offset : this.offset + (offset - this.offset) * 0.05;
    }
  }

  /** The time at the right edge of charts that follow: they scroll between batches too, and stop soon after the last one. */
  edge() {
    const newest = this.trails.newest();
    return newest === null ? 0 : Math.min(seconds() - this.offset, newest + 0.1);
  }

  /** Age of the newest point of a series, or of the newest one of all, s; infinite without points. */
  age(series) {
    const ages = this.state?.points_age_s ?? {};
    return series ? (ages[series] ?? Infinity) : Math.min(...Object.values(ages), Infinity);
  }

  origin() {
    return link.origin;
  }

  /** Asks the server for older values if a chart from `from` on needs them. */
  need(from) {
    if (this.trails.lacks(from) && !this.fetching && seconds() - this.fetched > RETRY_S) this.fetch();
  }

  async fetch() {
    const { trails } = this;
    [this.fetching, this.fetched] = [true, seconds()];
    try {
      const query = new URLSearchParams({ damper: this.name });
      if (Number.isFinite(trails.asked)) query.set("from_s", trails.asked - 1);
      const answer = await fetch(`/history?${query}`);
      // Without an answer the charts begin later. The page tells by itself that the server is lost.
      if (answer.ok) trails.addHistory(await answer.json());
    } catch {
      link.words ||= "no history from the server";
    } finally {
      this.fetching = false;
      this.detail.redraw();
    }
  }

  show(state) {
    this.state = state;
    if (this.name === view.opened) this.detail.show(state);
    if (!$("overview").hidden) this.summary.show(state);
  }

  redraw() {
    this.detail.redraw();
    this.summary.drawn = null;
  }
}

// ---- all dampers

function show(states) {
  const names = states.map((state) => state.name);
  if (names.length !== dampers.size || names.some((name) => !dampers.has(name))) {
    const before = new Map(dampers);
    dampers.clear();
    for (const name of names) dampers.set(name, before.get(name) ?? new Damper(name));
    for (const state of states) dampers.get(state.name).state = state;
    $("dampers").replaceChildren(...[...dampers.values()].map(({ detail }) => detail.card));
    $("overview").dataset.number = names.length;
    arrange(dampers, seconds(), true);
    route(false);
  }
  $("empty").hidden = names.length > 0;
  for (const state of states) {
    dampers.get(state.name).show(state);
    // Announced to screen readers only when level, mode or alarm has changed.
    const matter = `${state.level} ${state.estimate?.mode} ${state.residual?.alarm}`;
    if (view.said.has(state.name) && view.said.get(state.name) !== matter) put($("announce"), `${state.name}: ${state.status}`);
    view.said.set(state.name, matter);
  }
  arrange(dampers, seconds(), false);
  count(states, (name) => (location.hash = addressOf(name)));
}

/** Shows what the address names: a damper, or all of them. A single damper is opened at once. */
function route(focus) {
  const wanted = named() || (dampers.size === 1 ? [...dampers.keys()][0] : ""), before = view.opened;
  view.opened = dampers.has(wanted) ? wanted : null;
  const missing = wanted !== "" && view.opened === null && dampers.size > 0;
  $("unknown").hidden = !missing;
  if (missing) put($("unknown"), `No damper named ${wanted} is watched. These are all dampers that are.`);
  $("overview").hidden = view.opened !== null || dampers.size === 0;
  $("back").hidden = view.opened === null || dampers.size < 2;
  for (const [name, damper] of dampers) {
    const opened = name === view.opened;
    damper.detail.card.hidden = !opened;
    damper.detail.card.classList.toggle("selected", opened);
    damper.redraw();
    if (damper.state) damper.show(damper.state);
  }
  if (view.opened !== before) {
    follow();
    if (focus) scrollTo(0, 0);
  }
  if (!focus) return;
  // The focus follows: into the opened damper, and back to its tile.
  if (view.opened) dampers.get(view.opened).detail.card.focus({ preventScroll: true });
  else (dampers.get(before)?.summary.link ?? links()[0])?.focus();
}

/** The links of the tiles, in their order. */
const links = () => [...$("overview").querySelectorAll("a")];

/** Moves to the next damper: opens it, or moves the focus between the tiles. */
function step(by) {
  if (view.opened) {
    const names = [...dampers.keys()];
    if (names.length > 1) location.hash = addressOf(names[(names.indexOf(view.opened) + by + names.length) % names.length]);
    return;
  }
  const all = links(), at = all.indexOf(document.activeElement);
  all[at < 0 ? (by > 0 ? 0 : all.length - 1) : (at + by + all.length) % all.length]?.focus();
}

// ---- the stream

function connect() {
  view.source = new EventSource("/events");
  view.source.addEventListener("start", (event) => hear(JSON.parse(event.data), true));
  view.source.addEventListener("batch", (event) => hear(JSON.parse(event.data), false));
  view.source.addEventListener("workshop", (event) => document.dispatchEvent(new CustomEvent("mr-damper-workshop", { detail: JSON.parse(event.data) })));
  view.source.addEventListener("skipped", (event) => {
    link.skipped += Number(event.data);
    link.gap = true;
  });
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
    [link.offset, link.origin] = [null, news.source];
  }
  // The smallest transit time so far; the clocks may drift apart by 0.2 ms per second.
  const offset = now - news.now_s;
  link.offset = link.offset === null ? offset : Math.min(offset, link.offset + (now - link.heard) * 2e-4);
  [link.heard, link.behind, link.words] = [now, offset - link.offset, ""];
  link.arrivals.push(now);
  while (link.arrivals[0] < now - 1) link.arrivals.shift();
  if (news.dampers) show(news.dampers);
  for (const points of news.points ?? []) dampers.get(points.name)?.add(points, first || link.gap);
  link.gap = false;
}

function freeze() {
  view.frozen = view.frozen ? null : new Date();
  setPast(view.frozen !== null);
  $("freeze").setAttribute("aria-pressed", String(view.frozen !== null));
  put($("freeze-text"), view.frozen ? "Continue" : "Freeze");
  // A frozen page receives nothing and shows the ages at the time of freezing. Continuing starts with all points of the last ten seconds.
  if (view.frozen) {
    view.source.close();
    for (const damper of dampers.values()) if (damper.state) damper.show(damper.state);
  } else connect();
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
  put($("rate"), lost || view.frozen ? "" : `${link.arrivals.length} batches and ${link.frames.length} frames per second${skipped}`);
}

let frames = 0;
function frame() {
  const now = seconds(), phase = frames++ % 2;
  link.frames.push(now);
  while (link.frames[0] < now - 1) link.frames.shift();
  // Every other chart in every other frame: a chart that scrolls thirty times a second looks smooth, and a frame has half of the work.
  if (view.opened) dampers.get(view.opened)?.detail.draw(view.ink, phase);
  else [...dampers.values()].forEach(({ summary }, k) => k % 2 === phase && summary.draw(view.ink));
  requestAnimationFrame(frame);
}

// ---- keys, colours, start

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || $("keys").open) return;
  // An input element that has the focus gets the keys.
  if (event.target.closest("input, select, textarea")) return;
  const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  const act = { "+": "in", "=": "in", "-": "out", 0: "follow" }[event.key];
  if (by) step(by);
  else if (/^[1-9]$/.test(event.key)) {
    const name = [...dampers.keys()][Number(event.key) - 1];
    if (name !== undefined) location.hash = addressOf(name);
  } else if (event.key === "?") $("keys").showModal();
  else if (event.key === "Escape" && !$("back").hidden) location.hash = "";
  else if (act && view.opened) dampers.get(view.opened).detail.act(act);
  // Space activates a button, summary or link that has the focus.
  else if (event.key === " " && !event.target.closest("button, summary, a")) freeze();
  else return;
  event.preventDefault();
});
$("freeze").addEventListener("click", freeze);
$("help").addEventListener("click", () => $("keys").showModal());
addEventListener("hashchange", () => route(true));
const redraw = () => {
  view.ink = colours();
  for (const damper of dampers.values()) damper.redraw();
};
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
addEventListener("resize", redraw);
connect();
setInterval(tell, 200);
tell();
frame();
