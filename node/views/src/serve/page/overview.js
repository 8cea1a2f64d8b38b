// All dampers as tiles, worst first, and the counts of alarms, faults and stopped dampers in the header.

import { Range, timeChart } from "/charts.js";
import { STOPPED_S, SUMMARY_CHART, bandText, residualText, showBadges } from "/detail.js";
import { $, addressOf, ago, alarmed, big, look, named, put, severity } from "/words.js";

/** Window of the small charts, s. */
const SPAN_S = 10;
/** A new order must have lasted this long, s, so that tiles do not swap places all the time. */
const SETTLED_S = 1;

/** The tile of a damper, with a link that opens it. */
export class Summary {
  constructor(damper) {
    this.damper = damper;
    this.range = new Range(10);
    this.drawn = null;
    this.tile = $("summary").content.firstElementChild.cloneNode(true);
    this.tile.dataset.damper = damper.name;
    this.find = (selector) => this.tile.querySelector(selector);
    // The link covers the tile.
    this.link = this.find(".name");
    this.link.href = addressOf(damper.name);
    put(this.link, damper.name);
    this.canvas = this.find("canvas");
    this.canvas.setAttribute("aria-label", `Force of damper ${damper.name} over the last ${SPAN_S} s`);
  }

  show(state) {
    const { tile, find } = this, { estimate, residual } = state;
    tile.classList.remove("good", "warning", "bad", "silent");
    tile.classList.add(state.level);
    put(find(".status"), state.status);
    showBadges(find, state);
    for (const [path, digits, unit] of [["estimate.force_n", 1, "N"], ["residual.residual_n", 1, "N"]]) big(find(`[data-big="${path}"]`), look(state, path), digits, unit);
    for (const figure of tile.querySelectorAll("[data-of]")) figure.classList.toggle("stale", state[figure.dataset.of]?.stale ?? false);
    put(find(".band"), estimate ? bandText(estimate) : "none received");
    put(find(".note.residual"), residual ? residualText(residual) : "no measured force");
    put(find(".big.age"), estimate ? ago(estimate.age_s) : "never");
    put(find(".age-note"), `${(state.rates_hz.force_estimate ?? 0).toFixed(0)} estimates per second`);
    const age = this.damper.age(), stopped = age > STOPPED_S && Number.isFinite(age);
    tile.classList.toggle("old", stopped);
    find(".stopped").hidden = !stopped;
    if (stopped) put(find(".stopped"), `stopped, newest value ${ago(age)}`);
  }

  draw(ink) {
    if (this.canvas.clientHeight === 0) return;
    const { damper } = this, edge = damper.edge(), step = (0.5 * SPAN_S) / Math.max(this.canvas.clientWidth, 1);
    if (this.drawn !== null && Math.abs(edge - this.drawn) <= step) return;
    this.drawn = edge;
    const time = { from: edge - SPAN_S, to: edge, live: damper.age() > STOPPED_S ? "last" : "now" };
    timeChart(this.canvas, damper.trails, SUMMARY_CHART, time, this.range, ink);
  }
}

const sorted = { wanted: "", since: 0 };

/** Names in the order of the overview. */
export function order(states) {
  return [...states].sort((a, b) => severity(b) - severity(a) || a.name.localeCompare(b.name)).map((state) => state.name);
}

/**
 * Puts the tiles in order, worst first. An order must have lasted for a moment, and no tile moves under the pointer or when the
 * keyboard is on it.
 */
export function arrange(dampers, now, atOnce) {
  const box = $("overview"), names = order([...dampers.values()].map(({ name, state }) => state ?? { name, level: "silent" }));
  const wanted = JSON.stringify(names), shown = JSON.stringify([...box.children].map((tile) => tile.dataset.damper));
  if (wanted === shown) return;
  if (sorted.wanted !== wanted) [sorted.wanted, sorted.since] = [wanted, now];
  const busy = box.matches(":hover") || box.contains(document.activeElement);
  if (!atOnce && (now - sorted.since < SETTLED_S || busy)) return;
  const focused = document.activeElement;
  box.replaceChildren(...names.map((name) => dampers.get(name).summary.tile));
  if (focused?.isConnected && box.contains(focused)) focused.focus({ preventScroll: true });
}

const KINDS = [
  ["fault", (state) => state.level === "bad"],
  ["stopped", (state) => state.level === "silent"],
  ["alarm", alarmed],
];

/** Shows the counts. Each count is a button that opens its dampers, one after the other. */
export function count(states, open) {
  const box = $("counts");
  if (!box.children.length) {
    for (const [kind] of KINDS) {
      const button = Object.assign(document.createElement("button"), { type: "button", className: `count is-${kind}`, hidden: true });
      button.addEventListener("click", () => {
        const names = JSON.parse(button.dataset.names);
        open(names[(names.indexOf(named()) + 1) % names.length]);
      });
      box.append(button);
    }
    box.append(Object.assign(document.createElement("span"), { className: "well" }));
  }
  let any = false;
  const words = [];
  KINDS.forEach(([kind, is], k) => {
    const names = order(states.filter(is)), button = box.children[k];
    button.hidden = names.length === 0;
    if (!names.length) return;
    any = true;
    const text = kind === "stopped" ? `${names.length} stopped` : `${names.length} ${kind}${names.length === 1 ? "" : "s"}`;
    words.push(text);
    put(button, text);
    const list = JSON.stringify(names);
    if (button.dataset.names !== list) button.dataset.names = list;
    button.setAttribute("aria-label", `${text}: open ${names.join(", ")}`);
  });
  put(box.lastChild, any || !states.length ? "" : "no alarms");
  const title = words.length ? `${words.join(", ")} · mr-damper` : "mr-damper";
  if (document.title !== title) document.title = title;
}
