"""What was given to reconstruct, read once, and what the report says of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.registry import is_picture
from ciir.renderer.scene import Scene
from ciir.service.pipeline.report import CountedFiles, Report

if TYPE_CHECKING:
    from ciir.renderer.light_field import LightField
    from ciir.service.pipeline.options import Options

Source = Bundle | str
"""Files, or the name of a scene of `renderer.scenes`."""


class Input:
    """A source, and a count of what was read of it."""

    def __init__(self, source: Source) -> None:
        if isinstance(source, Bundle):
            self.name = source.name
            self._files = CountedFiles(source.files)
            self.limits = source.limits
            self._bundle: Bundle | None = replace(source, files=self._files)
        else:
            self.name, self.limits = f"scene:{source}", DEFAULT_LIMITS
            self._scene = source
            self._bundle = None

    def read(self, options: Options) -> Scene | LightField:
        """The mesh, or the light field of the picture or pictures. Raises the input faults of `ciir.errors`."""
        if self._bundle is None:
            from ciir.renderer.scenes import load_scene

            return load_scene(self._scene)
        from ciir.renderer.readers import inputs

        content = inputs.read(self._bundle, lenses=options.lenses, pixels=options.pixels, pickup=options.pickup)
        if self._bundle.main is None and not isinstance(content, Scene):
            self._check_set(content, options)
        return content

    def _check_set(self, field: LightField, options: Options) -> None:
        """What speaks of an elemental image array must not go unheard where views were given."""
        size = field.views.shape[2:4]
        if options.lenses not in (None, size):
            given = f"{options.lenses[0]}x{options.lenses[1]}"
            raise InvalidOption(
                f"lenses: {given} doesn't fit {self.name}, whose views have {size[0]}x{size[1]} pixels; leave it out"
            )
        if options.pickup != "virtual":
            raise InvalidOption(
                f"pickup: optical is for elemental image arrays and {self.name} holds views; leave it out"
            )

    def read_mesh(self, options: Options) -> Scene:
        """The mesh; `InvalidOption` where the source holds pictures."""
        refusal = f"{self.name}: holds pictures; give a mesh, whose elemental image array is to be made"
        if self._bundle is not None and self._bundle.main is not None and is_picture(self._bundle.main):
            raise InvalidOption(refusal)
        content = self.read(options)
        if not isinstance(content, Scene):
            raise InvalidOption(refusal)
        return content

    def described(self, content: Scene | LightField) -> Report:
        """The report's `input`: `kind` is a file type, `views` for a set of pictures, or `scene`."""
        described: Report = {"name": self.name, "kind": self._kind()}
        if self._bundle is not None:
            described |= {"bytes": self._files.bytes_read, "files": self._files.files_read}
        if isinstance(content, Scene):
            return described | {"triangles": content.triangles, "parts": len(content.parts)}
        pixels_v, pixels_u, rows, cols, channels = content.views.shape
        return described | {
            "height": rows * pixels_v,
            "width": cols * pixels_u,
            "channels": channels,
            "bits": content.views.dtype.itemsize * 8,
        }

    def _kind(self) -> str:
        if self._bundle is None:
            return "scene"
        from ciir.renderer.readers.inputs import find_main

        found = find_main(self._bundle)
        return "views" if found is None else found[0].extension
