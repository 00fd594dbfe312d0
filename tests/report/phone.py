"""A page in headless Chromium as on a phone: small, with touch, over the DevTools protocol's pipe."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# keeps every chart that the page makes in window.plots
WATCH = """Object.defineProperty(window, "uPlot", {
  configurable: true,
  get() { return this.kept; },
  set(made) {
    this.plots = [];
    const keep = function (...given) { const u = new made(...given); plots.push(u); return u; };
    this.kept = Object.assign(keep, made);
  },
});"""
Point = tuple[float, float]


class Phone:
    """The browser; `close` ends it."""

    def __init__(self, chromium: str, profile: Path) -> None:
        to_read, self._to = os.pipe()
        self._from, from_write = os.pipe()

        def wire() -> None:  # the protocol's pipe is 3 (read) and 4 (written by the browser)
            ends = fcntl.fcntl(to_read, fcntl.F_DUPFD, 50), fcntl.fcntl(from_write, fcntl.F_DUPFD, 60)
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        flags = ("--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe")
        self._process = subprocess.Popen(
            [chromium, *flags, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=wire,
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(from_write)
        self._count, self._arrived, self._session = 0, b"", ""
        (target,) = (t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self._session = attached["sessionId"]

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        self._count += 1
        asked = {"id": self._count, "method": method, "params": params}
        asked |= {"sessionId": self._session} if self._session else {}
        os.write(self._to, json.dumps(asked).encode() + b"\0")
        while True:
            while b"\0" not in self._arrived:
                part = os.read(self._from, 1 << 16)
                assert part, "the browser has ended"
                self._arrived += part
            one, _, self._arrived = self._arrived.partition(b"\0")
            answer = json.loads(one)
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def value(self, script: str) -> Any:
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, condition: str) -> None:
        for _ in range(200):
            if self.value(condition):
                return
            time.sleep(0.05)
        raise AssertionError(f"never: {condition}")

    def open(self, page: Path) -> None:
        self.call("Page.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=2, mobile=True
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
        self.call("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        self.call("Page.navigate", url=page.as_uri())
        self.wait("document.readyState === 'complete' && location.protocol === 'file:'")

    def gesture(self, start: Sequence[Point], end: Sequence[Point], steps: int = 10) -> None:
        """Fingers from start to end, each by its own way."""
        self._touch("touchStart", start)
        for k in range(1, steps + 1):
            way = [
                (x0 + (x1 - x0) * k / steps, y0 + (y1 - y0) * k / steps)
                for (x0, y0), (x1, y1) in zip(start, end, strict=True)
            ]
            self._touch("touchMove", way)
        self._touch("touchEnd", ())
        self.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def _touch(self, kind: str, points: Sequence[Point]) -> None:
        given = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=given)

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(10)
        os.close(self._to)
        os.close(self._from)
