"""The registry of models: the networks in `shipped/` and in the folder that `CIIR_MODELS` names, and interpolation.

To add a network, put its `.onnx` file and its `.json` card into one of these folders.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption, UnknownModel, UnsuitedModel, UnsupportedScale
from ciir.model_folder import MODEL_FOLDER, find_model_folder
from ciir.models import cards, processor
from ciir.models.light_field.network import LightFieldNetwork
from ciir.models.single.interpolation import SCALES, Bicubic, Nearest
from ciir.models.single.network import SingleImageNetwork

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ciir.models.upscaler import Upscaler

SHIPPED = Path(__file__).parent / "shipped"
"""The folder of the shipped networks, with an `.onnx` file and a `.json` card for each."""
LIGHT_FIELD_DEFAULT = "field"
"""The default network for views of a light field, as float; see `light_field_default_name`."""
FILES = (".json", ".onnx")
"""The suffixes of a network's files."""
FALLBACK = "quality"
"""The default single-picture network, as float; see `picture_default_name`. It also helps light-field networks: it
replaces pixels of low confidence, and its picture is averaged with theirs (`models.light_field.finishing`)."""
BASELINES: dict[str, Callable[[int], Upscaler]] = {"bicubic": Bicubic, "nearest": Nearest}
"""Interpolation by name: constructors that take a scale."""


@dataclass(frozen=True)
class Entry:
    """A model of the catalogue."""

    name: str
    kind: str
    """A short description."""
    scales: tuple[int, ...]
    """The factors that it upscales by, in ascending order."""
    card: cards.Card | None
    """None for interpolation, which was not trained."""
    path: Path | None = None
    """The card's file."""

    @property
    def is_light_field(self) -> bool:
        """Whether it upscales a view with the help of its neighbouring views, rather than single pictures."""
        return self.card is not None and self.card.is_light_field

    @property
    def unsupported_reason(self) -> str:
        """The reason why it can't run on this machine; empty if it can."""
        return processor.int8_unsupported_reason() if self.card is not None and self.card.precision == "int8" else ""


def list_entries() -> list[Entry]:
    """Lists all models: the shipped networks sorted by name, then the user's own, then interpolation.

    Raises `BadCard` if a card is damaged, and `InvalidOption` if `CIIR_MODELS` is not a folder or contains a network
    with the name of another model.
    """
    baselines = [Entry(name, "interpolation", tuple(SCALES), None) for name in BASELINES]
    shipped = _read_networks(SHIPPED)
    own = find_model_folder()
    return [*shipped, *(() if own is None else _read_own(own, (*shipped, *baselines))), *baselines]


def _read_own(folder: Path, others: Sequence[Entry]) -> tuple[Entry, ...]:
    if not folder.is_dir():
        raise InvalidOption(f"{MODEL_FOLDER}: {folder} is not a folder; name one with .onnx files and .json cards")
    found = _read_networks(folder)
    taken = {entry.name for entry in others}.intersection(entry.name for entry in found)
    if taken:
        raise InvalidOption(
            f"{MODEL_FOLDER}: {min(taken)} is the name of another model; export yours with another --name"
        )
    return found


@cache
def _read_networks(folder: Path) -> tuple[Entry, ...]:
    """Lists the networks in a folder, which is read once per process."""
    found = ((path, cards.read_card(path)) for path in sorted(folder.glob("*.json"), key=lambda path: path.stem))
    return tuple(Entry(card.name, card.kind, (card.scale,), card, path) for path, card in found)


def get_entry(name: str) -> Entry:
    """Returns the model `name`, one of `list_names`."""
    return next(entry for entry in list_entries() if entry.name == name)


def list_names() -> list[str]:
    """Lists the names of all models, in the order of `list_entries`."""
    return [entry.name for entry in list_entries()]


def list_single_image_names() -> list[str]:
    """Lists the names of the models that `load_upscaler` takes, in the order of `list_entries`."""
    return [entry.name for entry in list_entries() if not entry.is_light_field]


def picture_default_name() -> str:
    """Returns the default single-picture model: `FALLBACK` or its int8 twin, see `prefer_int8`."""
    return prefer_int8(FALLBACK)


def light_field_default_name() -> str:
    """Returns the default model for views of a light field: `LIGHT_FIELD_DEFAULT` or its int8 twin."""
    return prefer_int8(LIGHT_FIELD_DEFAULT)


def prefer_int8(name: str) -> str:
    """Returns the int8 twin of the network `name` if there is one and this processor supports it, otherwise `name`."""
    if processor.int8_unsupported_reason():
        return name
    found = [entry.card for entry in list_entries() if entry.card is not None]
    return next((card.name for card in found if card.float_twin == name and card.precision == "int8"), name)


_lock = threading.Lock()
"""The lock held while a model is loaded, so that threads asking for it at the same time share one instance."""


def load_upscaler(name: str, *, scale: int = 2, threads: int | None = None, emulates_int8: bool = False) -> Upscaler:
    """Loads the single-picture model `name`, once for each combination of arguments. Thread-safe.

    `threads`: cores for each call of a network; None means all cores of the process. `emulates_int8`: as for
    `models.sessions.OnnxNetwork`.

    Raises `UnknownModel`, `UnsupportedScale`, `UnsuitedModel` for a light-field network, `UnsuitedProcessor` for an
    int8 network on a processor that computes it wrongly, or `BadCard` if the installation is damaged.
    """
    if name in BASELINES:
        return _make_baseline(name, scale)
    entry = _find_entry(name, scale, is_light_field=False)
    if entry.is_light_field or entry.path is None:
        raise UnsuitedModel(
            f"model {name}: it upscales views of a light field, not single pictures; use `ciir reconstruct`, or name "
            f"{FALLBACK} for single pictures"
        )
    with _lock:
        return _open_single(entry.path.resolve(), threads, emulates_int8)


def load_light_field_network(name: str, *, scale: int = 2, emulates_int8: bool = False) -> LightFieldNetwork:
    """Loads the light-field network `name` once; `models.light_field.views` calls it. Thread-safe.

    Raises the same errors as `load_upscaler`, with `UnsuitedModel` for a single-picture model.
    """
    entry = _find_entry(name, scale, is_light_field=True)
    if not entry.is_light_field or entry.path is None:
        raise UnsuitedModel(f"model {name}: it upscales single pictures, not views with the help of their neighbours")
    with _lock:
        return _open_light_field(entry.path.resolve(), emulates_int8)


@cache
def _make_baseline(name: str, scale: int) -> Upscaler:
    return BASELINES[name](scale)


@cache
def _open_single(path: Path, threads: int | None, emulates_int8: bool) -> Upscaler:
    return SingleImageNetwork(path, threads=threads, emulates_int8=emulates_int8)


@cache
def _open_light_field(path: Path, emulates_int8: bool) -> LightFieldNetwork:
    return LightFieldNetwork(path, emulates_int8=emulates_int8)


def advise_export(name: str) -> str:
    """Returns advice for a user who names the file of a network, or a network that has no card."""
    own, stem = find_model_folder(), name.removesuffix(".onnx").removesuffix(".json")
    there = set() if own is None else {path.name for path in own.iterdir()}
    if f"{stem}.onnx" in there and f"{stem}.json" not in there:
        return f"; {stem}.onnx has no card {stem}.json next to it: write both with `ciir export {stem}.onnx -o DIR`"
    if not name.endswith(FILES) or stem in list_names():
        return ""
    if name.endswith(".json"):  # not looked for, because over HTTP this would reveal which files there are
        card = Path(name)
        return f"; for a network that `ciir export` wrote, set {MODEL_FOLDER}={card.parent} and give {card.stem}"
    return f"; to add your own network, run `ciir export {stem}.onnx -o DIR` with a folder for {MODEL_FOLDER}"


def advise_repeating(model: Entry, scale: int) -> str:
    """Returns advice to upscale several times, if `model` reaches `scale` in that way."""
    again = {4: "again", 8: "twice more"}
    return f" and upscale the result {again[scale]}" if 2 in model.scales and scale in again else ""


def _find_entry(name: str, scale: int, *, is_light_field: bool) -> Entry:
    """Returns the model `name`, of either kind. Raises `UnknownModel`, which lists the wanted kind's models, or
    `UnsupportedScale`.
    """
    entries = {entry.name: entry for entry in list_entries()}
    if name not in entries:
        known = [entry.name for entry in entries.values() if entry.is_light_field == is_light_field]
        raise UnknownModel(f"model: no {name!r} here; give one of {', '.join(known)}{advise_export(name)}")
    if scale not in entries[name].scales:
        scales = ", ".join(map(str, entries[name].scales))
        remedy = f"give that{advise_repeating(entries[name], scale)}, or model bicubic" if scale > 1 else "give that"
        raise UnsupportedScale(f"scale: {name} upscales by {scales}, not {scale}; {remedy}")
    return entries[name]
