// The workshop: uploads and replays of runs, and diagnoses of dampers with their results.
//
// The server sends the state on each change, in the page's event stream; this file estimates only the remaining time of an upload.
// Requests are POST with the page's token. The text of every refusal is shown.

const HEADER = "x-mr-damper-token";
const TOKEN = document.querySelector('meta[name="mr-damper-token"]').content;
const $ = (id) => document.getElementById(id);
const shop = { state: null, cards: new Map(), links: new Map(), queue: [], sending: null, drawn: {} };

// ---- words

function put(element, text, kind = "") {
  if (element.textContent !== text) element.textContent = text;
  element.classList.toggle("bad", kind === "bad");
  element.classList.toggle("good", kind === "good");
}

function size(bytes) {
  const megabytes = bytes / 2 ** 20;
  return megabytes >= 1024 ? `${(megabytes / 1024).toFixed(1)} GB` : megabytes >= 10 ? `${megabytes.toFixed(0)} MB` : megabytes >= 0.1 ? `${megabytes.toFixed(1)} MB` : `${(bytes / 1024).toFixed(1)} kB`;
}

function span(s) {
  return s < 100 ? `${s.toFixed(s < 10 ? 1 : 0)} s` : `${Math.floor(s / 60)} min ${(s % 60).toFixed(0)} s`;
}

function make(name, text = "", attributes = {}) {
  return Object.assign(document.createElement(name), { textContent: text, ...attributes });
}

/** A table with column heads and rows of text; all columns except the first contain numbers. */
function table(heads, rows) {
  const whole = make("table"), number = (k) => (k ? "num" : "");
  const head = whole.createTHead().insertRow();
  heads.forEach((text, k) => head.append(make("th", text, { scope: "col", className: number(k) })));
  const body = whole.createTBody();
  for (const cells of rows) {
    const row = body.insertRow();
    cells.forEach((text, k) => row.append(make(k ? "td" : "th", text, k ? { className: "num" } : { scope: "row" })));
  }
  const scroll = make("div", "", { className: "scroll" });
  scroll.append(whole);
  return scroll;
}

/** Sends a request. The element `told` shows the answer, the refusal, or that there was no answer. */
async function ask(path, what, told) {
  try {
    const answer = await fetch(path, { method: "POST", headers: { [HEADER]: TOKEN, "Content-Type": "application/json" }, body: JSON.stringify(what) });
    const text = (await answer.text()).trim();
    if (!answer.ok) return put(told, `Refused: ${text}`, "bad");
    put(told, JSON.parse(text).says);
  } catch {
    put(told, "The server does not answer. Is it still running?", "bad");
  }
}

// ---- uploads

function reading() {
  const query = new URLSearchParams();
  for (const [id, key] of [["thesis", "thesis_txt"], ["skip", "skip_bad_rows"]]) if ($(id).checked) query.set(key, "true");
  for (const [id, key] of [["drive", "drive"], ["namespace", "namespace"], ["joint", "joint"]]) if ($(id).value.trim()) query.set(key, $(id).value.trim());
  return query;
}

function take(files) {
  shop.queue.push(...files);
  if (!shop.sending) next();
}

function next() {
  const file = shop.queue.shift();
  if (!file) return;
  const told = $("upload-told"), bar = $("upload-bar");
  const limit = shop.state?.upload_limit_bytes ?? Infinity;
  const end = (text, kind) => {
    shop.sending = null;
    bar.hidden = $("upload-stop").hidden = true;
    put(told, text, kind);
    next();
  };
  if (file.size > limit) return end(`Refused: ${file.name} has ${size(file.size)}, which is more than the limit of ${size(limit)}. Start the server with a larger --upload-limit-mb.`, "bad");
  const query = reading(), request = new XMLHttpRequest(), began = performance.now();
  query.set("name", file.name);
  request.open("POST", `/runs?${query}`);
  request.setRequestHeader(HEADER, TOKEN);
  request.upload.onprogress = ({ loaded, total }) => {
    const seconds = (performance.now() - began) / 1000;
    const left = loaded > 0 ? `, ${span((seconds * (total - loaded)) / loaded)} left` : "";
    bar.value = loaded / total;
    put(told, loaded < total ? `Uploading ${file.name}: ${size(loaded)} of ${size(total)}${left}` : `${file.name} is uploaded; the server is opening it`);
  };
  request.onload = () => {
    if (request.status !== 200) return end(`Refused: ${request.responseText.trim()}`, "bad");
    const about = JSON.parse(request.responseText);
    end(`${about.name} is uploaded: ${span(about.length_s)}${about.notes.length ? `. Note: ${about.notes.join("; ")}` : ""}`, "good");
  };
  request.onerror = () => end(`Interrupted: the connection was lost during the upload of ${file.name}, which is not kept. Upload it again when the server answers.`, "bad");
  request.onabort = () => end(`Cancelled: ${file.name} is not kept.`);
  shop.sending = request;
  bar.hidden = $("upload-stop").hidden = false;
  bar.value = 0;
  put(told, `Uploading ${file.name}: 0 of ${size(file.size)}`);
  request.send(file);
}

// ---- runs

function showRuns(runs, replay) {
  const under = replay && ["starting", "playing", "paused"].includes(replay.state);
  const drawn = JSON.stringify([runs, under && replay.run]);
  // Do not redraw an unchanged list, so that the focus stays in it.
  if (shop.drawn.runs === drawn) return;
  shop.drawn.runs = drawn;
  const focused = document.activeElement?.dataset?.of;
  $("runs").replaceChildren(...runs.map((run) => {
    const item = make("li"), row = make("p", "", { className: "row" });
    item.append(make("strong", run.name));
    if (run.state === "ready") {
      const rate = run.rate_hz === null ? "" : ` at ${run.rate_hz.toFixed(0)} Hz`;
      item.append(make("span", `${span(run.length_s)}${rate}, ${size(run.bytes)}: ${run.channels.join(", ")}`, { className: "note" }));
      if (run.notes.length) item.append(make("span", run.notes.join("; "), { className: "note" }));
      row.append(button(`Replay`, run.name, "play", () => ask("/replay", { run: run.name, model: $("model").value, rate: Number($("rate").value) }, $("runs-told"))));
      row.lastChild.disabled = Boolean(under);
    } else item.append(make("span", run.state === "opening" ? "being opened" : `cannot be used: ${run.why}`, { className: "note" }));
    row.append(button("Delete", run.name, "delete", () => confirm(`Delete ${run.name} from the workshop?`) && ask("/runs/delete", { run: run.name }, $("runs-told"))));
    item.append(row);
    return item;
  }));
  if (!runs.length) $("runs").append(make("li", "No runs yet: upload one above."));
  if (focused) [...$("runs").querySelectorAll("button")].find((one) => one.dataset.of === focused)?.focus({ preventScroll: true });
}

function button(text, of, what, click) {
  const one = make("button", text, { type: "button", onclick: click });
  one.dataset.of = `${what} ${of}`;
  one.setAttribute("aria-label", `${text} ${of}`);
  return one;
}

function showModels(models) {
  const drawn = JSON.stringify(models);
  if (shop.drawn.models === drawn) return;
  shop.drawn.models = drawn;
  const select = $("model"), chosen = select.value || "thesis/fuzzy-tanh/rp3-cs";
  select.replaceChildren(...models.map((name) => make("option", name, { value: name, selected: name === chosen })));
}

// ---- the replay

function showReplay(replay) {
  $("replay").hidden = !replay;
  if (!replay) return;
  const under = ["starting", "playing", "paused"].includes(replay.state);
  put($("replay-title"), `${replay.run}, ${replay.model}`);
  put($("replay-told"), replay.state === "failed" ? `Failed: ${replay.says}` : replay.says, replay.state === "failed" ? "bad" : "");
  $("replay-bar").value = replay.length_s > 0 ? replay.at_s / replay.length_s : 0;
  put($("replay-at"), `${span(replay.at_s)} of ${span(replay.length_s)}`);
  put($("replay-pause"), replay.state === "paused" ? "Continue" : "Pause");
  $("replay-pause").disabled = !under || replay.state === "starting";
  put($("replay-stop"), under ? "Stop" : "Close");
  if (document.activeElement !== $("replay-rate")) $("replay-rate").value = replay.rate;
  $("replay-rate").disabled = !under;
  const drawn = JSON.stringify(replay.figures);
  if (shop.drawn.figures === drawn) return;
  shop.drawn.figures = drawn;
  $("figures").replaceChildren(...figures(replay.figures));
}

function figures(of) {
  if (of.state === "computing") return [make("p", "The errors over the whole run are being computed.", { className: "note" })];
  if (of.state === "none") return [make("p", `No errors over the whole run: ${of.why}`, { className: "told bad" })];
  const row = (name, fit) => [name, fit ? fit.rsse_n.toFixed(2) : "–", fit?.esr == null ? "–" : fit.esr.toFixed(5), fit ? String(fit.samples) : "–"];
  const rows = [row("simulation (free run)", of.free_run), row("simulation, without mean error", of.free_run_without_offset)];
  // Persistence is the baseline of the one-step-ahead prediction only.
  if (of.one_step) rows.push(row("one-step-ahead prediction (with measured force)", of.one_step), row("persistence (one step)", of.persistence));
  const parts = [table(["whole run, computed offline", "RMSE, N", "NMSE", "samples"], rows)];
  const band = of.band ? `${(100 * of.band.share).toFixed(1)} % of the samples are within the model's 90 % band. ` : "";
  parts.push(make("p", `${band}Simulation uses displacement and drive, not the measured force.${of.one_step ? "" : " This model does not use measured force, so it has no one-step-ahead prediction."}${of.refused ? ` ${of.refused} samples were refused.` : ""}`, { className: "note" }));
  return parts;
}

// ---- closings

function hang({ detail: { name, card } }) {
  const part = $("closing").content.firstElementChild.cloneNode(true);
  const told = part.querySelector(".told");
  part.querySelector(".ask").setAttribute("aria-label", `Diagnose the model of ${name}`);
  part.querySelector(".ask").addEventListener("click", () => ask("/closing", { damper: name }, told));
  part.querySelector(".stop").addEventListener("click", () => ask("/closing/cancel", { damper: name }, told));
  card.insertBefore(part, card.querySelector(".rates"));
  shop.cards.set(name, part);
  shop.links.set(name, card.querySelector(".last-report"));
  showClosing(name, part);
}

function showClosing(name, part) {
  const state = shop.state;
  if (!state) return;
  showLastReport(name);
  const closing = state.closings[name], find = (selector) => part.querySelector(selector);
  const own = state.replay?.damper === name;
  const cannot = own ? null : state.no_closing;
  const under = closing && ["working", "cancelling"].includes(closing.state);
  find(".ask").disabled = Boolean(cannot || under);
  find(".stop").hidden = !under;
  find(".stop").disabled = closing?.state === "cancelling";
  find("progress").hidden = !under;
  find("progress").value = closing?.progress ?? 0;
  if (cannot) put(find(".told"), `No diagnosis from here: ${cannot}.`);
  else if (under) put(find(".told"), `The node is diagnosing its model on its history: ${closing.says}`);
  else if (closing) put(find(".told"), { done: closing.says, failed: `Failed: ${closing.says}`, cancelled: closing.says }[closing.state], closing.state === "failed" ? "bad" : "");
  const drawn = JSON.stringify(closing?.found ?? null);
  if (part.dataset.drawn === drawn) return;
  part.dataset.drawn = drawn;
  find(".found").hidden = !closing?.found;
  find(".found").replaceChildren(...(closing?.found ? found(closing) : []));
}

/** Links the last report of a damper, also one of an earlier run of the server. */
function showLastReport(name) {
  // The server names reports by the damper and the time: newest first.
  const begin = `${name.replace(/[:/ ]/g, "-")}-`;
  const of = (report) => report.startsWith(begin) && /^\d{8}T/.test(report.slice(begin.length));
  const report = shop.state.closings[name]?.report ?? shop.state.reports.find(of);
  const line = shop.links.get(name), link = line.firstElementChild;
  line.hidden = !report;
  if (!report || link.dataset.report === report) return;
  link.dataset.report = report;
  link.href = `/reports/${encodeURIComponent(report)}`;
  put(link, `Last diagnosis: ${report.replace(/\.html$/, "")}`);
}

function found({ found, report }) {
  const parts = [];
  if (found.effects.length) {
    const list = make("ul");
    for (const { title, parameters, chance, or } of found.effects) {
      list.append(make("li", `${title}: ${parameters.join("; ")}; ${chance}${or.length ? `; or one of ${or.join(", ").replaceAll("_", " ")}, which these runs cannot distinguish from it` : ""}`));
    }
    parts.push(list);
  }
  if (found.errors.length) {
    const cells = ({ runs, before, after, left }) => [runs, before.rsse_n.toFixed(2), after.rsse_n.toFixed(2), left];
    parts.push(table(["simulation error", "RMSE before, N", "after, N", "squared error left"], found.errors.map(cells)));
  }
  const model = make("p");
  if (!found.model_file) model.append("No effect was found, so no model file was written.");
  else if (found.loaded) model.append("The node runs the augmented model: ", make("code", found.model_file));
  else model.append(`The augmented model is not loaded${found.load_error ? ` (${found.load_error})` : ""}. To load it: `, make("code", found.load_line ?? ""));
  const file = found.model_file?.split("/").at(-1);
  if (shop.state.models.includes(file)) model.append(" It is among the models to replay with.");
  const link = make("a", "Full report", { href: `/reports/${encodeURIComponent(report)}`, target: "_blank", rel: "noopener" });
  const refused = make("details");
  refused.append(make("summary", "Full text, with refused effects and reasons"), make("pre", found.text));
  parts.push(model, make("p"), refused);
  parts[parts.length - 2].append(link);
  return parts;
}

// ---- all of it

function show(state) {
  shop.state = state;
  put($("folder"), state.folder);
  put($("limit"), size(state.upload_limit_bytes));
  const others = shop.sending ? [] : state.uploads;
  if (others.length) put($("runs-told"), others.map(({ name, bytes, of, opening }) => opening ? `${name} is uploaded and is being opened` : `${name} is being uploaded: ${size(bytes)}${of ? ` of ${size(of)}` : ""}`).join("; "));
  else if (shop.drawn.others) put($("runs-told"), "");
  shop.drawn.others = others.length > 0;
  showRuns(state.runs, state.replay);
  showModels(state.models);
  showReplay(state.replay);
  for (const [name, part] of shop.cards) showClosing(name, part);
  const drawn = JSON.stringify(state.reports);
  if (shop.drawn.reports !== drawn) {
    shop.drawn.reports = drawn;
    $("reports").hidden = !state.reports.length;
    $("reports").querySelector("ul").replaceChildren(...state.reports.slice(0, 50).map((name) => {
      const item = make("li");
      item.append(make("a", name, { href: `/reports/${encodeURIComponent(name)}`, target: "_blank", rel: "noopener" }));
      return item;
    }));
  }
}

document.addEventListener("mr-damper-card", hang);
document.addEventListener("mr-damper-workshop", ({ detail }) => show(detail));
$("changes-what").textContent = "This page is read-only except for the buttons of its workshop.";
$("files").addEventListener("change", () => {
  take($("files").files);
  $("files").value = "";
});
$("upload-stop").addEventListener("click", () => shop.sending?.abort());
$("replay-pause").addEventListener("click", () => ask("/replay/turn", { turn: shop.state?.replay?.state === "paused" ? "resume" : "pause" }, $("replay-told")));
$("replay-stop").addEventListener("click", () => ask("/replay/turn", { turn: "stop" }, $("runs-told")));
$("replay-rate").addEventListener("change", () => ask("/replay/turn", { turn: "rate", rate: Number($("replay-rate").value) }, $("replay-told")));
// A file that is dropped outside the upload area must not replace the page.
for (const kind of ["dragover", "drop"]) addEventListener(kind, (event) => event.preventDefault());
for (const [kind, over] of [["dragover", true], ["dragleave", false], ["drop", false]]) $("drop").addEventListener(kind, () => $("drop").classList.toggle("over", over));
$("drop").addEventListener("drop", (event) => $("bench").disabled || take(event.dataTransfer.files));
setInterval(() => {
  const { classList } = document.body, frozen = classList.contains("frozen"), lost = classList.contains("lost");
  $("bench").disabled = frozen || lost;
  $("bench-closed").hidden = !(frozen || lost);
  put($("bench-closed"), frozen ? "The page is frozen, and so is the state of the workshop shown here. Continue to use it." : lost ? "No data from the server: the state of the workshop shown here is old." : "", "bad");
  for (const part of shop.cards.values()) if (frozen || lost) part.querySelector(".ask").disabled = true;
}, 300);
