"""Whether `--max-error` keeps what it promises, and what it gains.

    python -m benchmarks.bounded [--model fast fast-int8] [--bounds 0.5 1 2 4] [--data ../shared/data] [--rounds 3]

Pictures that no table was learnt on: views of the shipped scenes, Set5 and Set14, views of a captured elemental image
array, and where `--large` is given photographs of BSD100 in full. For each group and bound: the root mean square by
which any picture's result differs from the network's, as a share of the bound (worst picture; 1 is the promise); by how
much more it differs from the truth than the network's does, as a share of the bound; the mean Y-PSNR in dB by the
network and what the bound changes of it; the share of pixels that were interpolated; and how many times faster all
pictures of the group are done (whole and bounded in turns, the least time of all rounds). `!` marks a broken promise,
and the exit status is 1 then. Exact skipping is off here.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from benchmarks.bench import work
from models import bounded as tables
from models import catalogue
from models.metrics import luma, psnr
from models.pixels import upscale_pixels
from models.skip import NOTHING, Skipping, Tally
from renderer.scenes import SCENES
from service.request import Options
from training import evaluate, pictures

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from models.upscaler import Upscaler
    from service.request import Sampling
    from training.pictures import Picture

BOUNDS = (0.5, 1.0, 2.0, 4.0)
LENSES = (50, 100, 200)
EIA, LENS = "lightfields/eia-200x200x15.jpg", 15
SETS = ("Set5", "Set14")


class Seen(NamedTuple):
    """A picture that is upscaled."""

    low: Picture
    """`(H, W, 1 or 3)`, 8 bit."""
    high: Picture | None
    """What it ought to become, where that is known."""


class Row(NamedTuple):
    """What a bound does to a group of pictures."""

    worst: float
    """Root mean square difference from the network's picture, as a share of the bound; of the worst picture."""
    growth: float
    """The same of what the error against the truth grows by; nan without a truth."""
    by_network: float
    """Y-PSNR, dB."""
    change: float
    """Of that, by the bound."""
    interpolated: float
    """Share of pixels."""
    faster: float
    """Times."""

    @property
    def holds(self) -> bool:
        """Whether the promise is kept."""
        return self.worst <= 1 and not self.growth > 1


def groups(data: Path, *, large: bool) -> Iterator[tuple[str, list[Seen]]]:
    """Pictures by where they are from; what `data` doesn't hold is left out."""
    for lenses in LENSES:
        for sampling in ("pinhole", "lenslet"):
            yield (
                f"scenes {lenses}x{lenses} {sampling}",
                [one for name in SCENES for one in of_scene(name, lenses, sampling)],
            )
    for name in SETS:
        if (data / "images" / name).is_dir():
            lows = evaluate.low_files(data / "images" / name)
            highs = [path.with_name(path.name.replace("_LR", "_HR")) for path in lows]
            yield name, [Seen(pictures.read(low), pictures.read(high)) for low, high in zip(lows, highs, strict=True)]
    if (data / EIA).is_file():
        array = pictures.read_rgb(data / EIA)
        some = [(v, u) for v in (0, 7, 14) for u in (0, 7, 14)]
        yield "EIA 200x200", [Seen(np.ascontiguousarray(array[v::LENS, u::LENS]), None) for v, u in some]
    if large:
        files = sorted((data / "images" / "BSD100").glob("*_HR.png"))[::4]
        yield "BSD100 HR", [Seen(pictures.read(path), None) for path in files]


def of_scene(name: str, lenses: int, sampling: Sampling, wanted: str = "cross") -> list[Seen]:
    """Some views of a shipped scene and what they ought to become."""
    asked = Options(lenses=(lenses, lenses), pixels=(LENS, LENS), views=wanted, scale=2, strategy="direct")
    as_seen = replace(asked, sampling=sampling, strategy="upscale", model="none", scale=1)
    lows, highs = (work.views(name, options) for options in (as_seen, asked))
    return [Seen(low, high) for low, high in zip(lows, highs, strict=True)]


def measure(model: Upscaler, some: list[Seen], bound: float, rounds: int) -> Row:
    """One row of the table."""
    skipping = Skipping(exact=False, max_error=bound)
    tally = Tally()
    off, growth, scores, times = [], [], [], []
    for low, high in some:
        one = low[np.newaxis]
        whole = upscale_pixels(model, one, skipping=NOTHING)[0]
        made = upscale_pixels(model, one, skipping=skipping, tally=tally)[0]
        off.append(rms(made, whole) / bound)
        if high is not None:
            growth.append((rms(made, high) - rms(whole, high)) / bound)
            scores.append([psnr(brightness(each), brightness(high), border=2) for each in (whole, made)])
        spent: list[list[float]] = [[], []]
        for _ in range(rounds):
            for kind, each in enumerate((NOTHING, skipping)):
                begun = time.perf_counter()
                upscale_pixels(model, one, skipping=each)
                spent[kind].append(time.perf_counter() - begun)
        times.append([min(each, default=np.nan) for each in spent])
    by_whole, by_bounded = np.sum(times, axis=0)
    network, bounded = np.mean(scores, axis=0) if scores else (np.nan, np.nan)
    return Row(
        max(off),
        max(growth, default=np.nan),
        float(network),
        float(bounded - network),
        tally.interpolated / tally.pixels,
        float(by_whole / by_bounded),
    )


def rms(one: Picture, other: Picture) -> float:
    """Root mean square difference in levels, over all pixels and channels."""
    return float(np.sqrt(np.mean(np.square(one.astype(np.float64) - other))))


def brightness(picture: Picture) -> NDArray[np.float64]:
    """Y of `(H, W, 1 or 3)`, as the published protocol has it."""
    return luma(picture) if picture.shape[2] == 3 else picture[..., 0].astype(np.float64)


def main(argv: list[str] | None = None) -> int:
    """Prints a table for each model."""
    parser = argparse.ArgumentParser(prog="benchmarks.bounded", description=main.__doc__)
    parser.add_argument("--model", nargs="+", default=["fast", "fast-int8"], help="names (default fast, fast-int8)")
    parser.add_argument("--bounds", type=float, nargs="+", default=BOUNDS, help="levels of 255 (default 0.5 1 2 4)")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder of the test pictures")
    parser.add_argument("--rounds", type=int, default=3, help="times that each picture is timed (default 3; 0: not)")
    parser.add_argument("--large", action="store_true", help="photographs of BSD100 in full too")
    given = parser.parse_args(argv)
    found = list(groups(given.data, large=given.large))
    kept = True
    for name in given.model:
        model = catalogue.load(name)
        if tables.table_of(model) is None:
            parser.error(f"{name}: no table was learnt for it, and none of its pictures is interpolated; name others")
        sys.stdout.write(
            f"{name}\n{'pictures':24s}{'bound':>6s}{'of bound':>10s}{'of truth':>10s}{'Y-PSNR':>8s}{'change':>8s}"
            f"{'interpolated':>14s}{'faster':>8s}\n"
        )
        for group, some in found:
            for bound in given.bounds:
                row = measure(model, some, bound, given.rounds)
                kept &= row.holds
                sys.stdout.write(
                    f"{group:24s}{bound:6g}{row.worst:10.2f}{row.growth:10.2f}{row.by_network:8.2f}{row.change:8.2f}"
                    f"{row.interpolated:14.2f}{row.faster:8.2f}{'' if row.holds else ' !'}\n"
                )
                sys.stdout.flush()
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
