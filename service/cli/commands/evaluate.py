"""`ciir evaluate`: the accuracy of models, and of results against their truth."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.models.catalogue import FALLBACK, LIGHT_FIELD_DEFAULT, list_names, list_single_image_names
from ciir.renderer.writers.atomic_write import place_for_file, replacing
from ciir.renderer.writers.writer import report_json
from ciir.service.cli import common
from ciir.service.cli.picture_arguments import READING_VIEWS
from ciir.service.pipeline.options import AUTO, Options, read_pair
from ciir.service.pipeline.source import make_layout

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable, Mapping, Sequence

    from ciir.models.cards import Accuracy
    from ciir.renderer.views import View
    from ciir.training.evaluation.light_fields import Measured

    Scores = Mapping[View, tuple[float, float]] | Mapping[str, tuple[float, float]]

VIEWS, DEGRADATION = "5x5", "bicubic"
"""The defaults for evaluating a light field, from BasicLFSR's protocol."""


def run(args: argparse.Namespace) -> None:
    """Runs the command."""
    options = common.parse_options(args)
    if args.json is not None:
        place_for_file(Path(args.json))
    reading = [name for name in READING_VIEWS if getattr(options, name) != getattr(Options, name)]
    of_views = [name for name in ("grid", "jpeg") if getattr(args, name) is not None]
    of_views += ["fusion"] if options.fusion != Options.fusion else []
    of_views += ["network_only"] if args.network_only else []
    if args.truth is not None:
        of_models = [name for name in ("degradation", "light_field") if getattr(args, name)]
        _refuse(of_views + of_models, "a MODEL")
        _evaluate_results(args, options, has_layout=bool(reading))
    elif args.light_field is not None:
        _evaluate_views(args, options)
    else:
        _refuse(of_views + reading, "--light-field")
        _evaluate_pictures(args, options)


def _refuse(given: Sequence[str], partner: str) -> None:
    if given:
        raise InvalidOption(f"--{given[0].replace('_', '-')}: this goes with {partner}; leave it out")


def _is_model(word: str) -> bool:
    return word in {AUTO, *list_names()} or word.endswith(".json")


def _check_models(names: Sequence[str]) -> None:
    for name in names:
        if not _is_model(name):
            raise InvalidOption(
                f"evaluate: no model {name!r} here; give one of {', '.join(list_names())}, or the .json of a network"
            )


def _evaluate_pictures(args: argparse.Namespace, options: Options) -> None:
    count = next((n for n, word in enumerate(args.words) if n and not _is_model(word)), None)
    if count is None:
        raise InvalidOption(
            "evaluate: give MODELs and FOLDERs of pictures (as ./NAME if a model has that name), --light-field INPUT, "
            "or --truth INPUT and RESULTs; see ciir evaluate --help"
        )
    models, names = args.words[:count], args.words[count:]
    if not _is_model(models[0]) and Path(models[0]).exists():
        raise InvalidOption(f"evaluate: {models[0]} is no model; to compare results, give --truth INPUT and RESULTs")
    _check_models(models)
    for name in models:
        if name in list_names() and name not in list_single_image_names():
            raise InvalidOption(
                f"evaluate: {name} upscales views of a light field, not single pictures; give --light-field {names[0]}"
            )
    for name in names:
        if Path(name).is_file():
            raise InvalidOption(
                f"{name}: a file, but a folder of pictures is needed; for a light field give --light-field {name}"
            )
    from ciir.training.evaluation.pictures import describe_protocol, load_model, measure

    folders = common.find_folders(names, what="pictures, after the names of models that `ciir models` lists")
    upscalers = [load_model(model, scale=options.scale) for model in models]
    entries: list[dict[str, Any]] = []
    for (model, upscaler), folder in itertools.product(zip(models, upscalers, strict=True), folders):
        try:
            found = measure(upscaler, folder, degradation=args.degradation)
        except ValueError as error:
            raise InvalidOption(str(error)) from error
        scores = found.mean, "pictures", found.pictures
        _show_score(f"{model} on {found.mean.data}", *scores)
        about = {"model": model, "data": found.mean.data, "degradation": args.degradation or None}
        entries.append(about | _describe_scores(*scores))
    _write_scores(describe_protocol(folders, args.degradation), options.scale, entries, args.json)


def _evaluate_views(args: argparse.Namespace, options: Options) -> None:
    if args.network_only and options.fusion != Options.fusion:
        raise InvalidOption("--fusion: --network-only scores views without it; leave one of them out")
    names = args.words or [LIGHT_FIELD_DEFAULT]
    for name in names:
        if name not in list_names() and Path(name).is_dir():
            raise InvalidOption(
                f"evaluate: both the folder {name!r} and --light-field {args.light_field} are given; give one of them"
            )
    _check_models(names)
    if args.jpeg is not None and not 1 <= args.jpeg <= 100:
        raise InvalidOption(f"--jpeg: {args.jpeg} is out of range; give 1 to 100")
    grid, degradation = read_pair("grid", args.grid or VIEWS), args.degradation or DEGRADATION
    from ciir.training.evaluation.light_fields import describe_protocol, load_network, measure

    networks = [load_network(name, options.scale) for name in names]  # finds a misspelt name before the work starts
    entries: list[dict[str, Any]] = []
    notes: tuple[str, ...] = ()
    for name, network in zip(names, networks, strict=True):
        try:
            found = measure(
                network,
                Path(args.light_field),
                grid=grid,
                degradation=degradation,
                layout=make_layout(options),
                jpeg=args.jpeg,
                fusion=options.fusion,
                network_only=args.network_only,
            )
        except ValueError as error:
            raise InvalidOption(str(error)) from error
        helped = "" if args.network_only else _describe_fallback(found)
        scores = found.mean, "views", found.views
        _show_score(f"{name} on {found.mean.data}", *scores, helped)
        shares = {"fallback": found.mean.fallback, "averaged": found.averaged, "network_only": args.network_only}
        about = {"model": name, "data": found.mean.data, "degradation": degradation}
        entries.append(about | shares | _describe_scores(*scores))
        notes = found.notes
    common.print_notes(notes)
    _write_scores(describe_protocol(grid), options.scale, entries, args.json, notes)


def _evaluate_results(args: argparse.Namespace, options: Options, *, has_layout: bool) -> None:
    if not args.words:
        raise InvalidOption(f"evaluate: give results to compare with --truth {args.truth}")
    from ciir.training.evaluation.light_fields import Measured
    from ciir.training.evaluation.maps import compare_maps, is_map
    from ciir.training.evaluation.results import PROTOCOL, compare

    truth, layout = Path(args.truth), make_layout(options) if has_layout else None
    are_maps = layout is None and is_map(truth)
    entries: list[dict[str, Any]] = []
    notes: list[str] = []
    for name in args.words:
        try:
            if are_maps:
                score, found_notes = compare_maps(Path(name), truth)
                bad, mse = f"BadPix(0.07) {100 * score.bad:.2f} %", f"MSE x100 {score.mse:.3f}"
                common.print_line(f"{name} against {args.truth}: {bad}, {mse} over {score.pixels:,} pixels")
                counts = {"count": score.pixels, "not_finite": score.not_finite, "without_truth": score.without_truth}
                scores: dict[str, Any] = counts | {"bad": score.bad, "mse_x100": _finite(score.mse)}
            else:
                found = compare(Path(name), truth, border=options.scale, layout=layout)
                counted, each = ("views", found.views) if isinstance(found, Measured) else ("pictures", found.pictures)
                _show_score(f"{name} against {args.truth}", found.mean, counted, each)
                scores, found_notes = _describe_scores(found.mean, counted, each), found.notes
            notes += [note for note in found_notes if note not in notes]
        except ValueError as error:
            raise InvalidOption(str(error)) from error
        entries.append({"result": name, "truth": args.truth} | scores)
    common.print_notes(notes)
    _write_scores(PROTOCOL, options.scale, entries, args.json, notes)


def _show_score(what: str, score: Accuracy, counted: str, each: Scores, more: str = "") -> None:
    counted = counted if score.pictures != 1 else counted.removesuffix("s")
    over = f" over {score.pictures} {counted}" if score.pictures > 1 or counted != "view" else ""
    identical = _count_identical(each)
    if 0 < identical < score.pictures:
        over += f"; {identical} {'is' if identical == 1 else 'are'} identical and not in the mean PSNR"
    common.print_line(f"{what}: PSNR {score.psnr:.2f} dB, SSIM {score.ssim:.4f} on Y{over}{more}")


def _describe_fallback(found: Measured) -> str:
    """Returns how much of the views the fallback of a light-field network made; empty for a single-picture model."""
    if found.mean.fallback is None:
        return ""
    share = f"; {FALLBACK} made {100 * found.mean.fallback:.0f} % of the pixels"
    means = "1 view is a mean" if found.averaged == 1 else f"{found.averaged} views are means"
    return f"{share}, and {means} with it" if found.averaged else share


def _describe_scores(score: Accuracy, counted: str, each: Scores) -> dict[str, Any]:
    listed = [
        ({"file": key} if isinstance(key, str) else {"v": key[0], "u": key[1]}) | {"psnr": _finite(psnr), "ssim": ssim}
        for key, (psnr, ssim) in each.items()
    ]
    mean = {"count": score.pictures, "identical": _count_identical(each), "psnr": _finite(score.psnr)}
    return mean | {"ssim": score.ssim, counted: listed}


def _count_identical(each: Scores) -> int:
    return sum(math.isinf(psnr) for psnr, _ in each.values())


def _finite(value: float) -> float | None:
    """Returns `value`, or None for infinity and NaN, which JSON can't represent."""
    return value if math.isfinite(value) else None


def _write_scores(
    protocol: str, scale: int, entries: list[dict[str, Any]], path: str | None, notes: Iterable[str] = ()
) -> None:
    if path is not None:
        with replacing(Path(path)) as file:
            file.write(report_json({"protocol": protocol, "scale": scale, "scores": entries, "notes": list(notes)}))
