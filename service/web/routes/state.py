"""The state that the routes of one server share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from fastapi import Depends, Request

if TYPE_CHECKING:
    from ciir.service.jobs.engine import Engine
    from ciir.service.settings import Settings
    from ciir.service.web.routes.events import OpenStreams


@dataclass(frozen=True)
class ServiceState:
    """Settings, engine and open event streams of one server."""

    settings: Settings
    engine: Engine
    streams: OpenStreams


def find_state(request: Request) -> ServiceState:
    """Finds the state of the server that got the request. A dependency."""
    state: ServiceState = request.app.state.service
    return state


State = Annotated[ServiceState, Depends(find_state)]
