"""The state that the routes of one server share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from fastapi import Depends, Request

from ciir.service.web.routes.events import OpenStreams

if TYPE_CHECKING:
    from ciir.service.jobs.engine import Engine
    from ciir.service.metrics import Metrics
    from ciir.service.settings import Settings


@dataclass(frozen=True)
class ServiceState:
    """Settings, engine and metrics of one server."""

    settings: Settings
    engine: Engine
    metrics: Metrics
    streams: OpenStreams = field(init=False)

    def __post_init__(self) -> None:
        streams = OpenStreams(self.settings.max_streams, self.settings.max_client_streams)
        object.__setattr__(self, "streams", streams)


def find_state(request: Request) -> ServiceState:
    """A dependency: the state of the server that got the request."""
    state: ServiceState = request.app.state.service
    return state


State = Annotated[ServiceState, Depends(find_state)]
