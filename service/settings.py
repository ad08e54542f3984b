"""What the HTTP server can be told by environment variables."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Read from `CIIR_...`; raises pydantic's `ValidationError` where one is out of range."""

    model_config = SettingsConfigDict(env_prefix="CIIR_")

    max_body_bytes: int = Field(default=64 * 2**20, ge=1024)
    """Most bytes in a request's body, declared or chunked."""
    max_output_pixels: int = Field(default=256_000_000, ge=1)
    """Most pixels in all views of one answer."""
    workers: int = Field(default=2, ge=1, le=64)
    """Reconstructions that run at once; more wait their turn."""
