"""What the service can be told by environment variables: the HTTP server, and whoever stores results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from renderer.errors import InvalidOption
from service import cache
from service.store import Store

_PREFIX = "CIIR_"
RANGES = {
    "max_body_bytes": (1024, 2**40),
    "max_output_pixels": (1, 2**40),
    "workers": (1, 64),
    "store_bytes": (0, 2**40),
}
"""Least and most of each."""


def _whole(name: str, default: int) -> Any:
    least, most = RANGES[name]
    return Field(default=default, ge=least, le=most)


class Settings(BaseSettings):
    """Read from `CIIR_...`; raises pydantic's `ValidationError` where one is out of `RANGES`."""

    model_config = SettingsConfigDict(env_prefix=_PREFIX)

    max_body_bytes: int = _whole("max_body_bytes", 64 * 2**20)
    """Most bytes in a request's body, declared or chunked."""
    max_output_pixels: int = _whole("max_output_pixels", 256_000_000)
    """Most pixels in all views of one answer."""
    workers: int = _whole("workers", 2)
    """Reconstructions that run at once; more wait their turn."""
    store: str = ""
    """The folder of stored results. The server's, where none is named: `results` in `service.cache.folder`. The command
    line stores nothing unless one is named."""
    store_bytes: int = _whole("store_bytes", 512 * 2**20)
    """Most bytes of all stored results; 0: none is stored."""

    def open_store(self) -> Store | None:
        """Where results are stored; None where they are not: no bytes are allowed, or no folder is known."""
        folder = cache.folder()
        place = Path(self.store) if self.store else folder and folder / "results"
        return Store(place, self.store_bytes) if place and self.store_bytes else None


def read() -> Settings:
    """The settings of the environment; `InvalidOption` in place of what pydantic says."""
    try:
        return Settings()
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0])
        least, most = RANGES[name]
        raise InvalidOption(
            f"{_PREFIX}{name.upper()}: {first['input']!r} is no whole number from {least} to {most}; "
            f"set one, or unset it for the default of {Settings.model_fields[name].default}"
        ) from error
