"""Types of option values: reading them from text and Python values, writing them as text, and their JSON schema."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from numbers import Integral
from operator import index
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.readers.names import clean_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_MOST = 999_999
"""The largest whole number allowed in text or in a sequence."""
_VIEW = "[0-9]{1,6},[0-9]{1,6}"
ANGLE = r"-?[0-9]{1,3}(\.[0-9]{1,6})?"
"""A pattern for degrees below 1000, to a millionth."""
MOST_FRAMES = 3600
"""The largest number of times, or of yaws, that can be given."""
_LONGEST_LABEL = 200
"""Most characters allowed in a name from a file."""


@dataclass(frozen=True)
class ValueType:
    """A type of values. All functions except `write` get the option's name for messages and raise `InvalidOption`."""

    schema: dict[str, Any]
    """JSON schema of a value's text, or of the number itself for a number. A field in a form may be empty, which counts
    as not sent."""
    read: Callable[[str, str], Any]
    """Returns the value of a text."""
    convert: Callable[[Any], Any]
    """Returns the value of an object that is not text. Raises any error for a wrong one."""
    needed: str
    """What `convert` takes, for messages."""
    write: Callable[[Any], str] = str
    """Returns the text of a value."""

    def parse(self, name: str, value: object) -> Any:
        """Returns the value of a text or of another object. numpy scalars are taken as Python numbers."""
        if isinstance(value, str):
            return self.read(name, value)
        try:
            return self.convert(value.item() if isinstance(value, np.generic) else value)
        except InvalidOption:
            raise
        except (IndexError, OverflowError, TypeError, ValueError) as error:
            given = clean_text(repr(value))[:40]
            raise InvalidOption(f"{name}: {given} is not understood; give {self.needed}") from error

    def check(self, name: str, value: Any) -> None:
        """Raises `InvalidOption` for a value that is not in the list or the range of `schema`."""
        allowed = self.schema.get("enum")
        if allowed is not None and value is not None and value not in allowed:
            raise InvalidOption(f"{name}: {value[:40]!r} is not known; give {' or '.join(allowed)}")
        least, most = self.schema.get("minimum"), self.schema.get("maximum")
        if least is not None and value is not None and not (math.isfinite(value) and least <= value <= most):
            kind = "a positive number from " if 0 < least < 1 else ""
            raise InvalidOption(f"{name}: {value} is out of range; give {kind}{least:g} to {most:g}")


def read_pair(name: str, text: str, most: int = _MOST) -> tuple[int, int]:
    """Parses `5x7` as (5, 7), for the option `name`. Raises `InvalidOption`, also for a number over `most`."""
    match = re.fullmatch(r"\s*(\d{1,20})\s*[xX]\s*(\d{1,20})\s*", text)
    if match is None:
        raise InvalidOption(f"{name}: {text[:40]!r} is not understood; give rows x columns, such as 100x100")
    counts = int(match[1]), int(match[2])
    if not all(1 <= count <= most for count in counts):
        raise InvalidOption(f"{name}: {counts[0]}x{counts[1]} is out of range; give 1 to {most:,} of each")
    return counts


def _read_text(name: str, text: str) -> str:  # noqa: ARG001 - all functions that read text share one signature
    return text.strip()


def _read_label(name: str, text: str) -> str:
    if len(text) > _LONGEST_LABEL:
        raise InvalidOption(f"{name}: {clean_text(text)[:40]!r} ... is too long; give a name or a number")
    return text.strip()


def _read_integer(name: str, text: str) -> int:
    digits = text.strip()  # `int` alone accepts less white space than `strip` and \s in a pattern
    if re.fullmatch(r"-?\d{1,20}", digits) is None:
        raise InvalidOption(f"{name}: {text[:40]!r} is not a whole number; give one such as 2")
    return int(digits)


def _read_number(name: str, text: str) -> float:
    try:
        return float(text.strip().replace("_", "x"))  # `float` would read 1_5 as 15
    except ValueError as error:
        raise InvalidOption(f"{name}: {text[:40]!r} is not a number; give one such as 0.5") from error


def _refuse(value: Any) -> Any:
    raise TypeError(value)


def convert_whole_numbers(value: Any, count: int, most: int) -> tuple[int, ...]:
    """Converts a sequence of `count` whole numbers from 0 to `most`. Raises `ValueError` and `TypeError`."""
    numbers = tuple(index(check_number(number)) for number in value)
    if len(numbers) != count or not all(0 <= number <= most for number in numbers):
        raise ValueError
    return numbers


def _convert_pair(value: Any) -> tuple[int, ...]:
    return convert_whole_numbers(value, 2, _MOST)


def _convert_views(value: Any) -> str:
    is_pair = len(value) == 2 and all(isinstance(number, Integral) for number in value)
    return ";".join("{},{}".format(*_convert_pair(pair)) for pair in ([value] if is_pair else value))


def _parse_counts(_: str, text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(",")))


def write_number(number: float, decimals: int = 6) -> str:
    """Formats `number` with so many decimals, without trailing zeros."""
    return f"{number:.{decimals}f}".rstrip("0").rstrip(".")


def make_form(
    pattern: str,
    *,
    form: str,
    parse: Callable[[str, str], Any],
    convert: Callable[[Any], Any],
    needed: str,
    write: Callable[[Any], str] = str,
) -> ValueType:
    """Makes a type of values whose text matches `pattern`, ignoring spaces around commas, colons and semicolons.

    `form` describes the pattern, for messages. `parse` gets an option's name and a matching text, and returns
    the value. The other arguments are those of `ValueType`.
    """

    def read(name: str, text: str) -> Any:
        bare = re.sub(r"\s*([,:;])\s*", r"\1", text.strip())
        if re.fullmatch(pattern, bare) is None:
            raise InvalidOption(f"{name}: {text[:40]!r} is not understood; give {form}")
        return parse(name, bare)

    return ValueType({"type": "string", "pattern": f"^({pattern})?$"}, read, convert, needed, write)


def make_pair(most: int = _MOST) -> ValueType:
    """Makes a type for rows x columns, each from 1 to `most`."""
    return ValueType(
        {"type": "string", "pattern": "^([1-9][0-9]{0,5}x[1-9][0-9]{0,5})?$"},
        lambda name, text: read_pair(name, text, most),
        lambda value: convert_whole_numbers(value, 2, most),
        f"rows and columns from 1 to {most:,}, such as (50, 50)",
        lambda pair: "{}x{}".format(*pair),
    )


PAIR = make_pair()
MARGINS = make_form(
    "[0-9]{1,6}(,[0-9]{1,6}){3}",
    form="TOP,LEFT,BOTTOM,RIGHT, such as 0,0,7,5",
    parse=_parse_counts,
    convert=lambda value: convert_whole_numbers(value, 4, _MOST),
    needed=f"four whole numbers from 0 to {_MOST:,}, such as (0, 0, 7, 5)",
    write=lambda margins: ",".join(map(str, margins)),
)
VIEW = make_form(
    _VIEW,
    form="a row and a column of views, such as 0,4",
    parse=_parse_counts,
    convert=_convert_pair,
    needed="a row and a column, such as (0, 4)",
    write=lambda view: "{},{}".format(*view),
)
VIEWS = make_form(
    rf"center|cross|all|{_VIEW}((;|\s+){_VIEW})*",
    form="center, cross, all, or pairs such as '0,0 7,7'",
    parse=lambda _, text: re.sub(r"\s+", ";", text),  # the separator of a job's options
    convert=_convert_views,
    needed="'center', 'cross', 'all', or pairs such as [(0, 0), (7, 7)]",
)
TEXT = ValueType({"type": "string"}, _read_text, _refuse, "text")
LABEL = ValueType(
    {"type": "string", "maxLength": _LONGEST_LABEL},
    _read_label,
    lambda value: str(index(check_number(value))),
    "a name or a whole number, such as 0",
)


def make_angles(names: str, limits: Sequence[float] = ()) -> ValueType:
    """Makes a type for as many angles as `names` lists, such as `YAW,PITCH,ROLL`.

    Each is in degrees, below 1000, to a millionth. With `limits`, the absolute value of each angle is at most its
    limit.
    """
    count = names.count(",") + 1
    example = ",".join(["30", "-20", "0"][:count])

    def parse(name: str, angles: str) -> tuple[float, ...]:
        found = tuple(map(float, angles.split(",")))
        for angle_name, angle, limit in zip(names.lower().split(","), found, limits, strict=False):
            if abs(angle) > limit:
                raise InvalidOption(
                    f"{name}: the {angle_name} of {angle:g} degrees is out of range; give -{limit:g} to {limit:g}"
                )
        return found

    def convert(value: Any) -> tuple[float, ...]:
        angles = tuple(round(float(check_number(angle)), 6) for angle in value)
        is_within = all(abs(angle) <= limit for angle, limit in zip(angles, limits, strict=False))
        if len(angles) != count or not all(abs(angle) < 1000 for angle in angles) or not is_within:
            raise ValueError
        return angles

    return make_form(
        f"{ANGLE}(,{ANGLE}){{{count - 1}}}",
        form=f"{names} in degrees, such as {example}",
        parse=parse,
        convert=convert,
        needed=f"{names} in degrees, such as ({example.replace(',', ', ')}), "
        + (f"at most {', '.join(f'{limit:g}' for limit in limits)}" if limits else "each below 1000"),
        write=lambda angles: ",".join(map(write_number, angles)),
    )


def make_name(allowed: tuple[str, ...]) -> ValueType:
    """Makes a type for one of the texts in `allowed`."""
    return ValueType({"type": "string", "enum": list(allowed)}, _read_text, _refuse, "text")


def make_switch(allowed: tuple[str, str]) -> ValueType:
    """Makes a type like `make_name`, in which True stands for the first name and False for the second."""
    return ValueType(
        {"type": "string", "enum": list(allowed)},
        _read_text,
        lambda value: allowed[::-1][index(value)],
        "True or False",
    )


def make_integer(least: int, most: int) -> ValueType:
    """Makes a type for whole numbers in a range."""
    return ValueType(
        {"type": "integer", "minimum": least, "maximum": most},
        _read_integer,
        lambda value: index(check_number(value)),
        "a whole number such as 2",
    )


def make_number(least: float, most: float, needed: str = "a number such as 0.5") -> ValueType:
    """Makes a type for numbers in a range."""
    schema = {"type": "number", "minimum": least, "maximum": most}
    return ValueType(schema, _read_number, lambda value: float(check_number(value)), needed)


def check_number(value: Any) -> Any:
    """Returns `value`. Raises `TypeError` for True and False, which Python takes as 1 and 0."""
    if isinstance(value, bool | np.bool_):
        raise TypeError
    return value
