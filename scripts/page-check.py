#!/usr/bin/env python3
"""Opens the page of `radarllm live sim:` in Chromium and checks what a user sees.

    scripts/page-check.py [--radarllm target/release/radarllm] [--pictures FOLDER] [--latency-s 60]

It needs Chromium (Debian: `apt-get install chromium`) and nothing else; without it, the script says so and ends with
exit code 77. Checks are of elements, not of pictures; `--pictures` writes screenshots for people to look at.
The exit code is 1 if a check fails.
"""

import argparse
import base64
import json
import os
import pathlib
import re
import shutil
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import urllib.parse
import urllib.request

SKIPPED = 77
CHROMIUM_FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--remote-debugging-port=0",
]
SIZES = {"phone": (390, 844), "tablet": (1280, 800)}

# Runs in the page before its own scripts: when a frame was stamped, and when it was drawn.
MEASURE = """
(() => {
  const waiting = [], latencies = window.latencies_ms = [];
  window.EventSource = class extends window.EventSource {
    constructor(...a) {
      super(...a);
      this.addEventListener("message", e => {
        if (e.data.includes('"type":"frame"')) waiting.push(Date.parse(JSON.parse(e.data).utc));
      });
    }
  };
  const clear = CanvasRenderingContext2D.prototype.clearRect;
  CanvasRenderingContext2D.prototype.clearRect = function (...a) {
    clear.apply(this, a);
    // After the drawing that this begins.
    queueMicrotask(() => { for (const stamp of waiting.splice(0)) latencies.push(Date.now() - stamp); });
  };
})();
"""

# Contrast of the text of every element that has some with the ground behind it: the smallest ratio.
CONTRAST = """
(() => {
  const parse = c => (c.match(/[\\d.]+/g) || []).map(Number);
  const luminance = ([r, g, b]) => {
    const part = v => (v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    return 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b);
  };
  const ground = e => {
    for (; e; e = e.parentElement) {
      const c = parse(getComputedStyle(e).backgroundColor);
      if (c.length === 3 || c[3] === 1) return c;
    }
    return [255, 255, 255];
  };
  let worst = { ratio: 99, text: "" };
  for (const e of document.querySelectorAll("body *")) {
    const text = [...e.childNodes].filter(n => n.nodeType === 3).map(n => n.data.trim()).join("");
    if (!text || !e.getClientRects().length) continue;
    const [a, b] = [luminance(parse(getComputedStyle(e).color)), luminance(ground(e))].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < worst.ratio) worst = { ratio, text: text.slice(0, 40) };
  }
  return worst;
})()
"""

# Pixels of the canvas in the colours of points that approach or recede.
COLOURED_PIXELS = """
(() => {
  const canvas = document.getElementById("scene"), style = getComputedStyle(document.documentElement);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const rgb = name => style.getPropertyValue(name).trim().match(/[0-9a-f]{2}/gi).map(h => parseInt(h, 16));
  const wanted = [rgb("--near"), rgb("--far"), rgb("--still")];
  let n = 0;
  for (let i = 0; i < data.length; i += 4)
    if (data[i + 3] > 60 && wanted.some(c => Math.abs(c[0] - data[i]) + Math.abs(c[1] - data[i + 1]) + Math.abs(c[2] - data[i + 2]) < 24)) n++;
  return n;
})()
"""


class Failed(Exception):
    """Something that must be so is not."""


def wait_for(what, check, seconds):
    end = time.monotonic() + seconds
    while True:
        found = check()
        if found:
            return found
        if time.monotonic() > end:
            raise Failed(f"never came within {seconds} s: {what}")
        time.sleep(0.05)


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Live:
    """`radarllm live sim:`, whose person falls."""

    def __init__(self, binary, folder, more):
        self.port = free_port()
        self.log = open(folder / "live.log", "w")
        command = [binary, "live", "sim:", "--name", "lounge", "--http", f"127.0.0.1:{self.port}", *more]
        self.process = subprocess.Popen(command, stdout=self.log, stderr=subprocess.STDOUT)
        self.url = f"http://127.0.0.1:{self.port}/"
        wait_for("the page is served", self.is_up, 60)

    def is_up(self):
        if self.process.poll() is not None:
            raise Failed(f"radarllm live ended: {pathlib.Path(self.log.name).read_text()}")
        try:
            return self.get("api/state")
        except OSError:
            return None

    def get(self, path):
        with urllib.request.urlopen(self.url + path, timeout=10) as answer:
            return json.load(answer)

    def stop(self):
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
                raise Failed("radarllm live does not stop within 10 s")


class WebSocket:
    """A client of RFC 6455 with what the DevTools protocol needs."""

    def __init__(self, port, path):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=60)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
        head = b""
        while b"\r\n\r\n" not in head:
            head += self.read(1)
        if b" 101 " not in head:
            raise Failed(f"Chromium refuses the connection: {head!r}")

    def read(self, n):
        parts = []
        while n:
            part = self.socket.recv(n)
            if not part:
                raise Failed("Chromium closed the connection")
            parts.append(part)
            n -= len(part)
        return b"".join(parts)

    def send(self, text):
        data, mask = text.encode(), os.urandom(4)
        n = len(data)
        if n < 126:
            head = bytes([0x81, 0x80 | n])
        elif n < 1 << 16:
            head = bytes([0x81, 0xFE]) + struct.pack(">H", n)
        else:
            head = bytes([0x81, 0xFF]) + struct.pack(">Q", n)
        self.socket.sendall(head + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data)))

    def receive(self):
        message = b""
        while True:
            first, second = self.read(2)
            n = second & 127
            if n == 126:
                n = struct.unpack(">H", self.read(2))[0]
            elif n == 127:
                n = struct.unpack(">Q", self.read(8))[0]
            payload = self.read(n)
            if first & 15 in (9, 10):
                continue
            message += payload
            if first & 0x80:
                return message.decode()


class Tab:
    """A tab of Chromium. What its console complains about is kept."""

    def __init__(self, browser_port):
        request = urllib.request.Request(f"http://127.0.0.1:{browser_port}/json/new?about:blank", method="PUT")
        with urllib.request.urlopen(request, timeout=30) as answer:
            target = json.load(answer)
        path = target["webSocketDebuggerUrl"].split(f":{browser_port}", 1)[1]
        self.socket, self.last_id = WebSocket(browser_port, path), 0
        self.complaints, self.hosts = [], set()
        for domain in ("Page", "Runtime", "Log", "Network", "Accessibility", "DOM"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        self.last_id += 1
        self.socket.send(json.dumps({"id": self.last_id, "method": method, "params": parameters}))
        while True:
            message = json.loads(self.socket.receive())
            if message.get("id") == self.last_id:
                if "error" in message:
                    raise Failed(f"{method}: {message['error']}")
                return message["result"]
            self.hear(message)

    def hear(self, event):
        method, what = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            details = what["exceptionDetails"]
            self.complaints.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Log.entryAdded" and what["entry"]["level"] == "error":
            self.complaints.append(f"{what['entry']['text']} {what['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent":
            self.hosts.add(urllib.parse.urlsplit(what["request"]["url"]).netloc)

    def open(self, url):
        self.call("Page.navigate", url=url)

    def value(self, expression):
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            raise Failed(f"{expression}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def text(self, selector):
        return self.value(f"[...document.querySelectorAll({json.dumps(selector)})].map(e => e.innerText).join('\\n')") or ""

    def is_visible(self, selector):
        return self.value(
            f"[...document.querySelectorAll({json.dumps(selector)})].some(e => e.checkVisibility({{visibilityProperty: true}}) && e.getBoundingClientRect().width > 0)")

    def key(self, key, code, text=None):
        parameters = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        if text:
            parameters["text"] = text
        self.call("Input.dispatchKeyEvent", type="keyDown", **parameters)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=key, windowsVirtualKeyCode=code)

    def size(self, width, height, mobile=False):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)

    def scheme(self, name):
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": name}])

    def picture(self, folder, name):
        if folder:
            shot = self.call("Page.captureScreenshot", captureBeyondViewport=False)
            (folder / f"{name}.png").write_bytes(base64.b64decode(shot["data"]))

    def accessibility(self):
        nodes = self.call("Accessibility.getFullAXTree")["nodes"]
        value = lambda node, key: (node.get(key) or {}).get("value") or ""
        return [(value(n, "role"), value(n, "name"), {p["name"]: p["value"].get("value") for p in n.get("properties", [])})
                for n in nodes if not n.get("ignored")]


class Chromium:
    def __init__(self, binary, folder):
        profile = folder / "profile"
        self.process = subprocess.Popen(
            [binary, *CHROMIUM_FLAGS, f"--user-data-dir={profile}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port_file = profile / "DevToolsActivePort"
        wait_for("Chromium starts", lambda: port_file.exists() and "\n" in port_file.read_text(), 60)
        self.port = int(port_file.read_text().split()[0])

    def stop(self):
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class Checks:
    """What was checked, one line each."""

    def __init__(self):
        self.n_failed = 0

    def so(self, what, is_so, found=""):
        self.n_failed += not is_so
        print(f"{'ok  ' if is_so else 'FAIL'} {what}{f': {found}' if found != '' else ''}", flush=True)

    def comes(self, what, check, seconds):
        try:
            found = wait_for(what, check, seconds)
        except Failed:
            self.so(what, False, f"not within {seconds} s")
            return None
        self.so(what, True, found if isinstance(found, (str, int, float)) and found is not True else "")
        return found


def check_first_sentence(checks, tab, url):
    began = time.monotonic()
    tab.open(url)
    sentence = checks.comes("a sentence is shown", lambda: tab.value(
        "(() => { const p = document.querySelector('#now .said'); return p && /^a person|^two|^the /i.test(p.innerText) ? p.innerText : ''; })()"), 30)
    took = time.monotonic() - began
    checks.so("the first sentence comes within 10 s of opening the page", sentence and took <= 10, f"{took:.1f} s")


def check_elements(checks, tab):
    checks.so("the title says SIMULATED", "SIMULATED" in tab.value("document.title"), tab.value("document.title"))
    n = tab.value("[...document.querySelectorAll('[data-simulated]')].filter(e => e.checkVisibility()).length")
    checks.so("SIMULATED is visible in the head, beside the sentence and above the timeline", n >= 3, n)
    checks.so("the name of the radar is shown", tab.text("#name") == "lounge")
    cards = tab.value("Math.max(...[...document.querySelectorAll('.panel')].map(card => [...card.querySelectorAll('.simulated')].filter(e => e.checkVisibility()).length))")
    checks.so("no card says it twice", cards == 1, cards)
    checks.comes("points are counted", lambda: tab.value(
        "+(document.getElementById('points').innerText.match(/^(\\d+) points/) || [0, 0])[1]"), 20)
    checks.comes("points are drawn", lambda: tab.value(COLOURED_PIXELS), 20)
    checks.comes("people are listed", lambda: (re.match(r"Person \d+: \d", tab.text("#people")) or [""])[0], 20)
    checks.comes("presence is told", lambda: "somebody there" in tab.text("#presence"), 20)
    checks.comes("its reason is told", lambda: tab.text("#why").startswith("Why:") and tab.text("#why"), 20)
    checks.so("the connection is live", tab.text("#link") == "live", tab.text("#link"))
    provenance = tab.text("#provenance")
    checks.so("provenance is told", "Simulated points of" in provenance and "model" in provenance)
    checks.so("confidence is shown", re.search(r"confidence \d+ %", tab.text("#now")) is not None)
    checks.comes("health is told", lambda: re.search(r"\d+ used", tab.text("#health")) is not None, 20)


def check_timeline(checks, tab):
    row = checks.comes("the timeline has rows", lambda: tab.text("#rows li .what:not(.event)").split("\n")[0], 40)
    if not row:
        return
    n_rows = lambda: tab.value("document.querySelectorAll('#rows li').length")
    submit = "document.getElementById('range').requestSubmit()"
    checks.comes("the day is drawn as lanes", lambda: tab.value("[...document.querySelectorAll('#lanes .lane > .dim')].map(e => e.innerText).join(', ')"), 20)
    checks.comes("somebody is there in a lane", lambda: tab.value("document.querySelectorAll('#lanes .present').length"), 60)
    checks.so("the lanes are told to those who do not see them", "somebody there for" in tab.value("document.getElementById('lanes').getAttribute('aria-label')"))
    checks.comes("what is done is in a lane", lambda: tab.value("document.querySelectorAll('#lanes .walk, #lanes .other, #lanes .stand_still, #lanes .sit_still, #lanes .lie_still').length"), 60)
    tab.value("document.querySelector('#lanes .bars i').click()")
    checks.so("a click on a lane finds its row", tab.value("document.querySelectorAll('#rows .found').length") == 1)
    word = next(w for w in row.lower().split() if w.isalpha() and len(w) > 3 and w not in ("person", "simulated"))
    tab.value(f"document.getElementById('words').value = {json.dumps(word)}; {submit}")
    found = lambda: [t.lower() for t in tab.text("#rows li .what").split("\n") if t]
    stem = word[:4]
    checks.comes(f"a search for `{word}` finds rows with it", lambda: found() and all(stem in t for t in found()), 10)
    tab.value(f"document.getElementById('words').value = 'xylophone'; {submit}")
    checks.comes("a search for a word that was never said finds nothing", lambda: n_rows() == 0, 10)
    tab.value("document.getElementById('today').click()")
    checks.comes("`Today` shows the rows again", lambda: n_rows() > 0, 10)
    tab.value("document.getElementById('day-before').click()")
    checks.comes("the day before has no rows", lambda: n_rows() == 0, 10)
    tab.value("document.getElementById('day-after').click()")
    checks.comes("and the day after has them", lambda: n_rows() > 0, 10)
    tab.value(f"document.getElementById('from').value = '2020-01-01T00:00'; document.getElementById('to').value = '2020-01-02T00:00'; {submit}")
    checks.comes("a range of another year has no rows", lambda: n_rows() == 0, 10)
    tab.value("document.getElementById('today').click()")
    tab.value("document.getElementById('question').value = 'when did anybody last walk?'; document.getElementById('ask').requestSubmit()")
    checks.comes("a question is answered", lambda: tab.text("#answer"), 10)


def check_sizes(checks, tab, pictures):
    for size, (width, height) in SIZES.items():
        tab.size(width, height, mobile=size == "phone")
        for scheme in ("light", "dark"):
            tab.scheme(scheme)
            time.sleep(1)
            name = f"{size} ({width}x{height}), {scheme}"
            over = tab.value("document.documentElement.scrollWidth - document.documentElement.clientWidth")
            checks.so(f"{name}: nothing is beside the screen", over <= 0, over)
            wide = tab.value(f"[...document.querySelectorAll('body *')].filter(e => e.checkVisibility() && !e.classList.contains('skip') && e.getBoundingClientRect().right > {width} + 1).map(e => e.id || e.className || e.tagName).join(' ')")
            checks.so(f"{name}: no element is cut off", wide == "", wide)
            worst = tab.value(CONTRAST)
            checks.so(f"{name}: contrast of texts is 4.5 or more", worst["ratio"] >= 4.5, f"{worst['ratio']:.1f} at `{worst['text']}`")
            canvas = tab.value("(() => { const r = document.getElementById('scene').getBoundingClientRect(); return [r.width, r.height]; })()")
            checks.so(f"{name}: the room is large enough", min(canvas) >= 240, canvas)
            tab.picture(pictures, f"{size}-{scheme}")
            tab.value("document.getElementById('range').scrollIntoView()")
            tab.picture(pictures, f"{size}-{scheme}-timeline")
            tab.value("window.scrollTo(0, 0)")
        small = tab.value("[...document.querySelectorAll('button')].filter(b => b.checkVisibility() && Math.min(b.getBoundingClientRect().width, b.getBoundingClientRect().height) < 32).map(b => b.id).join(' ')")
        checks.so(f"{size}: buttons can be hit", small == "", small)
    ground = {}
    for scheme in ("light", "dark"):
        tab.scheme(scheme)
        ground[scheme] = tab.value("getComputedStyle(document.body).backgroundColor")
    checks.so("dark and light differ", ground["light"] != ground["dark"], f"{ground['light']}, {ground['dark']}")
    tab.scheme("light")


def check_accessibility(checks, tab):
    tree = tab.accessibility()
    roles = {role for role, _, _ in tree}
    for role in ("banner", "main", "heading", "search", "form", "status", "image", "list", "listitem", "figure"):
        checks.so(f"there is the role {role}", role in roles)
    nameless = [role for role, name, _ in tree if role in ("button", "link", "textbox", "searchbox", "spinbutton", "combobox", "image", "form", "search") and not name]
    checks.so("everything that can be used has a name", not nameless, ", ".join(nameless))
    live = tab.value("document.getElementById('now').getAttribute('aria-live')")
    checks.so("sentences are in a polite live region", live == "polite", live)
    checks.so("the page has a language and one first heading",
              tab.value("document.documentElement.lang") == "en" and sum(r == "heading" and p.get("level") == 1 for r, _, p in tree) == 1)
    # Every field and button can be reached by the tabulator.
    reached = set()
    tab.value("document.activeElement.blur()")
    for _ in range(40):
        tab.key("Tab", 9)
        reached.add(tab.value("document.activeElement.id"))
    wanted = {"scene", "view", "question", "from", "to", "person", "action", "words", "today", "forget", "day-before", "day-after"}
    checks.so("the tabulator reaches everything", wanted <= reached, ", ".join(sorted(wanted - reached)))
    tab.value("document.getElementById('scene').focus()")
    picture = "document.getElementById('scene').toDataURL().length + ':' + document.getElementById('scene').toDataURL().slice(-400)"
    before = tab.value(picture)
    for _ in range(5):
        tab.key("ArrowRight", 39)
    checks.comes("arrow keys turn the room", lambda: tab.value(picture) != before, 5)
    checks.so("the room can be seen from above again", tab.text("#view") == "Show from above", tab.text("#view"))
    tab.value("document.getElementById('view').click()")
    checks.so("and from the side", tab.text("#view") == "Show from the side", tab.text("#view"))


def check_fall(checks, tab, other, live, pictures):
    is_shown = lambda t: t.value("!document.getElementById('alarm').hidden")
    checks.comes("the fall banner appears", lambda: is_shown(tab), 90)
    checks.so("it is an alert", ("alert", "Fall alarm") in [(r, n) for r, n, _ in tab.accessibility()])
    checks.so("it says that this is no medical device", "not a medical device" in tab.text("#alarm"))
    checks.so("it says SIMULATED", "SIMULATED" in tab.text("#alarm"))
    checks.so("the title tells it", tab.value("document.title").startswith("Fall!"), tab.value("document.title"))
    checks.so("a suspicion can be refused", tab.text("#acknowledge") in ("Not a fall", "Acknowledge"), tab.text("#acknowledge"))
    checks.comes("a suspected fall is confirmed", lambda: "has not got up" in tab.text("#alarm-text") and tab.text("#alarm-text"), 60)
    dwell = tab.text("#dwell")
    checks.comes("the dwell clock runs", lambda: tab.text("#dwell") != dwell and tab.text("#dwell"), 5)
    checks.comes("the other viewer sees it as well", lambda: is_shown(other), 10)
    for size, (width, height) in SIZES.items():
        tab.size(width, height, mobile=size == "phone")
        time.sleep(0.3)
        over = tab.value("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        checks.so(f"{size}: the banner fits", over <= 0, over)
        worst = tab.value(CONTRAST)
        checks.so(f"{size}: contrast with the banner is 4.5 or more", worst["ratio"] >= 4.5, f"{worst['ratio']:.1f} at `{worst['text']}`")
        tab.picture(pictures, f"{size}-fall")
    # By keyboard alone: from the top of the page with the tabulator to the button, then Enter.
    tab.value("document.activeElement.blur(); window.scrollTo(0, 0)")
    for _ in range(40):
        if tab.value("document.activeElement.id") == "acknowledge":
            break
        tab.key("Tab", 9)
    checks.so("the tabulator reaches the button", tab.value("document.activeElement.id") == "acknowledge")
    tab.key("Enter", 13, "\r")
    checks.comes("Enter acknowledges the fall", lambda: not is_shown(tab), 5)
    checks.comes("for the other viewer as well", lambda: not is_shown(other), 5)
    checks.comes("and for the server", lambda: live.get("api/state")["falls"] == [], 5)
    checks.comes("the timeline has the fall", lambda: "confirmed" in tab.text("#rows") and "fall acknowledged" in tab.text("#rows"), 20)
    checks.so("the focus is not lost", tab.value("document.activeElement.id") == "timeline", tab.value("document.activeElement.id"))


def check_latency(checks, tab, seconds):
    n_before = tab.value("latencies_ms.length")
    began = tab.value("Date.now()")
    time.sleep(seconds)
    latencies = sorted(tab.value(f"latencies_ms.slice({n_before})"))
    took_s = (tab.value("Date.now()") - began) / 1000
    if len(latencies) < 5 * seconds:
        checks.so("frames are drawn", False, f"{len(latencies)} in {took_s:.0f} s")
        return
    percentile = lambda p: latencies[min(len(latencies) - 1, int(p * len(latencies)))]
    checks.so(
        "a frame is drawn within 250 ms of its stamp (99th percentile)", percentile(0.99) <= 250,
        f"{len(latencies)} frames in {took_s:.0f} s: median {statistics.median(latencies):.0f} ms, "
        f"99th percentile {percentile(0.99)} ms, largest {latencies[-1]} ms")


def check(checks, live, browser, pictures, latency_s):
    tab = Tab(browser.port)
    tab.call("Page.addScriptToEvaluateOnNewDocument", source=MEASURE)
    tab.size(*SIZES["tablet"])
    check_first_sentence(checks, tab, live.url)
    check_elements(checks, tab)
    tab.picture(pictures, "tablet-person")
    other = Tab(browser.port)
    other.open(live.url)
    # A page in the background is not drawn.
    tab.call("Page.bringToFront")
    check_fall(checks, tab, other, live, pictures)
    check_timeline(checks, tab)
    check_sizes(checks, tab, pictures)
    tab.size(*SIZES["tablet"])
    check_accessibility(checks, tab)
    other.open("about:blank")
    if latency_s:
        check_latency(checks, tab, latency_s)
    live.stop()
    checks.comes("a server that is gone is told", lambda: tab.text("#link") == "not connected" and "unknown" in tab.text("#presence"), 10)
    own = live.url.split("/")[2]
    foreign = (tab.hosts | other.hosts) - {own, ""}
    checks.so("nothing is loaded from elsewhere", not foreign, ", ".join(foreign))
    complaints = [c for c in tab.complaints + other.complaints if "ERR_CONNECTION_REFUSED" not in c and "ERR_INCOMPLETE" not in c]
    checks.so("the console has no errors", not complaints, "; ".join(complaints[:3]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    root = pathlib.Path(__file__).resolve().parent.parent
    parser.add_argument("--radarllm", default=root / "target/release/radarllm")
    parser.add_argument("--chromium", default=shutil.which("chromium") or shutil.which("chromium-browser"))
    parser.add_argument("--pictures", type=pathlib.Path, help="folder for screenshots")
    parser.add_argument("--latency-s", type=float, default=60, help="how long latency is measured, 0 for not at all")
    arguments = parser.parse_args()
    if not arguments.chromium:
        print("skipped: chromium is not on PATH")
        return SKIPPED
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    version = subprocess.run([arguments.chromium, "--version"], capture_output=True, text=True).stdout.strip()
    print(version, flush=True)
    checks = Checks()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        more = ["--sim-fall-every", "1", "--fall-dwell", "8", "--db", str(folder / "live.db")]
        live = Live(arguments.radarllm, folder, more)
        browser = None
        try:
            browser = Chromium(arguments.chromium, folder)
            check(checks, live, browser, arguments.pictures, arguments.latency_s)
        finally:
            if browser:
                browser.stop()
            live.stop()
    print(f"{checks.n_failed} checks failed" if checks.n_failed else "all checks passed")
    return 1 if checks.n_failed else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Failed as failed:
        print(f"FAIL {failed}")
        sys.exit(1)
