"""The registry of models: the networks in `shipped/` and in the folder of `CIIR_MODELS`, and interpolation.

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
"""The folder of networks, an `.onnx` and a `.json` card for each."""
DEFAULT = "fast"
"""The default network for single pictures, in float; see `default_name`."""
LIGHT_FIELD_DEFAULT = "field"
"""The default network for views of a light field, in float; see `light_field_default_name`."""
FILES = (".json", ".onnx")
"""Suffixes of a network's files."""
FALLBACK = "quality"
"""The network of single pictures, in float, that helps light-field networks: with the pixels of low confidence, and in
means (`models.light_field.finishing`)."""
BASELINES: dict[str, Callable[[int], Upscaler]] = {"bicubic": Bicubic, "nearest": Nearest}
"""Interpolation by name: constructors from a scale."""


@dataclass(frozen=True)
class Entry:
    """A model of the catalogue."""

    name: str
    kind: str
    """A short description."""
    scales: tuple[int, ...]
    """The factors it upscales by, ascending."""
    card: cards.Card | None
    """None for interpolation, which was not trained."""
    path: Path | None = None
    """The card's."""

    @property
    def is_light_field(self) -> bool:
        """Whether it upscales a view with the help of the views around it, rather than single pictures."""
        return self.card is not None and self.card.is_light_field

    @property
    def unsupported_reason(self) -> str:
        """Why it can't run on this machine; empty where it can."""
        return processor.int8_unsupported_reason() if self.card is not None and self.card.precision == "int8" else ""


def list_entries() -> list[Entry]:
    """All models: the shipped networks sorted by name, one's own, then interpolation. Raises `BadCard` where a card is
    damaged, `InvalidOption` where `CIIR_MODELS` names no folder or one with a network named as another model.
    """
    baselines = [Entry(name, "interpolation", tuple(SCALES), None) for name in BASELINES]
    shipped = _read_networks(SHIPPED)
    own = find_model_folder()
    return [*shipped, *(() if own is None else _read_own(own, (*shipped, *baselines))), *baselines]


def _read_own(folder: Path, others: Sequence[Entry]) -> tuple[Entry, ...]:
    if not folder.is_dir():
        raise InvalidOption(f"{MODEL_FOLDER}: {folder} is no folder; name one with .onnx files and their .json cards")
    found = _read_networks(folder)
    taken = {entry.name for entry in others}.intersection(entry.name for entry in found)
    if taken:
        raise InvalidOption(
            f"{MODEL_FOLDER}: {min(taken)} is the name of another model; export yours with another --name"
        )
    return found


@cache
def _read_networks(folder: Path) -> tuple[Entry, ...]:
    """The networks in a folder, which is read once per process."""
    found = ((path, cards.read_card(path)) for path in sorted(folder.glob("*.json"), key=lambda path: path.stem))
    return tuple(Entry(card.name, card.kind, (card.scale,), card, path) for path, card in found)


def get_entry(name: str) -> Entry:
    """The model `name`, one of `list_names`."""
    return next(entry for entry in list_entries() if entry.name == name)


def list_names() -> list[str]:
    """The names of all models, in the order of `list_entries`."""
    return [entry.name for entry in list_entries()]


def list_single_image_names() -> list[str]:
    """The names of the models that `load_upscaler` takes, in the order of `list_entries`."""
    return [entry.name for entry in list_entries() if not entry.is_light_field]


def default_name() -> str:
    """The model for single pictures where none is named: `DEFAULT` or its int8 twin, see `prefer_int8`."""
    return prefer_int8(DEFAULT)


def light_field_default_name() -> str:
    """The model for views of a light field where none is named: `LIGHT_FIELD_DEFAULT` or its int8 twin."""
    return prefer_int8(LIGHT_FIELD_DEFAULT)


def prefer_int8(name: str) -> str:
    """The int8 twin of the network `name`, where one is shipped and this processor supports it; else `name`."""
    if processor.int8_unsupported_reason():
        return name
    found = [entry.card for entry in list_entries() if entry.card is not None]
    return next((card.name for card in found if card.float_twin == name and card.precision == "int8"), name)


_lock = threading.Lock()
"""Held while a model is loaded, so that threads which ask at once share one."""


def load_upscaler(name: str, *, scale: int = 2, threads: int | None = None, emulates_int8: bool = False) -> Upscaler:
    """The single-image model `name`, loaded once for each combination of arguments. Thread-safe.

    `threads`: cores for each call of a network; None: all cores of the process. `emulates_int8`: as of
    `models.sessions.OnnxNetwork`.

    Raises `UnknownModel`, `UnsupportedScale`, `UnsuitedModel` for a light-field network, `UnsuitedProcessor` for an
    int8 network on a processor that computes it wrongly, or `BadCard` where the installation is damaged.
    """
    with _lock:
        return _load_upscaler(name, scale, threads, emulates_int8)


def load_light_field_network(name: str, *, scale: int = 2, emulates_int8: bool = False) -> LightFieldNetwork:
    """The light-field network `name`, loaded once; `models.light_field.views` calls it. Thread-safe.

    Raises as `load_upscaler`, and `UnsuitedModel` for a single-image model.
    """
    with _lock:
        return _load_light_field_network(name, scale, emulates_int8)


@cache
def _load_upscaler(name: str, scale: int, threads: int | None, emulates_int8: bool) -> Upscaler:
    if name in BASELINES:
        return BASELINES[name](scale)
    entry = _find_entry(name, scale, is_light_field=False)
    if entry.is_light_field or entry.path is None:
        raise UnsuitedModel(
            f"model {name}: it upscales a view of a light field with those around it; use `ciir reconstruct`, or name "
            f"{DEFAULT} for single pictures"
        )
    return SingleImageNetwork(entry.path, threads=threads, emulates_int8=emulates_int8)


@cache
def _load_light_field_network(name: str, scale: int, emulates_int8: bool) -> LightFieldNetwork:
    entry = _find_entry(name, scale, is_light_field=True)
    if not entry.is_light_field or entry.path is None:
        raise UnsuitedModel(f"model {name}: it upscales single pictures, not a view with those around it")
    return LightFieldNetwork(entry.path, emulates_int8=emulates_int8)


def advise_export(name: str) -> str:
    """How a network of one's own gets a name, for who gives a file or the name of one without its card."""
    own, stem = find_model_folder(), name.removesuffix(".onnx").removesuffix(".json")
    there = set() if own is None else {path.name for path in own.iterdir()}
    if f"{stem}.onnx" in there and f"{stem}.json" not in there:
        return f"; {stem}.onnx has no card {stem}.json beside it: write both with `ciir export {stem}.onnx -o DIR`"
    if not name.endswith(FILES) or stem in list_names():
        return ""
    return f"; of a network of your own `ciir export {stem}.onnx -o DIR` makes one in a folder for {MODEL_FOLDER}"


def _find_entry(name: str, scale: int, *, is_light_field: bool) -> Entry:
    """The model `name`, of either kind. Raises `UnknownModel`, which lists those of the kind, or `UnsupportedScale`."""
    entries = {entry.name: entry for entry in list_entries()}
    if name not in entries:
        known = [entry.name for entry in entries.values() if entry.is_light_field == is_light_field]
        raise UnknownModel(f"model: no {name!r} here; give one of {', '.join(known)}{advise_export(name)}")
    if scale not in entries[name].scales:
        scales = ", ".join(map(str, entries[name].scales))
        remedy = "give that, or model bicubic" if scale > 1 else "give that"
        raise UnsupportedScale(f"scale: {name} upscales by {scales}, not {scale}; {remedy}")
    return entries[name]
