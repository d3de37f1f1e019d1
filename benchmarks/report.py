"""Size of a run's page, seconds to make it and seconds until it can be used, at 10, 1,000 and 10,000 questions.

    python -m benchmarks.report [--sizes 10,1000,10000] [--overlays RUN]

Runs are made up (tests/jobs/synthetic_run.py), with about 14 calls and 10 views a question and thumbnails of twelve.
Load times are Chromium's, from disk, the best of five: until the page has loaded, until the list of questions is
there, and until a question is open. With --overlays the drawing of 24 questions of a real run is measured too.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from jobs.report import write_report
from jobs.report.pictures import DrawingBudget
from jobs.scoring.scores import Options
from tests.jobs.browser import Tab, browse, find_browser
from tests.jobs.synthetic_run import write_run

TRIES = 5
LISTED = "document.querySelectorAll('#rows li').length"
OPENED = "document.querySelector('#question .step')"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="10,1000,10000", help="questions, with commas between")
    parser.add_argument("--overlays", help="run folder whose scenes are at hand; its page is written again")
    asked = parser.parse_args()
    print("questions  page kB  list kB  shard kB  all MB  made s (CPU)  loaded ms  list ms  question ms  heap MB")
    for questions in map(int, asked.sizes.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            print(_row(Path(folder), questions), flush=True)
    if asked.overlays:
        for count in (0, 24):
            wall, cpu = _made(asked.overlays, DrawingBudget(count, 3600.0))
            print(f"{asked.overlays} with {count} questions drawn: {wall:.1f} s, {cpu:.1f} s CPU")


def _made(run: str, drawing: DrawingBudget) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    write_report(run, options=Options(resamples=200), drawing=drawing)
    return time.perf_counter() - wall, time.process_time() - cpu


def _row(folder: Path, questions: int) -> str:
    run = write_run(folder / "run", questions)
    wall, cpu = _made(run, DrawingBudget(questions=0))
    page, data = Path(run, "report.html"), Path(run, "report")
    shards = [path.stat().st_size for path in data.glob("q*.js")]
    sizes = [page.stat().st_size, (data / "list.js").stat().st_size, statistics.median(shards)]
    kilobytes = "  ".join(f"{size / 1e3:7.0f}" for size in sizes)
    whole = sum(path.stat().st_size for path in data.iterdir()) / 1e6
    times = "no Chromium"
    if find_browser() is not None:

        async def work(tab: Tab) -> list[float]:
            return await _load_times(tab, f"file://{page}", f"q{questions - 1:04d}")

        loaded, listed, opened, heap = browse(folder / "browser", work)
        times = f"{loaded:9.0f}  {listed:7.0f}  {opened:11.0f}  {heap / 1e6:7.1f}"
    return f"{questions:9,}  {kilobytes}  {whole:6.1f}  {wall:5.1f} ({cpu:4.1f})  {times}"


async def _load_times(tab: Tab, uri: str, question: str) -> list[float]:
    """Return milliseconds until loaded, listed and opened, the best of some, and the bytes of the page's objects."""
    found = []
    for _ in range(TRIES):
        await tab.open(uri)
        loaded = await tab.run("performance.getEntriesByType('navigation')[0].loadEventEnd")
        listed = await _until(tab, f"{uri}#questions", LISTED)
        opened = await _until(tab, f"{uri}#q={question}", OPENED)
        found.append((loaded, listed, opened))
    heap = (await tab.send("Runtime.getHeapUsage"))["usedSize"]
    return [*(min(column) for column in zip(*found, strict=True)), heap]


async def _until(tab: Tab, uri: str, ready: str) -> float:
    """Return milliseconds from the page's beginning until an expression holds, as seen by an observer in the page."""
    noted = f"new MutationObserver(() => {{ if ({ready}) window.readyAt ??= performance.now(); }})"
    script = f"{noted}.observe(document, {{ subtree: true, childList: true }});"
    told = await tab.send("Page.addScriptToEvaluateOnNewDocument", source=script)
    await tab.open(uri, "window.readyAt")
    await tab.send("Page.removeScriptToEvaluateOnNewDocument", identifier=told["identifier"])
    return float(await tab.run("window.readyAt"))


if __name__ == "__main__":
    main()
