"""The server under load: mixed requests over many connections, each answer compared with the command line's.

    python -m tests.load.run [--requests 2000] [--seconds 1800] [--connections 16] [--json FILE] [--log FILE]

Starts `ciir serve` with a folder of its own, sends some requests of each kind, and then `--requests` of them
(`tests.load.requests`: half of them small views, the rest meshes, arrays, bad files and repetitions) over
`--connections` connections that are kept open; after `--seconds` no more are begun. A request whose answer asks the
client to wait (202, 429, a 503 with Retry-After) is sent again. Another process samples /healthz and memory meanwhile.

Then, with nothing else to do, small views one at a time: what the service adds to the pipeline's own time. At the end
`ciir reconstruct` does all of it again without a server: pictures must agree to the byte, and what it refuses must have
been refused. Each bound's line ends with whether it holds; exit status 1 where one does not. `CIIR_...` go to the
server as they are set.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import io
import json
import multiprocessing
import statistics
import sys
import tempfile
import threading
import time
import zipfile
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ciir.benchmarks import machine
from ciir.renderer.readers.png import SIGNATURE
from ciir.service.cli import main as cli
from tests.load.requests import LATER, Connection, LoadAnswer, find_origin, make_form, make_request, small
from tests.load.server import Seen, watch
from tests.support.servers import Server, run_server

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

WARM = 200
"""Requests before the count begins: enough of each kind for every worker to have had the largest."""
APART = 1_000_000
"""Requests from this number on are none of the load's."""
ALONE = 200
"""Small views that are asked for one at a time."""
MOST_HEALTH_MS, MOST_ADDED_MS, MOST_GROWTH = 50.0, 15.0, 0.10


class Line(NamedTuple):
    """One finding."""

    text: str
    holds: bool | None = None
    """None where nothing is asked for."""


def send_all(
    server: Server, numbers: range, connections: int, seconds: float, answers: Path | None
) -> dict[int, LoadAnswer]:
    """The answer to each request that was started in time; bodies go to `answers/NUMBER-STATUS`."""
    waiting, lock = iter(numbers), threading.Lock()
    done: dict[int, LoadAnswer] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:  # before anything is measured: this takes time and would slow the server
            Path(folder, str(number)).write_bytes(make_form(make_request(number)))
        end = time.monotonic() + seconds

        def work(_: int) -> None:
            with contextlib.closing(Connection(server.port)) as connection:
                while time.monotonic() < end:
                    with lock:
                        number = next(waiting, None)
                    if number is None:
                        return
                    done[number], body = connection.ask(Path(folder, str(number)).read_bytes())
                    if answers is not None:
                        (answers / f"{number}-{done[number].status}").write_bytes(body)

        with ThreadPoolExecutor(connections) as pool:
            list(pool.map(work, range(connections)))
    return done


def measure_load(server: Server, requests: int, connections: int, seconds: float, folder: Path) -> Iterator[Line]:
    """The load and its results, without the comparison; answers are written to `folder/answers`."""
    answers = folder / "answers"
    answers.mkdir()
    send_all(server, range(APART, APART + WARM), connections, seconds, None)
    spawn = multiprocessing.get_context("spawn")
    stop, seen_file = spawn.Event(), folder / "seen.json"
    watcher = spawn.Process(target=watch, args=(server.port, server.pid, stop, seen_file))
    watcher.start()
    begun = time.monotonic()
    done = send_all(server, range(requests), connections, seconds, answers)
    took = time.monotonic() - begun
    stop.set()
    watcher.join()
    if watcher.exitcode != 0:
        yield Line("the watch on /healthz failed", holds=False)
        return
    yield from summarise(done, requests, took)
    yield from check_samples(json.loads(seen_file.read_text()))


def summarise(done: dict[int, LoadAnswer], requests: int, seconds: float) -> Iterator[Line]:
    """Answers by status, and times by kind."""
    rate = len(done) / seconds
    yield Line(f"{len(done):,} of {requests:,} requests answered, {rate:.1f} a second", len(done) == requests)
    counts = collections.Counter(status for answer in done.values() for status in answer.statuses)
    yield Line("statuses: " + ", ".join(f"{status}: {count:,}" for status, count in sorted(counts.items())))
    undeclared = sum(count for status, count in counts.items() if status >= 500 and status != 503)
    undeclared += sum(answer.status == 503 for answer in done.values())
    yield Line(f"answers of 500 and above, but for 503 with a time to come again: {undeclared}", undeclared == 0)
    for kind in sorted({find_origin(number)[0] for number in done}):
        times = [answer.ms for number, answer in done.items() if find_origin(number)[0] == kind]
        middle, high = np.percentile(times, [50, 99])
        yield Line(f"  {kind:6s} {len(times):5,}: median {middle:7.0f} ms, 99th percentile {high:7.0f} ms")


def check_samples(seen: Seen) -> Iterator[Line]:
    """The samples of memory and health, with their bounds."""
    health = float(np.percentile(seen["health_ms"], 99))
    many = len(seen["health_ms"])
    yield Line(
        f"/healthz: median {statistics.median(seen['health_ms']):.1f} ms, 99th percentile {health:.1f} ms, "
        f"most {max(seen['health_ms']):.1f} ms of {many:,}; at most {MOST_HEALTH_MS:.0f} ms at the 99th asked for",
        health <= MOST_HEALTH_MS,
    )
    quarters = by_quarter(seen["bytes"])
    growth = quarters[3] / quarters[0] - 1
    yield Line(
        f"memory of all {statistics.median(seen['processes']):.0f} processes by quarter, MiB: "
        f"{', '.join(f'{quarter:.0f}' for quarter in quarters)}: {100 * growth:+.1f} %; at most "
        f"{100 * MOST_GROWTH:.0f} % more asked for",
        growth <= MOST_GROWTH,
    )
    yield Line(f"  of it the web process: {', '.join(f'{quarter:.0f}' for quarter in by_quarter(seen['web_bytes']))}")


def by_quarter(sizes: list[int]) -> list[float]:
    """Medians of the four quarters of the samples, MiB."""
    return [float(np.median(part)) / 2**20 for part in np.array_split(np.array(sizes), 4)]


def measure_single(server: Server) -> Iterator[Line]:
    """What the service adds to the pipeline's own time, one small view at a time."""
    with contextlib.closing(Connection(server.port)) as connection:
        answers = [connection.ask(make_form(small(2 * APART + number)))[0] for number in range(ALONE)]
    added = [answer.ms - answer.pipeline_ms for answer in answers if answer.pipeline_ms is not None]
    if len(added) < ALONE:
        yield Line(f"{ALONE - len(added)} of {ALONE} small views come without the pipeline's time", holds=False)
        return
    whole, extra = statistics.median(answer.ms for answer in answers), statistics.median(added)
    yield Line(
        f"a 50x50 view by itself: median {whole:.1f} ms, of which the service adds {extra:.1f} ms; "
        f"at most {MOST_ADDED_MS:.0f} asked for",
        extra <= MOST_ADDED_MS,
    )


def compare_answers(folder: Path, processes: int) -> Iterator[Line]:
    """Every answer compared with the command line's, in `processes` processes."""
    answers = folder / "answers"
    numbers = sorted(int(path.name.partition("-")[0]) for path in answers.iterdir())
    shares = [numbers[start::processes] for start in range(processes)]
    places = [folder / f"made-{n}" for n in range(processes)]
    for place in places:
        place.mkdir()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context) as pool:
        found = [line for lines in pool.map(list_differences, shares, [answers] * processes, places) for line in lines]
    yield Line(f"{len(numbers):,} answers compared with the command line's: {len(found)} differ", not found)
    for line in found[:20]:
        yield Line(f"  {line}")


def list_differences(numbers: Sequence[int], answers: Path, folder: Path) -> list[str]:
    """Of each of the requests `numbers` whose answer differs from the command line's a line that says how.

    `answers` holds `NUMBER-STATUS` with the body; `folder` is for what is made here. Runs in a process of its own.
    """
    return [line for number in numbers if (line := _difference(number, answers, folder))]


def _difference(number: int, answers: Path, folder: Path) -> str:
    given = make_request(number)
    (answer,) = answers.glob(f"{number}-*")
    status, body = int(answer.name.partition("-")[2]), answer.read_bytes()
    file = folder / f"{number}-{given.name}"
    out = folder / (f"{number}.png" if body.startswith(SIGNATURE) else str(number))  # one view, or a folder of them
    file.write_bytes(given.data)
    options = [word for name, value in given.options.items() for word in (f"--{name}", value)]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as errors:
        ended = cli.main(["reconstruct", str(file), "-o", str(out), *options])
    file.unlink()
    what = f"request {number}, {given.kind} {given.name}"
    if ended != 0:
        is_refused = ended == 2 and 400 <= status < 500 and status not in LATER
        return (
            "" if is_refused else f"{what}: answered {status}, the command line ends with {ended}: {errors.getvalue()}"
        )
    if status != 200:
        return f"{what}: answered {status}, the command line makes it: {body[:300]!r}"
    paths = [out] if out.is_file() else [*out.iterdir()]
    made = {path.name: path.read_bytes() for path in paths if path.suffix == ".png"}
    for path in paths:
        path.unlink()
    got = _pictures(body)
    if len(made) == 1 and len(got) == 1:
        return "" if list(made.values()) == list(got.values()) else f"{what}: another picture"
    wrong = sorted(name for name in made.keys() | got.keys() if made.get(name) != got.get(name))
    return f"{what}: {len(wrong)} of {len(made)} views differ, {wrong[0]} first" if wrong else ""


def _pictures(body: bytes) -> dict[str, bytes]:
    """An answer's pictures by name: those of a zip, or the one that it is."""
    if not body.startswith(b"PK"):
        return {"": body}
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name.endswith(".png")}


def print_lines(lines: Iterable[Line]) -> list[Line]:
    """Prints the lines as they come, with their verdicts, and returns them."""
    printed = []
    for line in lines:
        verdict = {None: "", True: ": holds", False: ": DOES NOT HOLD"}[line.holds]
        print(f"{line.text}{verdict}", flush=True)
        printed.append(line)
    return printed


def get_exit_status(lines: list[Line]) -> int:
    """1 if a bound does not hold."""
    return 0 if all(line.holds is not False for line in lines) else 1


def main(argv: list[str] | None = None) -> int:
    """Prints the lines."""
    parser = argparse.ArgumentParser(prog="tests.load.run", description=main.__doc__)
    parser.add_argument("--requests", type=int, default=2000, help="how many (default 2000)")
    parser.add_argument("--seconds", type=float, default=1800, help="after which no more are begun (default 1800)")
    parser.add_argument("--connections", type=int, default=16, help="parallel connections (default 16)")
    parser.add_argument("--json", type=Path, help="file for the lines and the machine")
    parser.add_argument("--log", type=Path, help="file for the server's log")
    given = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="ciir-load-") as name:
        folder = Path(name)

        def run() -> Iterator[Line]:
            with run_server(given.log or folder / "log", CIIR_FOLDER=str(folder / "jobs")) as server:
                yield from measure_load(server, given.requests, given.connections, given.seconds, folder)
                yield from measure_single(server)
            yield from compare_answers(folder, processes=2)

        lines = print_lines(run())
    if given.json:
        given.json.write_text(json.dumps({"machine": machine.describe(), "lines": lines}, indent=1))
    return get_exit_status(lines)


if __name__ == "__main__":
    sys.exit(main())
