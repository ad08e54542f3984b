"""Measures the web page in Chromium, with WebGL in software, on a server of its own.

python -m ciir.benchmarks.page [--runs 5] [--seconds 5] [--light-fields 50]

It measures the weight, first paint, the heading, the first view of a shipped scene, the frames that are drawn while the
viewpoint is dragged in views of 512x512 pixels, and the memory after many light fields in one tab. Times need an idle
machine. The processor time of a frame, over all processes of the browser, hardly depends on what else runs.
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
APERTURES = 0, 2
"""Apertures while the viewpoint is dragged, in views: 0 blends two to four views, 2 adds up a disc of them."""
SMALL = "#scene=vase&lenses=40x40&pixels=15x15&show=around"
"""A light field of 225 views, which take 6 MB as a texture."""
PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
COUNT = """
window.draws = window.addresses = 0;
window.contexts = [];
new MutationObserver(() => document.querySelector("h1")?.setAttribute("elementtiming", "heading"))
    .observe(document, { subtree: true, childList: true });
new PerformanceObserver((list) => (window.heading = list.getEntries()[0].renderTime))
    .observe({ type: "element", buffered: true });
const { drawArrays } = WebGL2RenderingContext.prototype, { getContext } = HTMLCanvasElement.prototype;
const { createObjectURL, revokeObjectURL } = URL, live = new Set();
WebGL2RenderingContext.prototype.drawArrays = function (...given) {
    window.draws += 1;
    return drawArrays.apply(this, given);
};
HTMLCanvasElement.prototype.getContext = function (kind, ...given) {
    const context = getContext.call(this, kind, ...given);
    if (kind === "webgl2" && context) window.contexts.push(new WeakRef(context));
    return context;
};
URL.createObjectURL = (blob) => {
    const address = createObjectURL.call(URL, blob);
    window.addresses = live.add(address).size;
    return address;
};
URL.revokeObjectURL = (address) => {
    live.delete(address);
    window.addresses = live.size;
    revokeObjectURL.call(URL, address);
};
"""
"""Counts what the page draws and keeps, from its start on."""
LIVE = """({
    heap: performance.memory.usedJSHeapSize,
    contexts: contexts.filter((each) => each.deref()?.isContextLost() === false).length,
    addresses,
})"""
VIEW = """() => new Promise((resolve) => {
    const find = () => document.querySelector("#frame > img");
    const look = () => (find() ? resolve(performance.now()) : requestAnimationFrame(look));
    look();
})"""
DRAG = """(seconds) => new Promise((resolve) => {
    const canvas = document.querySelector("#frame canvas"), box = canvas.getBoundingClientRect();
    const times = [], tasks = [], sides = [], before = draws;
    const keep = (entries) => tasks.push(...entries.map((each) => each.duration));
    const observer = new PerformanceObserver((list) => keep(list.getEntries()));
    observer.observe({ type: "longtask" });
    const end = (drawn, took) => {
        keep(observer.takeRecords());
        observer.disconnect();
        resolve({ drawn, took, tasks, sides });
    };
    const move = (time) => {
        times.push(time);
        sides.push(canvas.width);
        const angle = (times.length / 60) * Math.PI;  // once around in two seconds
        const clientX = box.x + box.width * (0.5 + 0.3 * Math.cos(angle));
        const clientY = box.y + box.height * (0.5 + 0.3 * Math.sin(angle));
        canvas.dispatchEvent(new PointerEvent("pointermove", { pointerId: 1, clientX, clientY, bubbles: true }));
        if (time - times[0] < 1000 * seconds) requestAnimationFrame(move);
        else setTimeout(end, 100, draws - before, time - times[0]);  // after the entry of the last task
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
        figures = [*measure_start(browser, url, args.runs)]
        for aperture in APERTURES:
            figures += measure_dragging(browser, url, aperture, args.runs, args.seconds)
        figures += measure_memory(browser, url, args.light_fields)
    print("| | |\n|---|---|")
    for name, text in figures:
        print(f"| {name} | {text} |")
    return 0


@contextmanager
def run_server(folder: Path) -> Iterator[str]:
    """Runs `ciir serve` on a free port, with no earlier jobs, and yields its address."""
    log = folder / "log"
    with log.open("wb") as output:
        command = [sys.executable, "-m", "ciir", "serve", "--port", "0"]
        environment = os.environ | {"CIIR_FOLDER": str(folder / "service")}
        process = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
    try:
        while (found := re.search(r"http://127\.0\.0\.1:\d+", log.read_text())) is None:
            if process.poll() is not None:
                raise RuntimeError(f"ciir serve ended with status {process.returncode}: {log.read_text()[-2000:]}")
            time.sleep(0.1)
        yield found[0]
    finally:
        process.terminate()
        process.wait()


def open_page(browser: Browser, url: str) -> Page:
    """Opens the page in a new profile, with `COUNT`."""
    page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    page.set_default_timeout(300_000)
    page.add_init_script(COUNT)
    page.goto(url)
    return page


def measure_start(browser: Browser, url: str, runs: int) -> Iterator[tuple[str, str]]:
    """Measures weight, first paint, the heading, and the first view of a scene, with another rotation each time."""
    paints, headings, views = [], [], []
    for number in range(runs):
        page = open_page(browser, url)
        page.wait_for_function(f"() => window.heading && {PAINT}")
        paints.append(page.evaluate(PAINT))
        headings.append(page.evaluate("heading"))
        sizes = page.evaluate("performance.getEntries().map((each) => each.transferSize ?? 0)")
        page.context.close()
        page = open_page(browser, f"{url}/#scene=vase&rotate={number + 1},0,0")
        views.append(page.evaluate(VIEW))
        page.context.close()
    yield "transferred before a mesh is opened", f"{sum(sizes) / 1000:.0f} kB"
    yield "first paint, of the page's bar", describe_times(paints)
    yield "heading", describe_times(headings)
    yield "first view of a shipped scene, from the address to the picture", describe_times(views)


def measure_dragging(
    browser: Browser, url: str, aperture: float, runs: int, seconds: float
) -> Iterator[tuple[str, str]]:
    """Counts the frames that are drawn while a pointer is held and moves."""
    page = open_page(browser, f"{url}/{LARGE}&aperture={aperture}")
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
    rates = [1000 * run["drawn"] / run["took"] for run in done]
    sides = [side for run in done for side in run["sides"]]
    cpu = [1000 * run["cpu"] / run["drawn"] for run in done]
    tasks = [task for run in done for task in run["tasks"]]
    most = max(sides)
    full = f"{100 * sides.count(most) / len(sides):.0f} % in {most}x{most} pixels"
    yield (
        f"frames a second while dragging, of 60, aperture {aperture}",
        f"{median(rates):.0f} ({min(rates):.0f} to {max(rates):.0f}), {full}",
    )
    yield f"processor time of such a frame, aperture {aperture}", describe_times(cpu)
    yield (
        f"tasks of over 100 ms while dragging, aperture {aperture}",
        f"{sum(task > 100 for task in tasks)}, the longest of {max(tasks, default=0):.0f} ms",
    )


def measure_memory(browser: Browser, url: str, count: int) -> Iterator[tuple[str, str]]:
    """Measures what the page and the browser's processes keep after a fifth of the light fields, and after all."""
    page = open_page(browser, url)
    devtools, system = page.context.new_cdp_session(page), browser.new_browser_cdp_session()
    for number in range(1, count + 1):
        page.evaluate("document.querySelector('#frame canvas')?.setAttribute('data-old', '')")
        page.goto(f"{url}/{SMALL}&rotate={number},0,0")
        page.locator("#frame .light-field:not(:has([data-old])) [name=disparity]").wait_for()  # all views are there
        if number in (count // 5, count):
            devtools.send("HeapProfiler.collectGarbage")
            live = page.evaluate(LIVE)
            resident = sum(read_bytes(each["id"]) for each in read_processes(system))
            kept = f"{live['contexts']} WebGL contexts, {live['addresses']} object URLs"
            memory = f"{live['heap'] / 1e6:.1f} MB of JavaScript, {resident / 1e6:.0f} MB in all"
            yield f"memory after {number} light fields", f"{memory}, {kept}"


def read_processes(system: CDPSession) -> list[dict[str, Any]]:
    """Returns the processes of the browser."""
    return system.send("SystemInfo.getProcessInfo")["processInfo"]  # type: ignore[no-any-return]


def read_bytes(process: int) -> int:
    """Returns the memory of a process in bytes; shared pages count in part."""
    found = re.search(r"^Pss:\s*(\d+) kB", Path(f"/proc/{process}/smaps_rollup").read_text(), re.MULTILINE)
    return 1024 * int(found[1]) if found else 0


def describe_times(times: list[float]) -> str:
    """Formats the median, the least and the greatest time."""
    return f"{median(times):.0f} ms ({min(times):.0f} to {max(times):.0f})"


if __name__ == "__main__":
    sys.exit(main())
