"""Look at pages in headless Chromium: none may be wider than its window, or ask another server.

`python benchmarks/pages.py FOLDER [SHOTS]` opens every page of a folder, as `mkdocs build` or
`socp report` made it, at three widths, measures `scrollWidth`, counts what it loads from elsewhere,
and writes a picture of each into a folder where one is named.
It needs `chromium` on PATH, which it speaks to through a pipe; `.ci/run` calls it where there is
one.
"""

import base64
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import IO, Any

WIDTHS = (1440, 800, 400)
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe")
_PATIENCE, _STEP = 30.0, 0.1  # seconds

_STRANGERS = (
    "performance.getEntriesByType('resource').map(each => each.name)"
    ".filter(name => !name.startsWith(location.origin)).join(' ')"
)


class Quiet(SimpleHTTPRequestHandler):
    """A server of files that says nothing."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""


class Page:
    """A tab of the browser, by the DevTools protocol: JSON between null characters."""

    def __init__(self, ask: IO[bytes], answer: IO[bytes]) -> None:
        self.ask, self.answer, self.count = ask, answer, 0
        self.to: dict[str, str] = {}
        target = self("Target.createTarget", url="about:blank")["targetId"]
        attached = self("Target.attachToTarget", targetId=target, flatten=True)
        self.to = {"sessionId": attached["sessionId"]}

    def __call__(self, method: str, **given: Any) -> Any:
        """Call a method of the protocol; events in between are passed over."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": given, **self.to}
        self.ask.write(json.dumps(message).encode() + b"\0")
        self.ask.flush()
        while (found := self._next()).get("id") != self.count:
            pass
        return found.get("result")

    def _next(self) -> dict[str, Any]:
        text = bytearray()
        while (byte := self.answer.read(1)) != b"\0":
            if not byte:
                raise SystemExit("the browser went away")
            text += byte
        found: dict[str, Any] = json.loads(text)
        return found

    def value(self, expression: str) -> Any:
        """Evaluate JavaScript."""
        return self("Runtime.evaluate", expression=expression)["result"].get("value")


def waited(ask: Any) -> Any:
    """Return the first answer that is one, asked again for a while."""
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until:
        if found := ask():
            return found
        time.sleep(_STEP)
    raise SystemExit("the browser does not answer")


@contextmanager
def browser() -> Iterator[Page]:
    """Yield a tab of a headless browser."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise SystemExit("no chromium on PATH")
    (theirs, ask), (answer, told) = os.pipe(), os.pipe()
    # the browser reads from descriptor 3 and writes to 4
    line = ["/bin/bash", "-c", f'exec "$@" 3<&{theirs} 4>&{told}', "bash", program, *FLAGS]
    process = subprocess.Popen(line, pass_fds=(theirs, told), stderr=subprocess.DEVNULL)  # noqa: S603
    os.close(theirs)
    os.close(told)
    try:
        with os.fdopen(ask, "wb") as asking, os.fdopen(answer, "rb") as answering:
            yield Page(asking, answering)
    finally:
        process.terminate()


def looked(page: Page, path: str, port: int, width: int) -> Iterator[str]:
    """Open a page; yield what is wrong with it."""
    page("Page.navigate", url=f"http://127.0.0.1:{port}/{path}")
    time.sleep(_STEP)
    waited(lambda: page.value("document.readyState") == "complete")
    seen = page.value("document.documentElement.scrollWidth")
    if seen > width:
        yield f"{path} at {width}: {seen} wide"
    strangers = page.value(_STRANGERS)
    if strangers:
        yield f"{path}: asks {strangers}"


def picture(page: Page) -> bytes:
    """Return a page from top to bottom as PNG."""
    size = page("Page.getLayoutMetrics")["cssContentSize"]
    clip = {**size, "scale": 1.0}
    shot = page("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
    return base64.b64decode(shot["data"])


def main() -> None:
    """Measure every page at every width."""
    site, shots = Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site)))
    Thread(target=server.serve_forever, daemon=True).start()
    paths = sorted(str(each.relative_to(site)) for each in site.rglob("*.html"))
    wrong = []
    with browser() as page:
        for width in WIDTHS:
            size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
            page("Emulation.setDeviceMetricsOverride", **size)
            for path in paths:
                wrong += looked(page, path, server.server_port, width)
                if shots is not None:
                    shots.mkdir(parents=True, exist_ok=True)
                    name = path.removesuffix(".html").removesuffix("/index").replace("/", "-")
                    (shots / f"{name}-{width}.png").write_bytes(picture(page))
    print(f"{len(paths)} pages at {len(WIDTHS)} widths; wrong: {wrong or 'nothing'}")
    raise SystemExit(bool(wrong))


if __name__ == "__main__":
    main()
