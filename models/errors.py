"""Everything that can be wrong with a model or with what it is given, drawn once.

::

    ModelError              the model that was asked for or its input is at fault; the message is one line
    ├── UnknownModel        no model of that name
    ├── UnsupportedScale    the model doesn't upscale by that factor
    ├── UnsuitedModel       for single pictures where views of a light field are given, or the other way round
    ├── UnsuitedProcessor   the network is an int8 one, which this machine's processor gets wrong
    ├── InvalidImage        not an array of pictures of the shape, type and range that models take
    └── BadCard             a card, or the network beside it, is missing, incomplete or doesn't fit
    BrokenNetwork           a network turned good input into something that is not a number
"""

from __future__ import annotations


class ModelError(ValueError):
    """The model that was asked for or its input is at fault; `str()` is one line with the limit and the remedy."""


class UnknownModel(ModelError):  # noqa: N818 - the cause is the name
    """No model of that name."""


class UnsupportedScale(ModelError):  # noqa: N818
    """The model doesn't upscale by that factor."""


class UnsuitedModel(ModelError):  # noqa: N818
    """The model takes single pictures where a light field's views are given, or the other way round."""


class UnsuitedProcessor(ModelError):  # noqa: N818 - the cause is the processor
    """The network is an int8 one, which this machine's processor gets wrong, or can't be known to get right."""


class InvalidImage(ModelError):  # noqa: N818
    """Not an array of pictures of the shape, type and range that models take."""


class BadCard(ModelError):  # noqa: N818
    """A card, or the network beside it, is missing, incomplete or doesn't fit."""


class BrokenNetwork(RuntimeError):  # noqa: N818
    """A network turned good input into something that is not a number: its weights are at fault, not the picture."""
