"""How an option is described and written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ciir.service.pipeline.options.values import ValueType


@dataclass(frozen=True)
class Option:
    """How an option is described and written."""

    placeholder: str
    """Of its value, in the help of the command line."""
    help: str
    """A line."""
    type: ValueType
    """Of its values."""
    example: str
    """A value's text."""
    flag: str = ""
    """The value that the option alone stands for on the command line; empty for options that are followed by one."""
