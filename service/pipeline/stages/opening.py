"""Opens a network's session while the first views are made."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ciir.models import catalogue
from ciir.models.sessions import OnnxNetwork
from ciir.models.single.network import SingleImageNetwork
from ciir.service.pipeline.options import NO_MODEL

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ciir.service.pipeline.planning.plan import Plan


@contextmanager
def open_session(plan: Plan, *, views: int, pixels: int) -> Iterator[Callable[[], object]]:
    """Opens the session that `plan.model` needs for one view of `pixels` pixels, which takes 30 to 100 ms.

    This happens in a thread that ends with this context. Yields a function that waits until the session is open, and
    raises its error. `views`: how many are upscaled. For several, nothing is opened, because they may need sessions on
    one core each.
    """
    load = catalogue.load_light_field_network if plan.is_light_field else catalogue.load_upscaler
    model = load(plan.model, scale=plan.scale) if views == 1 and plan.model != NO_MODEL else None
    if not isinstance(model, OnnxNetwork):
        yield lambda: None
        return
    cores = model.count_cores(pixels) if isinstance(model, SingleImageNetwork) else model.threads
    with ThreadPoolExecutor(1, thread_name_prefix="open") as thread:
        yield thread.submit(model.open, cores).result
