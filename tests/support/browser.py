"""Headless Chromium for tests, driven through the ChromeDriver protocol with the standard library only."""

import base64
import contextlib
import json
import os
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
)  # fmt: skip
ROOT = Path(__file__).parents[2]


def axe() -> Path | None:
    """Path of axe.min.js: the environment variable AXE, or the file installed by `npm install axe-core`."""
    named = Path(os.environ.get("AXE", ROOT / "node_modules" / "axe-core" / "axe.min.js"))
    return named if named.is_file() else None


class Browser:
    """One browser window with one page."""

    def __init__(self, address: str) -> None:
        self._address = address
        options = {"binary": CHROMIUM, "args": list(FLAGS)}
        wanted = {"capabilities": {"alwaysMatch": {"goog:chromeOptions": options, "timeouts": {"script": 120_000}}}}
        self._session = f"/session/{self._send('POST', '/session', wanted)['sessionId']}"

    def open(self, page: Path, width: int, height: int, dark: bool = False, media: str = "screen") -> None:
        """Open a file in a window of the given size [CSS px], in light or dark colours, on screen or as printed."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.command("Emulation.setDeviceMetricsOverride", size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.command("Emulation.setEmulatedMedia", {"media": media, "features": [scheme]})
        self._send("POST", f"{self._session}/url", {"url": page.resolve().as_uri()})

    def run(self, script: str, *arguments: Any) -> Any:
        """Return the result of a script."""
        return self._send("POST", f"{self._session}/execute/sync", {"script": script, "args": list(arguments)})

    def run_async(self, script: str) -> Any:
        """Return the value that a script passes to its last argument, which is a callback."""
        return self._send("POST", f"{self._session}/execute/async", {"script": script, "args": []})

    def command(self, name: str, parameters: dict[str, Any]) -> Any:
        """Send a command of the Chromium DevTools protocol."""
        return self._send("POST", f"{self._session}/goog/cdp/execute", {"cmd": name, "params": parameters})

    def picture(self, path: Path, whole: bool = False) -> None:
        """PNG of the window, or of the full page."""
        found = self.command("Page.captureScreenshot", {"captureBeyondViewport": whole, "format": "png"})
        path.write_bytes(base64.b64decode(found["data"]))

    def print(self) -> bytes:
        """PDF of the page on A4."""
        paper = {"paperWidth": 8.27, "paperHeight": 11.69, "printBackground": False}
        return base64.b64decode(self.command("Page.printToPDF", paper)["data"])

    def close(self) -> None:
        """Quit the browser."""
        self._send("DELETE", self._session, None)

    def _send(self, how: str, path: str, body: Any) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._address + path, data, {"Content-Type": "application/json"}, method=how)
        try:
            with urllib.request.urlopen(request, timeout=120) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise RuntimeError(json.load(error)["value"]["message"]) from None


@contextlib.contextmanager
def browser() -> Iterator[Browser]:
    """Context manager: a browser that quits at the end of the block."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    driver = subprocess.Popen([str(DRIVER), f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        found = _session(f"http://127.0.0.1:{port}")
        try:
            yield found
        finally:
            found.close()
    finally:
        driver.terminate()
        driver.wait()


def _session(address: str) -> Browser:
    deadline = time.monotonic() + 30
    while True:
        try:
            return Browser(address)
        except OSError:  # the driver is not listening yet
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)
