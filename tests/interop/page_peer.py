#!/usr/bin/env python3
"""Opens the live page in headless Chromium, and prints its content in one line of JSON.

The browser is controlled over two pipes (DevTools protocol), so no port is opened and no other package is needed.

usage: page_peer.py BROWSER URL PROFILE [--seconds S] [--size WxH] [--dark] [--keys KEYS] [--file RUN] [--step JS]...
                    [--picture FILE] [--whole]
"""

import argparse
import base64
import json
import os
import subprocess
import sys
import time

# The table's values by their paths, exact and as displayed, and everything else that the tests check.
LOOK = """(() => {
  const card = document.querySelector('.card.selected') ?? document.querySelector('.card');
  const of = (selector) => card?.querySelector(selector)?.textContent ?? '';
  return {
    figures: Object.fromEntries([...(card?.querySelectorAll('data') ?? [])].map((d) => [d.dataset.path, [d.value, d.textContent]])),
    name: of('h2'), status: of('.status'), classes: card?.className ?? '', dampers: document.querySelectorAll('.card').length,
    link: document.querySelector('#link').textContent, rate: document.querySelector('#rate')?.textContent,
    banner: document.querySelector('#banner')?.hidden === false ? document.querySelector('#banner').textContent : '',
    body: document.body.innerText.slice(0, 400),
    wide: document.documentElement.scrollWidth - document.documentElement.clientWidth,
    help: document.querySelector('#keys')?.open, ages: [...(card?.querySelectorAll('td.age') ?? [])].map((cell) => cell.textContent),
    closing: of('.closing .told'), found: of('.closing .found'), report: card?.querySelector('.closing .found a')?.getAttribute('href') ?? '',
    shop: document.querySelector('#workshop')?.textContent ?? '',
    fetched: performance.getEntriesByType('resource').map((entry) => entry.name),
    drawn: [...document.querySelectorAll('canvas')].filter((c) => c.clientHeight > 0).map((canvas) => {
      const all = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
      return all.some((value) => value !== 0);
    }),
  };
})()"""


class Browser:
    """A browser controlled over two pipes."""

    def __init__(self, program, profile):
        theirs_in, self.out = os.pipe()
        self.inlet, theirs_out = os.pipe()

        def pipes():
            # The protocol uses file descriptors 3 and 4. The pipes are duplicated first, because they may have these
            # numbers already.
            ends = [os.dup(theirs_in), os.dup(theirs_out)]
            safe = [os.dup2(end, 20 + k, inheritable=True) for k, end in enumerate(ends)]
            os.dup2(safe[0], 3, inheritable=True)
            os.dup2(safe[1], 4, inheritable=True)

        self.process = subprocess.Popen(
            [program, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
             "--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=pipes, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(theirs_in)
        os.close(theirs_out)
        self.buffer, self.number, self.session, self.events = b"", 0, None, []

    def message(self):
        while b"\0" not in self.buffer:
            part = os.read(self.inlet, 1 << 16)
            if not part:
                sys.exit("the browser has ended")
            self.buffer += part
        text, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(text)

    def ask(self, method, **params):
        self.number += 1
        request = {"id": self.number, "method": method, "params": params}
        if self.session:
            request["sessionId"] = self.session
        os.write(self.out, json.dumps(request).encode() + b"\0")
        while True:
            message = self.message()
            if message.get("id") == self.number:
                if "error" in message:
                    sys.exit(f"{method}: {message['error']}")
                return message["result"]
            self.events.append(message)

    def evaluate(self, expression):
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in answer:
            sys.exit(f"in the page: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def close(self):
        self.session = None
        self.ask("Browser.close")
        # Nobody reads its output any more, and it might block on writing.
        os.close(self.inlet)
        os.close(self.out)
        try:
            self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            # The result has been read, so it does not matter how the browser ends.
            self.process.kill()
            self.process.wait()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("browser")
    parser.add_argument("url")
    parser.add_argument("profile")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--size", default="1280x900")
    parser.add_argument("--dark", action="store_true")
    parser.add_argument("--keys", default="", help="keys to press, one after the other")
    parser.add_argument("--file", help="a run to upload on the page of serve --workshop")
    parser.add_argument("--step", action="append", default=[], help="JavaScript to evaluate until it is true; several are done in order")
    parser.add_argument("--picture")
    parser.add_argument("--whole", action="store_true", help="take the picture of the whole page")
    args = parser.parse_args()
    browser = Browser(args.browser, args.profile)
    target = browser.ask("Target.createTarget", url="about:blank")["targetId"]
    browser.session = browser.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
    width, height = map(int, args.size.split("x"))
    browser.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500)
    scheme = "dark" if args.dark else "light"
    browser.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    for domain in ("Page", "Runtime", "Log"):
        browser.ask(f"{domain}.enable")
    browser.ask("Page.navigate", url=args.url)
    deadline = time.monotonic() + 20
    # Other sites' pages have no cards to wait for.
    while not browser.evaluate("document.readyState === 'complete' && document.querySelector('.card, #workshop, body:not(:has(#card))') !== null"):
        if time.monotonic() > deadline:
            break
        time.sleep(0.1)
    time.sleep(args.seconds)
    if args.file:
        root = browser.ask("DOM.getDocument")["root"]["nodeId"]
        field = browser.ask("DOM.querySelector", nodeId=root, selector="#files")["nodeId"]
        browser.ask("DOM.setFileInputFiles", nodeId=field, files=[args.file])
    for step in args.step:
        deadline = time.monotonic() + 60
        while not browser.evaluate(step):
            if time.monotonic() > deadline:
                sys.exit(f"not true within a minute: {step}; the page: {browser.evaluate('document.body.innerText')}")
            time.sleep(0.1)
    for key in args.keys.split():
        code = {"space": " "}.get(key, key)
        text = {"text": code} if len(code) == 1 else {}
        browser.ask("Input.dispatchKeyEvent", type="keyDown", key=code, **text)
        browser.ask("Input.dispatchKeyEvent", type="keyUp", key=code)
        time.sleep(0.5)
    saw = browser.evaluate(LOOK)
    errors = [e["params"] for e in browser.events if e.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded")]
    saw["errors"] = [json.dumps(error) for error in errors]
    if args.picture:
        picture = browser.ask("Page.captureScreenshot", format="png", captureBeyondViewport=args.whole)
        with open(args.picture, "wb") as file:
            file.write(base64.b64decode(picture["data"]))
    print(json.dumps(saw), flush=True)
    browser.close()


if __name__ == "__main__":
    main()
