"""Takes batches of views through the stages: made, then upscaled."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Sequence
    from contextlib import AbstractContextManager

    from ciir.models.light_field.finishing import Finishing
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.service.pipeline.report import Clock
    from ciir.service.pipeline.stages.schedule import Batch
    from ciir.service.pipeline.stages.upscaling import UpscaleViews
    from ciir.service.pipeline.stages.view_sources import ViewSource


def make_views(views: ViewSource, batches: Sequence[Batch]) -> Generator[tuple[Batch, list[Pixels]]]:
    """Yields each batch with its new views."""
    pictures = views.make_views([view for batch in batches for view in batch.new])
    for batch in batches:
        yield batch, views.take_views(pictures, len(batch.new))


def upscale_batches(
    made: Generator[tuple[Batch, list[Pixels]]],
    upscale: UpscaleViews | None,
    opening: AbstractContextManager[Callable[[], object]],
    clock: Clock,
) -> Generator[tuple[Sequence[View], Iterable[Pixels], list[Finishing]]]:
    """Yields each batch's wanted views, their pictures, and how each was finished after a light-field network."""
    kept: dict[View, Pixels] = {}
    with closing(made), opening as wait:
        for batch, new in made:
            kept.update(zip(batch.new, new, strict=True))
            pictures: Iterable[Pixels] = [kept[view] for view in batch.wanted]
            finished: list[Finishing] = []
            if upscale is not None:
                with clock.stage("upscale"):
                    wait()
                    pictures, finished = upscale(kept, batch.wanted)
            for view in batch.done:
                del kept[view]
            yield batch.wanted, pictures, finished
