"""Progress of a run: a bar on a terminal, elsewhere a line for each validation."""

from __future__ import annotations

import sys

from tqdm import tqdm


class Progress(tqdm):  # type: ignore[misc]
    """On standard error, from `step` of `steps`: time left, last loss, last validation PSNR in dB."""

    def __init__(self, step: int, steps: int, psnr: float) -> None:
        self.psnr = psnr
        super().__init__(initial=step, total=steps, unit="step", disable=None, file=sys.stderr, dynamic_ncols=True)

    def count_step(self, loss: float | None) -> None:
        """Counts a step; `loss` where it is known."""
        if loss is not None:
            self.set_postfix_str(f"loss {loss:.4g}, PSNR {self.psnr:.2f} dB", refresh=False)
        self.update()

    def report_validation(self, step: int, *, loss: float, psnr: float, pace: float) -> None:
        """Reports a validation after `step` with the mean loss since the previous one; `pace` in seconds a step."""
        self.psnr = psnr
        if self.disable:
            left = self.format_interval((self.total - step) * pace)
            text = f"loss {loss:.4g}, PSNR {psnr:.2f} dB, {pace:.3g} s a step, {left} left"
            print(f"step {step} of {self.total}: {text}", file=sys.stderr, flush=True)
