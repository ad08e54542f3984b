"""A network's card: what it is, what it was made from, what it costs and how accurate it is. One `.json` file."""

from __future__ import annotations

import dataclasses
import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ciir.errors import BadCard

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class Tensor:
    """An input or output of the network."""

    name: str
    shape: tuple[str | int, ...]
    """A number where the size is fixed, a name or formula where it isn't."""
    dtype: str
    low: float
    high: float
    """The range of its values; an output may leave it by a little and is clipped."""


@dataclass(frozen=True)
class Training:
    """How the weights were made."""

    recipe: dict[str, Any]
    """Every field of `training.recipe.Recipe`, data included."""
    commit: str
    """The commit whose code trained it; `+` at its end: with changes that were not committed."""
    iterations: int
    seed: int


@dataclass(frozen=True)
class Accuracy:
    """Mean scores over one test set."""

    data: str
    """The set's name."""
    pictures: int
    psnr: float
    """dB on Y."""
    ssim: float
    """Structural similarity on Y, at most 1."""


@dataclass(frozen=True)
class Sizes:
    """The pictures that a network takes; `models.sessions` repeats the edge pixels of others until they fit."""

    minimum: int = 8
    """Shortest side, pixels. Ours met no picture in training that was mostly zero padding: white of 1x1 came out as
    dark grey. From 5 pixels on a flat picture is as flat as a large one."""
    multiple_of: int = 1
    """What both sides are multiples of."""
    square: bool = False
    """Whether both sides are the same."""

    def fitted(self, height: int, width: int) -> tuple[int, int]:
        """The least height and width, not below those given, that the network takes."""
        step = self.multiple_of
        rows, cols = (-(-max(side, self.minimum) // step) * step for side in (height, width))
        return (max(rows, cols), max(rows, cols)) if self.square else (rows, cols)


PRECISIONS = ("float32", "int8")


@dataclass(frozen=True)
class Card:
    """All that is known of a shipped network; the `.onnx` of the same stem lies beside it."""

    name: str
    kind: str
    """The design, in words."""
    scale: int
    sha256: str
    """Of the `.onnx`, 64 hexadecimal digits."""
    opset: int
    input: Tensor
    output: Tensor
    radius: int
    """Receptive field radius: how many input pixels away an input pixel can still change an output pixel.

    Of a network whose field is wider than tiles can be: how far they overlap to differ from the whole by less than half
    a level of 8 bits."""
    parameters: int
    """Numbers that were learnt; constants, such as the kernel of an interpolated base, are none."""
    macs_per_output_pixel: float
    """Multiply-adds of all layers, an interpolated base's too, for each output pixel (three channels together)."""
    training: Training
    protocol: str
    """How `accuracy` was measured, in words."""
    command: str
    """The command that printed `accuracy`."""
    accuracy: tuple[Accuracy, ...]
    precision: str = "float32"
    """What the convolutions compute in, one of `PRECISIONS`; `models.processor` says where int8 is of use."""
    float_twin: str = ""
    """Of an int8 network: the name of the float one that it was made from."""
    sizes: Sizes = Sizes()
    further: tuple[Tensor, ...] = ()
    """Inputs beside `input`: of a light-field network, the window of views around the one that is upscaled."""
    further_outputs: tuple[Tensor, ...] = ()
    """Outputs after `output`: of a light-field network, how little those views have to do with that one."""

    @property
    def is_light_field(self) -> bool:
        """Whether it upscales a view with the help of those around it: see `models.light_field.network`."""
        return bool(self.further)

    def to_dict(self) -> dict[str, Any]:
        """The card as JSON values, which `read_card` reads back."""
        return dataclasses.asdict(self)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[0-9a-f]{64}", self.sha256):
            raise BadCard(f"card {self.name}: sha256 is {self.sha256!r}; 64 hexadecimal digits are needed")
        for key in ("scale", "opset", "parameters"):
            if getattr(self, key) < 1:
                raise BadCard(f"card {self.name}: {key} is {getattr(self, key)}; at least 1 is needed")
        if self.precision not in PRECISIONS:
            raise BadCard(f"card {self.name}: precision is {self.precision!r}; give one of {', '.join(PRECISIONS)}")
        if min(self.sizes.minimum, self.sizes.multiple_of) < 1:
            raise BadCard(f"card {self.name}: sizes are {self.sizes}; at least 1 is needed")
        if self.radius < 0:
            raise BadCard(f"card {self.name}: radius is {self.radius}; at least 0 is needed")


_PLAIN: dict[str, tuple[type, ...]] = {
    "str": (str,),
    "int": (int,),
    "bool": (bool,),
    "float": (int, float),
    "dict[str, Any]": (dict,),
    "tuple[str | int, ...]": (list,),
}
_NESTED: dict[str, type] = {"Tensor": Tensor, "Training": Training, "Accuracy": Accuracy, "Sizes": Sizes}

_LISTS: dict[str, type] = {"tuple[Accuracy, ...]": Accuracy, "tuple[Tensor, ...]": Tensor}


def _build(kind: type, table: object, where: str) -> Any:
    """An instance of the dataclass `kind` from parsed JSON, every key and type checked."""
    if not isinstance(table, dict):
        raise BadCard(f"{where}: a table is needed, not {table!r}")
    known = {field.name: str(field.type) for field in dataclasses.fields(kind)}
    needed = {field.name for field in dataclasses.fields(kind) if field.default is dataclasses.MISSING}
    odd = sorted((needed - table.keys()) | (table.keys() - known.keys()))
    if odd:
        state = "missing" if odd[0] in known else "unknown"
        raise BadCard(f"{where}: key {odd[0]!r} is {state}; write the card with `ciir export`")
    values: dict[str, Any] = {}
    for key, value in table.items():
        annotation, place = known[key], f"{where}: {key}"
        if annotation in _NESTED:
            values[key] = _build(_NESTED[annotation], value, place)
        elif annotation in _LISTS and isinstance(value, list):
            values[key] = tuple(_build(_LISTS[annotation], item, place) for item in value)
        elif isinstance(value, _PLAIN.get(annotation, ())) and isinstance(value, bool) == (annotation == "bool"):
            values[key] = tuple(value) if isinstance(value, list) else value
        else:
            raise BadCard(f"{place} is {value!r}; {annotation} is needed")
    return kind(**values)


def read_card(path: Path) -> Card:
    """The card in `path`. Raises `BadCard` naming the first key that is missing, unknown or of another type."""
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadCard(f"{path}: can't be read ({error.strerror}); give the .json that `ciir export` wrote") from error
    except ValueError as error:
        raise BadCard(f"{path}: can't be read as JSON ({error}); write the card with `ciir export`") from error
    card = _build(Card, table, str(path))
    assert isinstance(card, Card)  # noqa: S101 - tells the type checker what `_build` was asked for
    if card.name != path.stem:
        raise BadCard(f"{path}: names its network {card.name!r}; name the files after the network")
    return card


def write_card(card: Card, path: Path) -> None:
    """Writes `card` as JSON that `read_card` takes back."""
    path.write_text(json.dumps(card.to_dict(), indent=2) + "\n", encoding="utf-8")
