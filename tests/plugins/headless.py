"""Rerun's viewer without a display: recordings opened, looked at and photographed. Its interface is
experimental.
"""

import contextlib
import io
import os
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

WIDTH, HEIGHT = 1920, 1080
SETTLED = 0.8  # seconds that plots take to reach their final shape


def vulkan() -> bool:
    """Tell whether a Vulkan driver is installed: Mesa's software one will do."""
    folders = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
    return "VK_DRIVER_FILES" in os.environ or any(
        list(folder.glob("*.json")) for folder in folders if folder.is_dir()
    )


class Viewer:
    """A running viewer."""

    def __init__(self, client: Any, port: int) -> None:
        self.client, self.port = client, port

    def open(self, path: Path) -> None:
        """Open a recording or a blueprint and wait until it is there."""
        last = time.monotonic() + 60
        while True:
            try:
                self.client.open(str(path.resolve()))
                break
            except RuntimeError:  # until its port answers
                assert time.monotonic() < last, f"the viewer does not open {path}"
                time.sleep(0.1)
        time.sleep(0.2)
        while self.client.get_state().loading:
            assert time.monotonic() < last, f"the viewer keeps loading {path}"
            time.sleep(0.05)
        time.sleep(SETTLED)

    def at(self, timeline: str, value: float) -> None:
        """Choose a timeline and a time on it."""
        place = {"duration": float(value)} if timeline == "t" else {"sequence": int(value)}
        self.client.set_time(timeline, **place, play_state="paused")
        time.sleep(SETTLED)

    def tab(self, index: int) -> None:
        """Choose one of the outermost tabs."""
        blueprint = self.client.get_blueprint("recording").blueprint
        tabs = [
            each["ContainerBlueprint"]
            for each in blueprint.values()
            if "active_tab" in each.get("ContainerBlueprint", {})
        ]
        (outermost,) = tabs
        outermost["active_tab"] = outermost["contents"][index]
        self.client.set_blueprint(blueprint, "recording")
        time.sleep(SETTLED)

    def views(self) -> dict[str, Any]:
        """Return the views by name."""
        return {view.name: view for view in self.client.get_state().views}

    def recordings(self, application: str) -> list[Any]:
        """Return the recordings of an application."""
        return [each for each in self.client.get_state().recordings if application in str(each)]

    def picture(self, view: Any = None) -> np.ndarray:
        """Return what the whole window, or one view, shows: (height, width, 3), 0 to 255."""
        from PIL import Image

        png = self.client.take_screenshot(*([] if view is None else [view.view_id]))
        with Image.open(io.BytesIO(png)) as image:
            return np.asarray(image.convert("RGB"))

    def errors(self) -> list[str]:
        """Return what the viewer has logged as an error."""
        return [str(line) for line in self.client.get_logs() if "ERROR" in str(line).upper()]


@contextlib.contextmanager
def viewer(home: Path) -> Iterator[Viewer]:
    """Start a viewer that knows nothing of earlier ones."""
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    before = {name: os.environ.get(name) for name in ("CI", "HOME")}
    os.environ |= {"CI": "1", "HOME": str(home)}
    try:
        rerun = Path(sys.executable).with_name("rerun")
        with ViewerClient.spawn(
            headless=True, port=port, executable_path=str(rerun), hide_welcome_screen=True
        ) as client:
            yield Viewer(client, port)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def near(image: np.ndarray, colour: tuple[int, int, int], within: int = 28) -> int:
    """Return how many pixels of an image have about a colour."""
    return int((np.abs(image.astype(int) - np.array(colour)).max(axis=2) <= within).sum())
