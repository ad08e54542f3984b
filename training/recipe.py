"""Recipes: training runs as TOML files."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from dataclasses import MISSING, asdict, dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, get_origin, get_type_hints

from ciir.models import catalogue

if TYPE_CHECKING:
    from collections.abc import Mapping

DEVICES = ("auto", "cpu", "cuda")
CHANGEABLE = frozenset({"validate", "validate_every", "device", "initial", "vgg", "runs"})
"""Fields that may change when a run is resumed, because none of them changes what is learnt."""


OVERRIDES = ("name", "train", "validate", "initial", "vgg", "steps", "device")
"""Fields that are also options of `ciir train`."""
FOLDERS, FILES = frozenset({"train", "validate", "labelled"}), frozenset({"initial", "vgg", "meshes", "averaged"})
"""Fields that hold the paths of folders and of files. `averaged` is added by `training.export.average`."""


TYPE_NAMES = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a string",
    dict: "a table",
    list: "a list",
}
"""The names of TOML types in messages."""


@dataclass(frozen=True)
class Recipe:
    """The settings of a training run; fields without a default are required.

    Paths are relative to the current folder. Raises `ValueError` for a number out of range.
    """

    name: str
    """The network's name in the catalogue, and the stem of its files."""
    network: str
    """A key of `training.networks.NETWORKS`."""
    train: str
    """Folder of training pictures, or of the unpacked VOC2012."""
    validate: str
    """Folder of `*_HR.png` and `*_LR.png` pairs, or of pictures, whose LR is then bicubic."""
    steps: int
    """Number of optimiser steps."""
    minutes: float = 0.0
    """If above 0, the run ends after this time unless it reaches `steps` earlier. The step size then falls with the
    clock, which suits a machine that is lent for a limited time. Such a run can't be repeated bit for bit."""
    options: dict[str, Any] = field(default_factory=dict)
    """Keyword arguments of the network's constructor."""
    initial: str = ""
    """Checkpoint, or ONNX file of a float network, whose weights the run starts from; empty for random weights."""

    degradations: dict[str, Any] = field(default_factory=lambda: {"bicubic": 1.0})
    """Each degradation and its share of the crops; see `training.data.crops`."""
    scenes: int = 0
    """Number of random scenes that are rendered as training pairs (see `training.data.rendered`)."""
    meshes: list[Any] = field(default_factory=list)
    """Mesh files whose views are training pairs too."""
    labelled: str = ""
    """Folder of pairs that a stronger network labelled (`training.data.labels`), for the degradation `labelled`."""
    corrupted: float = 1.0
    """Share of the crops that `noise`, `blur` and `jpeg` act on."""
    noise: float = 0.0
    """Largest standard deviation of Gaussian noise on LR, in 8-bit levels. Each crop draws its own up to this."""
    blur: float = 0.0
    """Largest standard deviation of a Gaussian blur of LR, in LR pixels. Each crop draws its own up to this."""
    jpeg: int = 0
    """Lowest JPEG quality (1 to 100) of an LR crop. Each crop draws its own quality from this up; 0 for no JPEG."""
    light_field: bool = False
    """Whether the network takes the neighbouring views too. Then `train` holds the textures of layered scenes
    (`training.data.light_field.crops`), `validate` holds the views of a light field, `scenes` consist of solids only,
    and `noise`, `blur`, `jpeg`, `corrupted` and `labelled` are ignored."""
    eased: int = 0
    """Number of steps over which changed crops and windows of small grids rise to their shares, for a light-field
    network; see `training.data.light_field.crops`."""
    runs: int = 1
    """For a light-field network, 1 or 2: how many runs the exported network's result is the mean of
    (`ciir.models.light_field.network`). It doesn't change training."""
    scale: int = 2
    crop: int = 88
    """HR crop side, pixels."""
    batch: int = 16

    loss: str = "l1"
    """Pixel loss: `l1`, `mse`, `luma` or `squared-luma` (see `training.losses.pixel`)."""
    perceptual: str = ""
    """Perceptual term: `vgg19`, `discriminator`, or empty for none (see `training.losses.perceptual`)."""
    perceptual_weight: float = 1.0
    vgg: str = ""
    """torchvision's VGG-19 weight file, for `perceptual = "vgg19"`."""
    adversarial: str = ""
    """Adversarial term: `bce` (with logits), `hinge`, or empty for none (see `training.losses.adversarial`)."""
    adversarial_weight: float = 1e-3
    discriminator: dict[str, Any] = field(default_factory=dict)
    """Keyword arguments of `training.networks.discriminator.Discriminator`, whose defaults are SRGAN's."""

    learning_rate: float = 1e-4
    """Adam's peak step size, for the discriminator too. It falls to zero along a half cosine."""
    warmup: int = 0
    """Steps over which the step size rises linearly from zero."""
    clip: float = 0.0
    """Largest gradient norm; 0 leaves gradients unchanged."""
    ema: float = 0.0
    """Decay of the running mean of the weights, which is validated and exported; 0 for the weights themselves."""
    device: str = "auto"
    """`cpu`, `cuda`, or `auto`, which is CUDA if there is a GPU."""
    bfloat16: bool = False
    """Whether the forward and backward pass run in bfloat16, with float32 weights (several times faster on CPUs with
    AMX)."""
    seed: int = 0
    validate_every: int = 500
    """Number of steps between checkpoints, each with a validation."""

    def __post_init__(self) -> None:
        check_name(self.name)
        for name in ("steps", "scale", "crop", "batch", "validate_every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; give 1 or more")
        for name in (
            "minutes",
            "scenes",
            "eased",
            "noise",
            "blur",
            "warmup",
            "clip",
            "perceptual_weight",
            "adversarial_weight",
            "seed",
        ):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)}; give a finite number of 0 or more")
        if not 0 < self.learning_rate < math.inf:
            raise ValueError(f"learning_rate is {self.learning_rate}; give a finite number over 0")
        if not 0 <= self.ema < 1:
            raise ValueError(f"ema is {self.ema}; give 0 or more and less than 1")
        if not 0 <= self.corrupted <= 1:
            raise ValueError(f"corrupted is {self.corrupted}; give a share of 0 to 1")
        if not 0 <= self.jpeg <= 100:
            raise ValueError(f"jpeg is {self.jpeg}; give a quality of 1 to 100, or 0 for none")
        if self.runs not in ((1, 2) if self.light_field else (1,)):
            raise ValueError(f"runs is {self.runs}; give 1, or 2 for a light-field network")
        if self.device not in DEVICES:
            raise ValueError(f"device is {self.device!r}; give one of {', '.join(DEVICES)}")


def read_recipe(path: Path, given: Mapping[str, Any] = MappingProxyType({})) -> Recipe:
    """Reads the recipe in `path`. `given`: fields that replace those of the file.

    Raises `ValueError` if it is not TOML, or if a key is wrong or missing, or a value is wrong.
    """
    try:
        table: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ValueError(f"{path}: no such file; give a recipe, as in training/recipes") from error
    except ValueError as error:
        raise ValueError(f"{path}: not TOML: {error}") from error
    known = {f.name for f in fields(Recipe)}
    unknown = sorted(set(table) - known)
    if unknown:
        near = difflib.get_close_matches(unknown[0], known, 1) or sorted(known)
        raise ValueError(f"{path}: unknown key {unknown[0]!r}; give {', '.join(near)}, or remove it")
    table |= given
    missing = [f.name for f in fields(Recipe) if f.default is f.default_factory and f.name not in table]
    if missing:
        option = f", or give --{missing[0]}" if missing[0] in OVERRIDES else ""
        raise ValueError(f"{path}: {missing[0]} is missing; add it to the recipe{option}")
    for name, kind in get_type_hints(Recipe).items():
        wanted = get_origin(kind) or kind
        value = table.get(name, wanted())
        # bool is an int in Python, but not in TOML; an int is accepted as a float.
        if not isinstance(value, (float, int) if wanted is float else wanted) or (
            isinstance(value, bool) and wanted is not bool
        ):
            raise ValueError(f"{path}: {name} is {value!r}; give {TYPE_NAMES[wanted]}")
    try:
        return Recipe(**table)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def check_name(name: str) -> None:
    """Raises `ValueError` if `name` is not a valid file name."""
    if not re.fullmatch(r"[\w.+-]+", name):
        raise ValueError(f"name: {name!r}: give one of letters, digits, '.', '_', '+' and '-'")


def choose_name(given: str, own: str) -> str:
    """Returns the name of an exported network: `given`, or if that is empty `own`, from its recipe or file.

    Raises `ValueError` for one that is not a valid file name, and if `own` is the name of another model, because a
    folder with both can't be used; `given` may be one to replace it.
    """
    check_name(given or own)
    if not given and (own in catalogue.BASELINES or (catalogue.SHIPPED / f"{own}.json").is_file()):
        raise ValueError(
            f"name: {own!r} is the name of a model that ships; give one of your own, as in --name my-{own}"
        )
    return given or own


def shorten_paths(recipe: Mapping[str, Any]) -> dict[str, Any]:
    """Shortens the paths of a recipe for its card, which is published: folders to their names, and files to their names
    and that of their folder.
    """
    shown = dict(recipe)
    for key in FOLDERS & recipe.keys():
        shown[key] = Path(recipe[key]).name
    for key in FILES & recipe.keys():
        value = recipe[key]
        shown[key] = [_shorten_file(path) for path in value] if isinstance(value, list) else _shorten_file(value)
    return shown


def _shorten_file(path: str) -> str:
    return "/".join(part for part in Path(path).parts[-2:] if part != "/")


def find_difference(saved: Mapping[str, Any], recipe: Recipe) -> str:
    """Describes the first field in which a checkpoint's recipe differs, for example `steps is 5 there and 9 here`.

    The result is empty if the run can continue. `CHANGEABLE` fields may differ, and a field that an older checkpoint
    lacks has its default.
    """
    defaults = {
        f.name: f.default_factory() if f.default_factory is not MISSING else f.default
        for f in fields(Recipe)
        if f.default_factory is not MISSING or f.default is not MISSING
    }
    there, here = defaults | dict(saved), asdict(recipe)
    for name in dict.fromkeys([*here, *there]):
        if name not in CHANGEABLE and _ordered(there.get(name)) != _ordered(here.get(name)):
            return f"{name} is {there.get(name)!r} there and {here.get(name)!r} here"
    return ""


def _ordered(value: Any) -> Any:
    """Converts tables to lists, because crops depend on their order."""
    return list(value.items()) if isinstance(value, dict) else value
