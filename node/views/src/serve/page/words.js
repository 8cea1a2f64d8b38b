// Numbers, ages and states in words, and small helpers for the document.

export const NOTHING = "–";
export const $ = (id) => document.getElementById(id);
export const seconds = () => performance.now() / 1000;

/** True while the page is frozen: ages then refer to the time of freezing. */
let past = false;
export function setPast(value) {
  past = value;
}

export function fixed(value, digits) {
  return value === null || value === undefined || Number.isNaN(value) ? NOTHING : value.toFixed(digits).replace(/^-/, "−");
}

export function plain(value) {
  if (value === true) return "yes";
  if (value === false) return "no";
  if (Array.isArray(value)) return value.length ? value.join(", ").toLowerCase().replaceAll("_", " ") : "none";
  return value === null || value === undefined || value === "" ? NOTHING : String(value);
}

export function span(s) {
  return s < 100 ? `${s.toFixed(1)} s` : `${(s / 60).toFixed(0)} min`;
}

/** An age in words; while the page is frozen, the age at the time of freezing. */
export function ago(s) {
  if (s < 0.15) return past ? "at that time" : "now";
  return `${span(s)} ${past ? "before" : "ago"}`;
}

/** The value at a path such as "estimate.force_n". */
export function look(state, path) {
  return path.split(".").reduce((value, key) => value?.[key], state);
}

/** Sets a text only if it differs, so that the browser has less to lay out. */
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** A number with its unit in small print. */
export function big(element, value, digits, unit) {
  const text = `${fixed(value, digits)} `;
  if (element.childElementCount !== 1) element.replaceChildren("", Object.assign(document.createElement("small"), { textContent: unit }));
  if (element.firstChild.nodeValue !== text) element.firstChild.nodeValue = text;
  put(element.lastChild, unit);
}

/** The address of a damper within the page, and the damper that the current address names. */
export const addressOf = (name) => `#${encodeURIComponent(name)}`;
export function named() {
  try {
    return decodeURIComponent(location.hash.slice(1));
  } catch {
    return location.hash.slice(1);
  }
}

/** Severity of a state: its order in the overview. The largest comes first. */
export function severity(state) {
  if (state.level === "bad") return 4;
  if (state.level === "silent") return 3;
  if (alarmed(state)) return 2;
  return state.level === "warning" ? 1 : 0;
}

export function alarmed(state) {
  return Boolean(state.residual?.alarm && !state.residual.stale);
}
