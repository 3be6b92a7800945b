"""Milliseconds until a browser first shows a preview of several episodes, and until all of it is there.

    python -m tools.bench.first_paint [--episodes 10] [--draws 4] [--record]

The sample's episode so many times, the recipe of `rpaug demo`; Chromium, headless, opens the page from a server on this
machine, three times, each with a fresh profile.
"""

import argparse
import http.server
import json
import os
import shutil
import statistics
import subprocess
import tempfile
import threading
from pathlib import Path

from rpaug.pages import preview
from rpaug.pipeline import inputs
from tools.bench.cost import dataset
from tools.bench.harness import pages

TELL = b"""<script>new PerformanceObserver((list) => {
  const [first] = list.getEntriesByName("first-contentful-paint"), all = performance.getEntriesByType("navigation")[0];
  if (first) fetch("/", {method: "POST", body: JSON.stringify([first.startTime, all.domContentLoadedEventEnd])});
}).observe({type: "paint", buffered: true})</script>"""
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
REPEATS = 3
LONGEST = 60  # seconds until a browser must have told


def measured(page: bytes) -> list[float]:
    """Milliseconds until the first paint, and until the page is read. Raises RuntimeError if a browser says nothing."""
    told: list[list[float]] = []
    done = threading.Event()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(page + TELL)

        def do_POST(self) -> None:
            told.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(200)
            self.end_headers()
            done.set()

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with (
        http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server,
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        given = ["--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
        url = f"http://127.0.0.1:{server.server_port}/"
        browser = subprocess.Popen(
            [str(CHROMIUM), *given, f"--user-data-dir={profile}", url],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        done.wait(LONGEST)
        browser.kill()
        browser.wait()
        server.shutdown()
    if not told:
        raise RuntimeError(f"{CHROMIUM} told nothing within {LONGEST} s")
    return told[0]


def main() -> None:
    """Make the page, measure, print, and record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = dataset(Path(folder), given.episodes)
        keys = preview.chosen(root, None, given.episodes)
        page = preview.page(root, keys, inputs.recipe("demo"), draws=given.draws)
    first, whole = (
        statistics.median(one)
        for one in zip(*(measured(page) for _ in range(REPEATS)), strict=True)
    )
    print(f"{len(page) / 1e6:.1f} MB: first paint {first:.0f} ms, all there {whole:.0f} ms")
    if given.record:
        rows: list[list[pages.Cell]] = [
            ["first paint, ms", {"value": round(first), "target": "<= 1000"}],
            ["all there, ms", round(whole)],
            ["the file, MB", round(len(page) / 1e6, 1)],
        ]
        table = pages.Table(
            id="preview",
            title=f"A preview of {given.episodes} episodes, {given.draws} draws each, in Chromium",
            command="python -m tools.bench.first_paint",
            seeds=f"medians of {REPEATS}; load {os.getloadavg()[0]:.1f} at the end",
            columns=["figure", "measured"],
            rows=rows,
            **pages.stamp(),
        )
        pages.record("main_job", table)


if __name__ == "__main__":
    main()
