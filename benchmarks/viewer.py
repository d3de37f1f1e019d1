"""Seconds until a scene is open, until a browser has it and until it shows it, and the server's memory.

    python -m benchmarks.viewer SCENE [--most 200000,1000000]

The command line is started as a person would; a websocket client then takes everything that a browser is sent; then
headless Chromium opens the page, and the first draw call with all Gaussians is waited for. There it draws in software,
on the same cores: a browser with a graphics card is faster by far.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import viser
from websockets.sync.client import connect

from tests.jobs.browser import Tab, browse, find_browser

WATCH = """
for (const kind of [WebGL2RenderingContext, WebGLRenderingContext])
  for (const name of ["drawElementsInstanced", "drawArraysInstanced"]) {
    const draw = kind.prototype[name];
    if (draw) kind.prototype[name] = function (...all) {
      const count = all[all.length - 1];
      if (count >= LEAST) window.drawn ??= performance.now();
      return draw.apply(this, all);
    };
  }
"""
"""Script that notes when so many instances were first drawn."""
QUIET_S = 2.0
"""Nothing more is sent once it was quiet for so long."""
BYTES, SLACK = 32, 20_000
"""Bytes a Gaussian as it is sent; Gaussians that the other things sent may weigh."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help="scene folder")
    parser.add_argument("--most", default="200000,1000000", help="Gaussians at most, with commas between")
    asked = parser.parse_args()
    print("most  open s  sent MB  sent s  server MB at most  first picture s (software)")
    for most in map(int, asked.most.split(",")):
        print(_row(asked.scene, most), flush=True)


def _row(scene: str, most: int) -> str:
    begun = time.perf_counter()
    command = [sys.executable, "-c", "from jobs.cli import main; main()", "view", scene, "--port", "0"]
    with subprocess.Popen([*command, "--max-gaussians", str(most)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            url = process.stdout.readline().split()[0]
            opened = time.perf_counter() - begun
            megabytes, seconds = _sent(url)
            shown = _shown(url, min(most, int(megabytes * 1e6 / BYTES) - SLACK)) if find_browser() else float("nan")
            status = Path(f"/proc/{process.pid}/status").read_text()
            peak = int(status.split("VmHWM:")[1].split()[0]) / 1e3
        finally:
            process.terminate()
    return f"{most:9,}  {opened:5.1f}  {megabytes:5.1f}  {seconds:5.2f}  {peak:6.0f}  {shown:5.1f}"


def _sent(url: str) -> tuple[float, float]:
    """Megabytes a browser is sent, and seconds until it has them."""
    begun = last = time.perf_counter()
    count, protocol = 0, f"viser-v{viser.__version__}"
    with connect(url.replace("http", "ws"), subprotocols=[protocol], max_size=None) as socket:
        while True:
            try:
                count += len(socket.recv(QUIET_S))
            except TimeoutError:
                return count / 1e6, last - begun
            last = time.perf_counter()


def _shown(url: str, count: int) -> float:
    """Seconds from opening the page until Chromium draws all Gaussians."""

    async def work(tab: Tab) -> float:
        await tab.send("Page.addScriptToEvaluateOnNewDocument", source=WATCH.replace("LEAST", str(count)))
        await tab.open(url, "document.querySelector('canvas')")
        await tab.until("window.drawn")
        return float(await tab.run("window.drawn")) / 1e3

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        return browse(Path(profile), work)


if __name__ == "__main__":
    main()
