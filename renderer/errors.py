"""Everything that can be wrong with what `renderer` is given, drawn once.

::

    InputError                 the input or an option is at fault; the message is one line: what, the limit, the remedy
    ├── UnsupportedType        not a kind of file that is read, or not the kind that its name says
    ├── Unreadable             truncated, corrupt, or not decodable
    ├── TooLarge               over a limit on bytes, pixels, files or triangles
    ├── InvalidGeometry        no surface, not finite, or out of range
    └── InvalidOption          an option that doesn't fit itself or the input
    BackendUnavailable         the rendering backend that was asked for can't run on this machine
"""

from __future__ import annotations


class InputError(ValueError):
    """The input or an option is at fault; `str()` is one line with what was given, the limit and the remedy."""


class UnsupportedType(InputError):  # noqa: N818 - the cause is the name
    """Not a kind of file that is read, or not the kind that its name says."""


class Unreadable(InputError):  # noqa: N818
    """Truncated, corrupt, or not decodable."""


class TooLarge(InputError):  # noqa: N818
    """Over a limit on bytes, pixels, files or triangles."""


class InvalidGeometry(InputError):  # noqa: N818
    """No surface, not finite, or out of range."""


class InvalidOption(InputError):  # noqa: N818
    """An option that doesn't fit itself or the input."""


class BackendUnavailable(RuntimeError):  # noqa: N818
    """The rendering backend that was asked for can't run on this machine."""
