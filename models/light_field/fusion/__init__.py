"""Fusion: the mean of an upscaled view and the upscaled views around it, at the places that show the same content.

It takes about half as long as the light-field network, and several times as long for a single view, whose neighbours
have to be upscaled too. Views gain most that were filtered, because the network sees little in their neighbours that
they don't show themselves, and those of a JPEG, whose errors differ from view to view.
"""

from typing import Literal

Fusion = Literal["auto", "always", "never"]
"""Which views are fused. `auto`: those that look filtered, and those of an array that is a JPEG."""
