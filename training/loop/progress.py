"""Progress of a run: a bar on a terminal, elsewhere a line for each validation."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Self

from tqdm import tqdm

if TYPE_CHECKING:
    from types import TracebackType


class Progress:
    """On standard error, from `step` of `steps`: time left, last loss, last validation PSNR in dB."""

    def __init__(self, step: int, steps: int, psnr: float) -> None:
        self.psnr = psnr
        self._bar = tqdm(initial=step, total=steps, unit="step", disable=None, file=sys.stderr, dynamic_ncols=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def step(self, loss: float | None) -> None:
        """Counts a step; `loss` where it is known."""
        if loss is not None:
            self._bar.set_postfix_str(f"loss {loss:.4g}, PSNR {self.psnr:.2f} dB", refresh=False)
        self._bar.update()

    def report_validation(self, step: int, *, loss: float, psnr: float, pace: float) -> None:
        """Reports a validation after `step` with the mean loss since the previous one; `pace` in seconds a step."""
        self.psnr = psnr
        if self._bar.disable:
            left = tqdm.format_interval((self._bar.total - step) * pace)
            text = f"loss {loss:.4g}, PSNR {psnr:.2f} dB, {pace:.3g} s a step, {left} left"
            print(f"step {step} of {self._bar.total}: {text}", file=sys.stderr, flush=True)
