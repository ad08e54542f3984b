"""The models that ship with the project, by name."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import UnknownModel, UnsuitedModel, UnsupportedScale
from ciir.models import cards, processor
from ciir.models.single.interpolation import SCALES, Bicubic, Nearest

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.models.light_field.network import LightFieldNetwork
    from ciir.models.upscaler import Upscaler

SHIPPED = Path(__file__).parent / "shipped"
"""Holds an `.onnx` and a `.json` card for each network."""
DEFAULT = "fast"
"""The float network for single pictures where none is named; `default_name` says what takes its place."""
LIGHT_FIELD_DEFAULT = "field"
"""The one for views of a light field where none is named; `light_field_default_name` says what takes its place."""
BASELINES: dict[str, Callable[[int], Upscaler]] = {"bicubic": Bicubic, "nearest": Nearest}
"""Name -> constructor from a scale."""


@dataclass(frozen=True)
class Entry:
    """One line of the catalogue."""

    name: str
    kind: str
    """What it is, in words."""
    scales: tuple[int, ...]
    """The factors it upscales by, ascending."""
    card: cards.Card | None
    """None for interpolation, which was not trained."""

    @property
    def is_light_field(self) -> bool:
        """Whether it upscales a view with the help of those around it, and so not a single picture."""
        return self.card is not None and self.card.is_light_field

    @property
    def unsupported_reason(self) -> str:
        """Why it can't run on this machine, in words; empty where it can."""
        return processor.int8_unsupported_reason() if self.card is not None and self.card.precision == "int8" else ""


def list_entries() -> list[Entry]:
    """All models: the networks by name, then the baselines. Raises `BadCard` where a shipped card is damaged."""
    return [*_networks(SHIPPED), *(Entry(name, "interpolation", tuple(SCALES), None) for name in BASELINES)]


@cache
def _networks(folder: Path) -> tuple[Entry, ...]:
    """Those whose cards are in a folder, which is looked at once: they don't change while we run."""
    read = (cards.read_card(path) for path in sorted(folder.glob("*.json"), key=lambda path: path.stem))
    return tuple(Entry(card.name, card.kind, (card.scale,), card) for card in read)


def list_names() -> list[str]:
    """The names of `list_entries`, in their order."""
    return [entry.name for entry in list_entries()]


def list_single_image_names() -> list[str]:
    """The names that `load_upscaler` takes, in the order of `list_entries`."""
    return [entry.name for entry in list_entries() if not entry.is_light_field]


def default_name() -> str:
    """The model that is used for single pictures where none is named: `prefer_int8` of `DEFAULT`."""
    return prefer_int8(DEFAULT)


def light_field_default_name() -> str:
    """The one that is used for views of a light field where none is named: `prefer_int8` of `LIGHT_FIELD_DEFAULT`."""
    return prefer_int8(LIGHT_FIELD_DEFAULT)


def prefer_int8(name: str) -> str:
    """The int8 twin of the network `name` where one is shipped and this processor is made for it, else `name`."""
    if processor.int8_unsupported_reason():
        return name
    cards_of_all = [entry.card for entry in list_entries() if entry.card is not None]
    return next((card.name for card in cards_of_all if card.float_twin == name and card.precision == "int8"), name)


_loaded: dict[tuple[str, int, int | None], Upscaler] = {}
_fields: dict[tuple[str, int | None], LightFieldNetwork] = {}
_lock = threading.Lock()


def load_upscaler(name: str, *, scale: int = 2, threads: int | None = None) -> Upscaler:
    """The model `name`, made once for each combination of arguments; may be called from several threads.

    `threads`: cores for each call of a network, all of the process's where None.

    Raises `UnknownModel`, `UnsupportedScale`, `UnsuitedModel` for a light-field network, `UnsuitedProcessor` for an
    int8 network on a processor that gets those wrong, or `BadCard` where the installation is damaged.
    """
    key = (name, scale, threads)
    with _lock:
        if key not in _loaded:
            _loaded[key] = _make(name, scale, threads)
        return _loaded[key]


def load_light_field_network(
    name: str = LIGHT_FIELD_DEFAULT, *, scale: int = 2, threads: int | None = None
) -> LightFieldNetwork:
    """The light-field network `name`, made once; may be called from several threads. See `models.light_field.views`.

    Raises as `load_upscaler`, and `UnsuitedModel` where the model takes single pictures.
    """
    with _lock:
        entry = _entry(name, scale)
        if (name, threads) not in _fields:
            if not entry.is_light_field:
                raise UnsuitedModel(f"model {name}: it upscales single pictures, not a view with those around it")
            from ciir.models.light_field.network import LightFieldNetwork

            _fields[name, threads] = LightFieldNetwork(SHIPPED / f"{name}.json", threads=threads)
        return _fields[name, threads]


def _entry(name: str, scale: int) -> Entry:
    """Raises `UnknownModel` or `UnsupportedScale`."""
    known = {entry.name: entry for entry in list_entries()}
    if name not in known:
        raise UnknownModel(f"model: no {name!r} here; give one of {', '.join(known)}")
    if scale not in known[name].scales:
        scales = ", ".join(map(str, known[name].scales))
        raise UnsupportedScale(f"scale: {name} upscales by {scales}, not {scale}; give that, or model bicubic")
    return known[name]


def _make(name: str, scale: int, threads: int | None) -> Upscaler:
    if name in BASELINES:
        return BASELINES[name](scale)
    if _entry(name, scale).is_light_field:
        raise UnsuitedModel(
            f"model {name}: it upscales a view of a light field with those around it; use `ciir reconstruct`, or name "
            f"{DEFAULT} for single pictures"
        )
    from ciir.models.single.network import (
        SingleImageNetwork,  # not before a network is asked for: `ciir models` needs none
    )

    return SingleImageNetwork(SHIPPED / f"{name}.json", threads=threads)
