"""Cards of networks: one `.json` file for each network, with its design, training, cost and accuracy."""

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
    """An input or output of a network."""

    name: str
    shape: tuple[str | int, ...]
    """A number for each fixed size, a name or formula for each free one."""
    dtype: str
    low: float
    high: float
    """`low` and `high` are the range of its values. Outputs may exceed it slightly and are clipped."""


@dataclass(frozen=True)
class Training:
    """How the weights were trained."""

    recipe: dict[str, Any]
    """Every field of `training.recipe.Recipe`, data included."""
    commit: str
    """The commit whose code trained it; it ends in `+` if there were uncommitted changes."""
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
    fallback: float | None = None
    """The share of pixels that come mostly from the single-picture fallback of a light-field network; None for a
    single-picture model, and on cards from before this was measured."""


@dataclass(frozen=True)
class Sizes:
    """The sizes of pictures that a network takes; others are padded with their edge pixels until they fit."""

    minimum: int = 8
    """Shortest side, pixels. Smaller pictures would be mostly zero padding, which did not occur in training: a white
    1x1 picture came out dark grey. A flat picture with sides of at least 5 pixels comes out flat."""
    multiple_of: int = 1
    """Both sides are multiples of this."""
    square: bool = False
    """Whether both sides must be equal."""

    def round_up(self, height: int, width: int) -> tuple[int, int]:
        """Returns the smallest height and width that the network takes and that are not below those given."""
        step = self.multiple_of
        rows, cols = (-(-max(side, self.minimum) // step) * step for side in (height, width))
        return (max(rows, cols), max(rows, cols)) if self.square else (rows, cols)


PRECISIONS = ("float32", "int8")
FILTERS = "down"
"""The name of the light-field input with an entry for each plane; see `models.light_field.planes.Window`."""


@dataclass(frozen=True)
class Card:
    """The description of a network. Its `.json` and the `.onnx` have the same stem and lie in the same folder."""

    name: str
    kind: str
    """A short description of the design."""
    scale: int
    sha256: str
    """The hash of the `.onnx` file, 64 hexadecimal digits."""
    opset: int
    input: Tensor
    output: Tensor
    radius: int
    """Receptive field radius: the largest distance in input pixels at which an input pixel can change an output pixel.

    If the receptive field is wider than a tile, this is the overlap at which tiles differ from the whole picture by
    less than half an 8-bit level."""
    parameters: int
    """Number of learnt values. Constants, such as the kernel of an interpolated base, do not count."""
    macs_per_output_pixel: float
    """Multiply-adds of all layers, including an interpolated base, for each output pixel (three channels together), of
    all `runs`."""
    training: Training
    protocol: str
    """How `accuracy` was measured."""
    command: str
    """The command that printed `accuracy`."""
    accuracy: tuple[Accuracy, ...]
    precision: str = "float32"
    """The type that convolutions compute in, one of `PRECISIONS`; see `models.processor` for int8."""
    float_twin: str = ""
    """For an int8 network, the name of the float network that it was made from."""
    runs: int = 1
    """For a light-field network, 1 or 2: how many runs its result is the mean of (`models.light_field.network`)."""
    sizes: Sizes = Sizes()
    extra_inputs: tuple[Tensor, ...] = ()
    """Inputs besides `input`, such as a light-field network's window of views around the upscaled one."""
    extra_outputs: tuple[Tensor, ...] = ()
    """Outputs besides `output`, such as the uncertainty of a light-field network."""

    @property
    def is_light_field(self) -> bool:
        """Whether it upscales a view with the help of its neighbouring views; see `models.light_field.network`."""
        return bool(self.extra_inputs)

    @property
    def planes(self) -> int:
        """The number of disparities that a light-field network tries; 0 for other networks."""
        return next((int(tensor.shape[0]) for tensor in self.extra_inputs if tensor.name == FILTERS), 0)

    def to_dict(self) -> dict[str, Any]:
        """Returns the card as JSON values."""
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
        if self.runs not in ((1, 2) if self.is_light_field else (1,)):
            raise BadCard(f"card {self.name}: runs is {self.runs}; give 1, or 2 for a light-field network")
        if self.is_light_field:
            self._check_light_field()
        if self.radius < 0:
            raise BadCard(f"card {self.name}: radius is {self.radius}; at least 0 is needed")

    def _check_light_field(self) -> None:
        """Raises `BadCard` if the inputs differ from those of `models.light_field.network`."""
        found = {tensor.name: tensor.shape[:1] for tensor in self.extra_inputs}
        planes = next(iter(found.get(FILTERS, ())), None)
        if set(found) != {"around", "down", "across", "window"} or not isinstance(planes, int) or planes < 2:
            raise BadCard(
                f"card {self.name}: inputs {', '.join(found)}, with {FILTERS} for {planes} planes; a light-field "
                "network has around, down, across and window, for at least 2 planes: export it again with `ciir export`"
            )


_JSON_TYPES: dict[str, tuple[type, ...]] = {
    "str": (str,),
    "int": (int,),
    "bool": (bool,),
    "float": (int, float),
    "float | None": (int, float, type(None)),
    "dict[str, Any]": (dict,),
    "tuple[str | int, ...]": (list,),
}
_RECORDS: dict[str, type] = {"Tensor": Tensor, "Training": Training, "Accuracy": Accuracy, "Sizes": Sizes}
_LISTS: dict[str, type] = {"tuple[Accuracy, ...]": Accuracy, "tuple[Tensor, ...]": Tensor}


def _build_record(kind: type, table: object, place: str) -> Any:
    """Builds an instance of the dataclass `kind` from parsed JSON and checks every key and type."""
    if not isinstance(table, dict):
        raise BadCard(f"{place}: a table is needed, not {table!r}")
    annotations = {field.name: str(field.type) for field in dataclasses.fields(kind)}
    required = {field.name for field in dataclasses.fields(kind) if field.default is dataclasses.MISSING}
    wrong = sorted((required - table.keys()) | (table.keys() - annotations.keys()))
    if wrong:
        state = "missing" if wrong[0] in annotations else "unknown"
        raise BadCard(f"{place}: key {wrong[0]!r} is {state}; write the card with `ciir export`")
    values: dict[str, Any] = {}
    for key, value in table.items():
        annotation, inner = annotations[key], f"{place}: {key}"
        if annotation in _RECORDS:
            values[key] = _build_record(_RECORDS[annotation], value, inner)
        elif annotation in _LISTS and isinstance(value, list):
            values[key] = tuple(_build_record(_LISTS[annotation], item, inner) for item in value)
        elif isinstance(value, _JSON_TYPES.get(annotation, ())) and isinstance(value, bool) == (annotation == "bool"):
            values[key] = tuple(value) if isinstance(value, list) else value
        else:
            raise BadCard(f"{inner} is {value!r}; {annotation} is needed")
    return kind(**values)


def read_card(path: Path) -> Card:
    """Reads the card in `path`. Raises `BadCard`, with the first key that is missing, unknown or of another type."""
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadCard(f"{path}: can't be read ({error.strerror}); give the .json that `ciir export` wrote") from error
    except ValueError as error:
        raise BadCard(f"{path}: can't be read as JSON ({error}); write the card with `ciir export`") from error
    card = _build_record(Card, table, str(path))
    assert isinstance(card, Card)  # noqa: S101 - for the type checker
    if card.name != path.stem:
        raise BadCard(f"{path}: names its network {card.name!r}; name the files after the network")
    return card


def write_card(card: Card, path: Path) -> None:
    """Writes `card` as JSON."""
    path.write_text(json.dumps(card.to_dict(), indent=2) + "\n", encoding="utf-8")
