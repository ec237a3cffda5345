"""Look at pages in headless Chromium: none may be wider than its window, or ask another server.

`python benchmarks/pages.py FOLDER [SHOTS]` opens every page of a folder, as `mkdocs build` or
`socp report` made it, at three widths, measures `scrollWidth`, counts what it loads from elsewhere,
and writes a picture of each into a folder where one is named.
It needs `chromium` on PATH and the package websocket-client, which socp itself does not.
"""

import base64
import json
import shutil
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import websocket

WIDTHS = (1440, 800, 400)
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--remote-allow-origins=*")
_PORT, _PATIENCE, _STEP = 9333, 30.0, 0.1  # seconds

_STRANGERS = (
    "performance.getEntriesByType('resource').map(each => each.name)"
    ".filter(name => !name.startsWith(location.origin)).join(' ')"
)


class Quiet(SimpleHTTPRequestHandler):
    """A server of files that says nothing."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""


class Page:
    """A tab of the browser."""

    def __init__(self, address: str) -> None:
        self.socket, self.count = websocket.create_connection(address), 0

    def __call__(self, method: str, **given: Any) -> Any:
        """Call a method of the DevTools protocol."""
        self.count += 1
        self.socket.send(json.dumps({"id": self.count, "method": method, "params": given}))
        while True:
            answer = json.loads(self.socket.recv())
            if answer.get("id") == self.count:
                return answer.get("result")

    def value(self, expression: str) -> Any:
        """Evaluate JavaScript."""
        return self("Runtime.evaluate", expression=expression)["result"].get("value")


def waited(ask: Any) -> Any:
    """Return the first answer that is one, asked again for a while."""
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until:
        try:
            found = ask()
        except OSError:
            found = None
        if found:
            return found
        time.sleep(_STEP)
    raise SystemExit("the browser does not answer")


@contextmanager
def browser() -> Iterator[Page]:
    """Yield a tab of a headless browser."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise SystemExit("no chromium on PATH")
    command = [program, *FLAGS, f"--remote-debugging-port={_PORT}", "about:blank"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)  # noqa: S603
    try:
        listed = f"http://127.0.0.1:{_PORT}/json"
        tabs = waited(lambda: json.load(urllib.request.urlopen(listed)))
        yield Page(next(tab for tab in tabs if tab["type"] == "page")["webSocketDebuggerUrl"])
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
