"""A headless Chromium driven over the DevTools protocol on two pipes: no driver, no server, no network."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync", "--remote-debugging-pipe")
PATIENCE = 20.0  # s for one answer; a loaded machine takes a few to start a browser


def browser() -> str | None:
    """The first browser that is installed."""
    return next((found for found in map(shutil.which, NAMES) if found), None)


class Tab:
    """One page in a browser of its own; `complaints` are what its console and its policy said."""

    def __init__(self, folder: Path, width: int = 1200, height: int = 900):
        requests, answers = os.pipe(), os.pipe()
        self.out, self.into, self.rest = requests[1], answers[0], b""
        self.process = subprocess.Popen(
            [str(browser()), *FLAGS, f"--user-data-dir={folder}", f"--window-size={width},{height}", "about:blank"],
            preexec_fn=lambda: _as_3_and_4(requests[0], answers[1]), pass_fds=(3, 4), stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL)
        os.close(requests[0])
        os.close(answers[1])
        self.count, self.session = 0, ""
        self.answers: dict[int, dict[str, Any]] = {}
        self.events: list[dict[str, Any]] = []
        self.complaints: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to one request; what comes in between is kept in `events`."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.out, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + PATIENCE
        while (answer := self.answers.pop(self.count, None)) is None:
            self._read(end)
        assert "error" not in answer, answer["error"]
        return dict(answer["result"])

    def _read(self, end: float) -> None:
        """What the browser has to say next; answers and events come in any order."""
        ready, _, _ = select.select([self.into], [], [], max(0.0, end - time.monotonic()))
        assert ready, "the browser does not answer"
        *whole, self.rest = (self.rest + os.read(self.into, 1 << 20)).split(b"\0")
        for found in map(json.loads, whole):
            if "id" in found:
                self.answers[found["id"]] = found
            else:
                self._event(found)

    def _event(self, found: dict[str, Any]) -> None:
        self.events.append(found)
        what, said = found["method"], found["params"]
        if what in ("Runtime.consoleAPICalled", "Runtime.exceptionThrown") or \
                (what == "Log.entryAdded" and said["entry"]["level"] in ("error", "warning")
                 and said["entry"]["source"] != "rendering"):  # a browser without a graphics card warns that it is slow
            self.complaints.append(json.dumps(said)[:400])

    def open(self, path: Path) -> None:
        """Load a file and wait until it has run."""
        self.go(path.as_uri())

    def go(self, address: str) -> None:
        """Load an address and wait until it has run."""
        before, end = len(self.events), time.monotonic() + PATIENCE
        self.call("Page.navigate", url=address)
        while not any(e["method"] == "Page.loadEventFired" for e in self.events[before:]):
            self._read(end)
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def run(self, script: str) -> Any:
        """The value of a piece of JavaScript."""
        found = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def screenshot(self) -> bytes:
        """What is seen, as a PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Pressed, released, moved or wheel."""
        self.call("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, **more)

    def wait(self, script: str, patience: float = PATIENCE) -> Any:
        """The value of a piece of JavaScript as soon as it is true."""
        end = time.monotonic() + patience
        while not (found := self.run(script)):
            assert time.monotonic() < end, f"never came true: {script}"
            time.sleep(0.03)
        return found

    def middle(self, selector: str) -> tuple[float, float]:
        """The middle of the first element that a selector finds, once it is on the page and scrolled to."""
        quoted = json.dumps(selector)
        self.wait(f"document.querySelector({quoted}) !== null")
        x, y = self.run(f"""(() => {{ const found = document.querySelector({quoted});
            found.scrollIntoView({{block: "nearest"}});
            const box = found.getBoundingClientRect(); return [box.x + box.width / 2, box.y + box.height / 2]; }})()""")
        return x, y

    def click(self, selector: str, count: int = 1) -> None:
        """Click what a selector finds with the mouse."""
        x, y = self.middle(selector)
        for k in range(count):
            self.mouse("Pressed", x, y, button="left", clickCount=k + 1)
            self.mouse("Released", x, y, button="left", clickCount=k + 1)

    def key(self, key: str, *, ctrl: bool = False, alt: bool = False, shift: bool = False, code: int = 0,
            text: str = "") -> None:
        """Press a key and let it go; `code` is its number on Windows, by which the browser knows Tab, Enter and arrows."""
        number = code or (ord(key.upper()) if len(key) == 1 else 0)
        more = {"key": key, "modifiers": 2 * ctrl + alt + 8 * shift, "windowsVirtualKeyCode": number}
        self.call("Input.dispatchKeyEvent", type="keyDown", **more, **({"text": text} if text else {}))
        self.call("Input.dispatchKeyEvent", type="keyUp", **more)

    def write(self, text: str) -> None:
        """Type a text where the focus is."""
        self.call("Input.insertText", text=text)

    def drop(self, selector: str, files: Mapping[str, str]) -> None:
        """Drop files with these texts on what a selector finds, as a file manager does."""
        added = "".join(f"data.items.add(new File([{json.dumps(text)}], {json.dumps(name)}));"
                        for name, text in files.items())
        self.run(f"""(() => {{ const data = new DataTransfer(); {added}
            const target = document.querySelector({json.dumps(selector)});
            for (const kind of ["dragenter", "dragover", "drop"])
                target.dispatchEvent(new DragEvent(kind, {{bubbles: true, cancelable: true, dataTransfer: data}})); }})()""")

    def requested(self) -> list[str]:
        """Every address that was asked for."""
        return [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]

    def close(self) -> None:
        """End the browser that was started here."""
        self.process.terminate()
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.out)
        os.close(self.into)


def _as_3_and_4(read: int, write: int) -> None:
    """In the child: the two ends at the numbers at which Chromium looks for them."""
    high = os.dup(write)  # `write` may itself be 3
    os.dup2(read, 3)
    os.dup2(high, 4)
