"""Describes an option and its values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ciir.service.pipeline.options.values import ValueType


@dataclass(frozen=True)
class Option:
    """An option: its help, and the type of its values."""

    placeholder: str
    """Stands for the value in the help of the command line."""
    help: str
    """One line."""
    type: ValueType
    """The type of its values."""
    example: str
    """A value as text."""
    flag: str = ""
    """The value that the option means without an argument on the command line; empty for options that take one."""
