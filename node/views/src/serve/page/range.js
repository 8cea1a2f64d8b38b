// The time window of the charts of the opened damper, and the cursor in it. All charts share both, so they stay in step.

export const SPANS = [5, 10, 30, 60, 120, 300, 600];
/** Shortest window after zooming, s: a few samples. */
const SHORTEST_S = 0.02;

export const range = {
  /** Length of the window that follows the newest value, s. */
  span: innerWidth < 480 ? 5 : 10,
  /** A window `{ from, to }` that is held, in the damper's time; null while the newest value is followed. */
  held: null,
  /** Time of the cursor; null without one. */
  cursor: null,
  /** Interval that is being selected with the pointer. */
  selected: null,
};

/** The window for a damper whose newest value would be drawn at `edge`. */
export function windowAt(edge) {
  return range.held ?? { from: edge - range.span, to: edge };
}

export function follow() {
  range.held = range.selected = range.cursor = null;
}

export function hold(from, to) {
  if (to - from >= SHORTEST_S) range.held = { from, to };
  range.selected = null;
}

/** Shortens (factor < 1) or lengthens the window around `centre`; the longest one shows everything that is kept. */
export function zoom(factor, edge, centre) {
  const { from, to } = windowAt(edge);
  const longest = SPANS.at(-1), length = Math.min(Math.max((to - from) * factor, SHORTEST_S), longest);
  const share = (centre - from) / (to - from);
  let low = centre - share * length, high = low + length;
  if (high > edge) [low, high] = [edge - length, edge];
  hold(low, high);
}

/** Moves a window by a share of its length. At the newest value it is followed again. */
export function pan(share, edge) {
  const { from, to } = windowAt(edge), by = share * (to - from);
  if (to + by >= edge) {
    range.span = to - from;
    range.held = null;
  } else hold(from + by, to + by);
}

/** Moves the cursor by a share of the window; without a cursor it begins at the newest value. */
export function moveCursor(share, edge) {
  const { from, to } = windowAt(edge);
  const next = (range.cursor ?? to) + share * (to - from);
  range.cursor = Math.min(Math.max(next, from), to);
}
