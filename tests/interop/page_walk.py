#!/usr/bin/env python3
"""Tests the live page of several dampers in headless Chromium, and prints what it found as one line of JSON.

walk     uses the keyboard alone: all dampers on a screen of 1920 x 1080; the order of the focus; Enter opens a damper, the arrow keys
         move the cursor of its charts, zoom and follow, Escape and the browser's back button return; a link opens a damper; exports
axe      lets axe-core (--axe) check all dampers, an opened one and the help, in light and dark mode and on a telephone's screen
measure  counts frames and measures memory for --seconds, with all dampers or with --damper opened

usage: page_walk.py walk|axe|measure BROWSER URL PROFILE [--axe axe.min.js] [--pictures DIRECTORY] [--seconds S] [--damper NAME]
"""

import argparse
import base64
import json
import os
import pathlib
import re
import time

from page_peer import Browser

# Name, code and virtual key code of keys that are not letters.
KEYS = {"Tab": 9, "Enter": 13, "Escape": 27, "ArrowLeft": 37, "ArrowRight": 39}
# Kind and name of the element that has the focus.
FOCUSED = """(() => {
  const one = document.activeElement;
  return one === document.body ? 'body' : `${one.localName} ${one.getAttribute('aria-label') ?? one.textContent.trim().slice(0, 40)}`;
})()"""
# Whether the focus is seen: an outline that the browser draws.
OUTLINED = """[undefined, '::after'].some((part) => {
  const { outlineStyle, outlineWidth } = getComputedStyle(document.activeElement, part);
  return outlineStyle !== 'none' && parseFloat(outlineWidth) >= 2;
})"""
OPENED = "(document.querySelector('.card.selected')?.getAttribute('aria-label') ?? '')"
TILES = """(() => {
  const tiles = [...document.querySelectorAll('.summary')];
  return { names: tiles.map((tile) => tile.dataset.damper), inside: tiles.every((tile) => {
    const box = tile.getBoundingClientRect();
    return box.top >= 0 && box.left >= 0 && box.right <= innerWidth && box.bottom <= innerHeight;
  }), charts: tiles.every((tile) => {
    const canvas = tile.querySelector('canvas');
    return canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value !== 0);
  }), counts: document.querySelector('#counts').innerText, link: document.querySelector('#link').innerText };
})()"""
# The next file that the page saves, as text, or as a data URL for a picture.
CATCH = """(() => {
  const make = URL.createObjectURL;
  globalThis.caught = null;
  URL.createObjectURL = (blob) => {
    const reader = new FileReader();
    reader.onload = () => { globalThis.caught = reader.result; };
    if (blob.type === 'text/csv') reader.readAsText(blob); else reader.readAsDataURL(blob);
    URL.createObjectURL = make;
    return make.call(URL, blob);
  };
})()"""
AXE = """axe.run(document, { resultTypes: ['violations'] }).then((found) => found.violations.map(
  ({ id, impact, help, nodes }) => ({ id, impact, help, nodes: nodes.slice(0, 3).map((node) => node.html.slice(0, 160)) })))"""
# Bytes that the page keeps of a damper after 25 and after 40 minutes at full rate, with the server's history.
KEPT = """import('/trails.js').then(({ Trails, SERIES }) => {
  const trails = new Trails();
  const bytes = () => trails.all().flatMap(({ points, buckets }) => [points, buckets]).reduce(
    (sum, rows) => sum + rows.t.byteLength + rows.v.reduce((own, column) => own + column.byteLength, 0), 0);
  const rows = (from, to, per_s, columns) => Array.from({ length: (to - from) * per_s }, (_, k) => [from + k / per_s, ...Array(columns).fill(k)]);
  const fill = (from, to) => {
    for (let s = from; s < to; s += 10) {
      const of = (per_s, each) => Object.fromEntries(Object.entries(SERIES).map(([name, columns]) => [name, rows(s, s + 10, per_s, each * columns)]));
      trails.add({ era: 0, zero_ns: 0, ...of(256, 1) }, false);
      trails.addHistory({ era: 0, zero_ns: 0, bucket_s: 0.1, ...of(10, 2) });
    }
  };
  fill(0, 1500);
  const before = bytes();
  fill(1500, 2400);
  return [before, bytes(), trails.estimate.points.first(), trails.estimate.buckets.first(), trails.newest()];
})"""
# Frames of the page while it is measured.
FRAMES = "(() => { globalThis.frames = []; const count = (t) => { globalThis.frames.push(t); requestAnimationFrame(count); }; requestAnimationFrame(count); })()"


class Page:
    def __init__(self, browser):
        self.browser = browser
        self.js = browser.evaluate

    def size(self, width, height, dark):
        self.browser.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500)
        scheme = "dark" if dark else "light"
        self.browser.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        time.sleep(0.5)

    def press(self, key, shift=False):
        code = KEYS.get(key)
        keys = {"key": key, "code": key, "windowsVirtualKeyCode": code} if code else {"key": key, "text": key}
        if key == "Enter":
            keys["text"] = "\r"
        self.browser.ask("Input.dispatchKeyEvent", type="keyDown" if "text" in keys else "rawKeyDown", modifiers=8 if shift else 0, **keys)
        self.browser.ask("Input.dispatchKeyEvent", type="keyUp", **{k: v for k, v in keys.items() if k != "text"})
        time.sleep(0.15)

    def until(self, expression, seconds=20):
        end = time.monotonic() + seconds
        while not (value := self.js(expression)):
            if time.monotonic() > end:
                raise SystemExit(f"not true within {seconds} s: {expression}; the page: {self.js('document.body.innerText')[:2000]}")
            time.sleep(0.1)
        return value

    def resolved(self, expression):
        answer = self.browser.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise SystemExit(f"in the page: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def picture(self, directory, name):
        if directory:
            picture = self.browser.ask("Page.captureScreenshot", format="png")
            (pathlib.Path(directory) / f"{name}.png").write_bytes(base64.b64decode(picture["data"]))

    def focus_order(self, most=60):
        """Presses Tab until the focus leaves the page; returns what had it, and what had it without being seen."""
        order, unseen = [], []
        # From the beginning of the page.
        self.js("(() => { const h = document.querySelector('h1'); h.tabIndex = -1; h.focus(); })()")
        for _ in range(most):
            self.press("Tab")
            here = self.js(FOCUSED)
            if here == "body" or (order and here == order[0]):
                break
            order.append(here)
            if not self.js(OUTLINED):
                unseen.append(here)
        return order, unseen

    def exported(self, kind):
        self.js(CATCH)
        self.js(f"document.querySelector('.card.selected [data-do={kind}]').click()")
        return self.until("globalThis.caught")


def walk(page, pictures):
    page.until("document.querySelectorAll('.summary').length > 1 && document.querySelector('#link').innerText.startsWith('live')")
    time.sleep(3)
    saw = {"overview": page.js(TILES)}
    page.picture(pictures, "overview-light")
    saw["order"], saw["unseen"] = page.focus_order()
    # To the first tile by the keyboard, and into it.
    page.js("document.activeElement.blur()")
    for _ in range(20):
        page.press("Tab")
        if page.js("document.activeElement.classList.contains('name')"):
            break
    first = page.js("document.activeElement.closest('.summary')?.dataset.damper")
    page.press("Enter")
    page.until(f"{OPENED} === 'damper {first}'", 5)
    saw["hash"], saw["into"] = page.js("location.hash"), page.js(FOCUSED)
    time.sleep(1)
    saw["opened_order"], unseen = page.focus_order()
    saw["unseen"] += unseen
    page.picture(pictures, "opened-light")
    saw["shown"] = page.js("[...document.querySelectorAll('.card.selected figure')].filter((f) => f.clientHeight > 0).map((f) => f.className.split(' ')[0])")
    # The cursor: the same time in all charts, and values in words.
    page.js("document.querySelector('.card.selected .readout').focus()")
    for _ in range(3):
        page.press("ArrowLeft", shift=True)
    time.sleep(0.3)
    saw["cursor"] = page.js("document.querySelector('.card.selected .readout').getAttribute('aria-valuetext')")
    saw["at"] = page.js("Object.fromEntries([...document.querySelectorAll('.card.selected [data-at]')].map((e) => [e.dataset.at, e.textContent]))")
    page.picture(pictures, "cursor-light")
    page.press("Escape")
    still = page.js(OPENED)
    page.press("+")
    page.until("document.querySelector('.card.selected .readout').textContent.startsWith('Held')", 5)
    saw["held"] = page.js("document.querySelector('.card.selected .readout').textContent")
    saw["csv"], saw["png"] = page.exported("csv"), page.exported("png")[:40]
    page.press("0")
    page.until("!document.querySelector('.card.selected .readout').textContent.startsWith('Held')", 5)
    # A long window needs the server's history.
    page.js("(() => { const s = document.querySelector('.card.selected select.span'); s.value = '600'; s.dispatchEvent(new Event('change')); })()")
    time.sleep(2)
    page.picture(pictures, "ten-minutes-light")
    saw["long_csv"] = page.exported("csv")[:400]
    page.js("(() => { const s = document.querySelector('.card.selected select.span'); s.value = '10'; s.dispatchEvent(new Event('change')); })()")
    page.press("Escape")
    page.until(f"{OPENED} === '' && document.activeElement.closest('.summary')?.dataset.damper === '{first}'", 5)
    saw["escape"] = [still == f"damper {first}", page.js("document.activeElement.closest('.summary')?.dataset.damper") == first]
    saw["kept"] = page.resolved(KEPT)
    # A link to a damper, and the browser's own way back.
    other = page.js("[...document.querySelectorAll('.summary')].at(-1).dataset.damper")
    page.js(f"location.hash = encodeURIComponent('{other}')")
    page.until(f"{OPENED} === 'damper {other}'", 5)
    page.js("history.back()")
    page.until(f"{OPENED} === ''", 5)
    saw["back"] = page.js("location.hash")
    return saw


def check(page, source, pictures):
    """The violations that axe-core finds, by state and mode."""
    found = {}
    name = page.js("document.querySelector('.summary').dataset.damper")
    opened = f"location.hash = encodeURIComponent('{name}')"
    for mode, (width, height), dark in [("light", (1920, 1080), False), ("dark", (1920, 1080), True), ("phone", (390, 844), True)]:
        page.size(width, height, dark)
        for state, go in [("overview", "location.hash = ''"), ("opened", opened), ("help", "document.querySelector('#keys').showModal()")]:
            page.js(go)
            time.sleep(1)
            page.js(source)
            found[f"{state}-{mode}"] = page.resolved(AXE)
            page.picture(pictures, f"{state}-{mode}")
            page.js("document.querySelector('#keys').close()")
            if page.js("document.documentElement.scrollWidth > document.documentElement.clientWidth"):
                found[f"{state}-{mode}"].append({"id": "wider than the screen", "impact": "serious", "help": "the page scrolls sideways", "nodes": []})
    page.size(1920, 1080, False)
    page.js("location.hash = ''")
    return found


def renderer(browser):
    """The renderer's process: its memory in MB (JavaScript heap, typed arrays, canvases and code), and its processor time in seconds."""
    session, browser.session = browser.session, None
    processes = browser.ask("SystemInfo.getProcessInfo")["processInfo"]
    browser.session = session
    memory, cpu_s = 0.0, 0.0
    for process in (process for process in processes if process["type"] == "renderer"):
        own = pathlib.Path(f"/proc/{process['id']}")
        memory += int(re.search(r"VmRSS:\s+(\d+)", (own / "status").read_text())[1]) / 1024
        times = (own / "stat").read_text().rsplit(") ", 1)[1].split()[11:13]
        cpu_s += sum(map(int, times)) / os.sysconf("SC_CLK_TCK")
    return memory, cpu_s


def measure(page, seconds):
    """Frames per second, processor time, and memory after garbage collection, ten times."""
    metrics = lambda: {m["name"]: m["value"] for m in page.browser.ask("Performance.getMetrics")["metrics"]}
    rows = []
    page.js(FRAMES)
    for _ in range(10):
        page.js("globalThis.frames.length = 0")
        (_, cpu_s), before, began = renderer(page.browser), metrics(), time.monotonic()
        time.sleep(seconds / 10)
        count, gap = page.js("(() => { const f = globalThis.frames, gaps = f.slice(1).map((t, k) => t - f[k]); return [f.length, Math.max(...gaps)]; })()")
        after, took = metrics(), time.monotonic() - began
        cpu_s = renderer(page.browser)[1] - cpu_s
        page.browser.ask("HeapProfiler.collectGarbage")
        rows.append({"frames_per_s": round(count / took, 1), "longest_gap_ms": round(gap),
                     "busy": round((after["TaskDuration"] - before["TaskDuration"]) / took, 2),
                     "script": round((after["ScriptDuration"] - before["ScriptDuration"]) / took, 2),
                     "cpu": round(cpu_s / took, 2), "cpu_ms_per_frame": round(1000 * cpu_s / max(count, 1), 1),
                     "heap_mb": round(metrics()["JSHeapUsedSize"] / 2**20, 1), "resident_mb": round(renderer(page.browser)[0], 1),
                     "nodes": int(after["Nodes"]), "load": os.getloadavg()[0], "rate": page.js("document.querySelector('#rate').textContent")})
    return rows


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["walk", "axe", "measure"])
    parser.add_argument("browser")
    parser.add_argument("url")
    parser.add_argument("profile")
    parser.add_argument("--axe", type=pathlib.Path, help="the file axe.min.js")
    parser.add_argument("--pictures", help="directory for pictures of the states")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--damper", default="", help="the damper to open while measuring; all dampers without it")
    args = parser.parse_args()
    browser = Browser(args.browser, args.profile)
    target = browser.ask("Target.createTarget", url="about:blank")["targetId"]
    browser.session = browser.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
    page = Page(browser)
    page.size(1920, 1080, False)
    for domain in ("Page", "Runtime", "Log", "Performance"):
        browser.ask(f"{domain}.enable")
    browser.ask("Page.navigate", url=args.url)
    page.until("document.readyState === 'complete' && document.querySelector('.summary, .card') !== null")
    page.until("document.querySelector('#link').innerText.startsWith('live')")
    if args.what == "walk":
        saw = walk(page, args.pictures)
    elif args.what == "axe":
        time.sleep(3)
        saw = {"axe": check(page, args.axe.read_text(), args.pictures)}
    else:
        page.js(f"location.hash = encodeURIComponent('{args.damper}')")
        time.sleep(3)
        saw = {"measured": measure(page, args.seconds)}
    errors = [e["params"] for e in browser.events if e.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded")]
    saw["errors"] = [json.dumps(error) for error in errors]
    print(json.dumps(saw), flush=True)
    browser.close()


if __name__ == "__main__":
    main()
