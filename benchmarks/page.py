"""Measures the web page in Chromium, with WebGL in software, on a server of its own.

python -m ciir.benchmarks.page [--runs 5] [--seconds 5] [--light-fields 50]

Weight, first paint, first view of a shipped scene, frames while the viewpoint is dragged in views of 512x512 pixels,
and the memory after many light fields in one tab. Times need an unused machine; the processor time of a frame, of all
processes of the browser, hardly depends on what else runs.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from ciir.benchmarks.page_pictures import open_browser

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, CDPSession, Page

LARGE = "#scene=hamburger&lenses=512x512&pixels=5x5&show=around&model=none"
SMALL = "#scene=vase&lenses=40x40&pixels=5x5&show=around"
PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
VIEW = """() => new Promise((resolve) => {
    const find = () => document.querySelector("#frame > img");
    const look = () => (find() ? resolve(performance.now()) : requestAnimationFrame(look));
    look();
})"""
DRAG = """(seconds) => new Promise((resolve) => {
    const canvas = document.querySelector("#frame canvas"), box = canvas.getBoundingClientRect();
    const times = [], tasks = [];
    const keep = (list) => tasks.push(...list.getEntries().map((each) => each.duration));
    new PerformanceObserver(keep).observe({ type: "longtask" });
    const move = (time) => {
        times.push(time);
        const angle = (times.length / 60) * Math.PI;  // once around in two seconds
        const clientX = box.x + box.width * (0.5 + 0.3 * Math.cos(angle));
        const clientY = box.y + box.height * (0.5 + 0.3 * Math.sin(angle));
        canvas.dispatchEvent(new PointerEvent("pointermove", { pointerId: 1, clientX, clientY, bubbles: true }));
        if (time - times[0] < 1000 * seconds) requestAnimationFrame(move);
        else resolve({ frames: times.length - 1, took: time - times[0], tasks, side: canvas.width });
    };
    requestAnimationFrame(move);
})"""


def main(argv: list[str] | None = None) -> int:
    """Prints the figures as a table in Markdown."""
    parser = argparse.ArgumentParser(prog="benchmarks.page", description=main.__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--light-fields", type=int, default=50)
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder, run_server(Path(folder)) as url, open_browser() as browser:
        figures = [*measure_start(browser, url, args.runs), *measure_dragging(browser, url, args.runs, args.seconds)]
        figures += measure_memory(browser, url, args.light_fields)
    print("| | |\n|---|---|")
    for name, text in figures:
        print(f"| {name} | {text} |")
    return 0


@contextmanager
def run_server(folder: Path) -> Iterator[str]:
    """`ciir serve` on a free port, with no job done before; its address."""
    log = folder / "log"
    with log.open("wb") as output:
        command = [sys.executable, "-m", "ciir", "serve", "--port", "0"]
        environment = os.environ | {"CIIR_FOLDER": str(folder / "service")}
        process = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
    try:
        while (found := re.search(r"http://127\.0\.0\.1:\d+", log.read_text())) is None:
            time.sleep(0.1)
        yield found[0]
    finally:
        process.terminate()
        process.wait()


def open_page(browser: Browser, url: str) -> Page:
    """The page in a new profile."""
    page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    page.set_default_timeout(300_000)
    page.goto(url)
    return page


def measure_start(browser: Browser, url: str, runs: int) -> Iterator[tuple[str, str]]:
    """Weight, first paint, and the first view of a scene, each time turned otherwise."""
    paints, views = [], []
    for number in range(runs):
        page = open_page(browser, url)
        page.wait_for_function(f"() => {PAINT}")
        paints.append(page.evaluate(PAINT))
        sizes = page.evaluate("performance.getEntries().map((each) => each.transferSize ?? 0)")
        page.context.close()
        page = open_page(browser, f"{url}/#scene=vase&rotate={number + 1},0,0")
        views.append(page.evaluate(VIEW))
        page.context.close()
    yield "transferred before a mesh is opened", f"{sum(sizes) / 1000:.0f} kB"
    yield "first paint", describe_times(paints)
    yield "first view of a shipped scene, from the address to the picture", describe_times(views)


def measure_dragging(browser: Browser, url: str, runs: int, seconds: float) -> Iterator[tuple[str, str]]:
    """Frames while a pointer is held and moves."""
    page = open_page(browser, f"{url}/{LARGE}")
    page.get_by_role("checkbox", name="Disparity").wait_for()  # all views are there
    box = page.locator("#frame canvas").evaluate("each => each.getBoundingClientRect().toJSON()")
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    system = browser.new_browser_cdp_session()
    done: list[dict[str, Any]] = []
    for _ in range(runs):
        before = sum(each["cpuTime"] for each in read_processes(system))
        run = page.evaluate(DRAG, seconds)
        done.append(run | {"cpu": sum(each["cpuTime"] for each in read_processes(system)) - before})
    page.context.close()
    rates = [1000 * run["frames"] / run["took"] for run in done]
    sides = sorted({run["side"] for run in done})
    cpu = [1000 * run["cpu"] / run["frames"] for run in done]
    tasks = [task for run in done for task in run["tasks"]]
    drawn = " or ".join(map(str, sides))
    yield (
        "frames a second while dragging, of 60, views of 512x512 pixels",
        f"{median(rates):.0f} ({min(rates):.0f} to {max(rates):.0f}), in {drawn} pixels along a side",
    )
    yield "processor time of such a frame", describe_times(cpu)
    longest = max(tasks, default=0)
    yield "tasks of over 100 ms while dragging", f"{sum(task > 100 for task in tasks)}, the longest of {longest:.0f} ms"


def measure_memory(browser: Browser, url: str, count: int) -> Iterator[tuple[str, str]]:
    """JavaScript's heap and the browser's processes after a fifth of the light fields, and after all."""
    page = open_page(browser, url)
    devtools, system = page.context.new_cdp_session(page), browser.new_browser_cdp_session()
    for number in range(1, count + 1):
        page.goto(f"{url}/{SMALL}&rotate={number},0,0")
        page.get_by_role("checkbox", name="Disparity").wait_for()
        if number in (count // 5, count):
            devtools.send("HeapProfiler.collectGarbage")
            heap = page.evaluate("performance.memory.usedJSHeapSize")
            resident = sum(read_bytes(each["id"]) for each in read_processes(system))
            yield (
                f"memory after {number} light fields",
                f"{heap / 1e6:.1f} MB of JavaScript, {resident / 1e6:.0f} MB in all",
            )


def read_processes(system: CDPSession) -> list[dict[str, Any]]:
    """The processes of the browser."""
    return system.send("SystemInfo.getProcessInfo")["processInfo"]  # type: ignore[no-any-return]


def read_bytes(process: int) -> int:
    """Bytes of memory of a process, shared pages in part."""
    found = re.search(r"^Pss:\s*(\d+) kB", Path(f"/proc/{process}/smaps_rollup").read_text(), re.MULTILINE)
    return 1024 * int(found[1]) if found else 0


def describe_times(times: list[float]) -> str:
    """The median, and the least and the greatest."""
    return f"{median(times):.0f} ms ({min(times):.0f} to {max(times):.0f})"


if __name__ == "__main__":
    sys.exit(main())
