"""The generators, one in each file, by their names in recipes."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.ensemble import Ensemble
from ciir.training.networks.light_field import LightFieldGenerator
from ciir.training.networks.lite import LiteGenerator
from ciir.training.networks.peers.fsrcnn import FSRCNN
from ciir.training.networks.peers.rdn import RDN
from ciir.training.networks.peers.rrdb import RRDBGenerator
from ciir.training.networks.peers.sparse_camera import SparseCameraGenerator
from ciir.training.networks.peers.srcnn import SRCNN
from ciir.training.networks.peers.srgan import SRGANGenerator
from ciir.training.networks.peers.vdsr import VDSR

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import nn

NETWORKS: dict[str, Callable[..., nn.Module]] = {
    "compact": CompactGenerator,
    "ensemble": Ensemble,
    "light_field": LightFieldGenerator,
    "lite": LiteGenerator,
    "srgan": SRGANGenerator,
    "srcnn": SRCNN,
    "fsrcnn": FSRCNN,
    "vdsr": VDSR,
    "rdn": RDN,
    "rrdb": RRDBGenerator,
    "sparse_camera": SparseCameraGenerator,
}
"""A recipe's `network` -> its constructor, whose keyword arguments are the recipe's `options`."""


def make_network(name: str, options: dict[str, Any]) -> nn.Module:
    """Makes the network of a recipe with random weights. Raises `ValueError` for an unknown name or option, or a
    value that can't be used.
    """
    if name not in NETWORKS:
        raise ValueError(f"network: {name!r} is not known; give one of {', '.join(NETWORKS)}")
    known = inspect.signature(NETWORKS[name]).parameters
    unknown = next((option for option in options if option not in known), None)
    if unknown is not None:
        raise ValueError(f"options: {name} has no {unknown!r}; give {', '.join(known)}")
    try:
        return NETWORKS[name](**options)
    except (TypeError, RuntimeError, LookupError, ArithmeticError) as error:  # Python's and torch's, for odd values
        values = ", ".join(f"{option} = {options[option]!r}" for option in options)
        usual = ", ".join(f"{option} = {known[option].default!r}" for option in options)
        raise ValueError(
            f"options: {name} can't be made with {values}; give values like the default, {usual}"
        ) from error


__all__ = ["NETWORKS", "CompactGenerator", "LiteGenerator", "make_network"]
