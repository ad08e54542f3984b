"""What the HTTP server can be told by environment variables."""

from __future__ import annotations

from typing import Any

from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from renderer.errors import InvalidOption

_PREFIX = "CIIR_"
RANGES = {"max_body_bytes": (1024, 2**40), "max_output_pixels": (1, 2**40), "workers": (1, 64)}
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
