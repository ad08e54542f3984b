"""Refocuses with plenopticam (Hahne and Aggoun, IEEE TIP 30, 2021) each time a line is read.

    PYTHON plenopticam_worker.py VIEWS.npy PLANES.npy LOW HIGH REFINE

PYTHON: the interpreter of an environment with plenopticam, and without ciir. VIEWS: `(N, N, H, W, 3)`. The planes have
the whole disparities LOW to HIGH - 1 or, if REFINE is 1, Nths from LOW on, and plenopticam enlarges the views N times
for them. Each answer is a line: seconds of processor time, and of wall time. Its steps other than refocusing (contrast,
gamma and files) are left out.
"""

from __future__ import annotations

import sys
import time

import numpy as np


def main(source: str, target: str, low: str, high: str, refine: str) -> None:
    """Answers until its input ends."""
    from plenopticam.cfg.cfg import PlenopticamConfig  # type: ignore[import-not-found]
    from plenopticam.lfp_extractor.lfp_contrast import LfpContrast  # type: ignore[import-not-found]
    from plenopticam.lfp_extractor.lfp_exporter import LfpExporter  # type: ignore[import-not-found]
    from plenopticam.lfp_refocuser.lfp_shiftandsum import LfpShiftAndSum  # type: ignore[import-not-found]
    from plenopticam.misc import GammaConverter, PlenopticamStatus  # type: ignore[import-not-found]

    views = np.load(source)
    cfg = PlenopticamConfig()
    cfg.default_values()
    cfg.params[cfg.ptc_leng] = len(views)
    cfg.params[cfg.ran_refo] = [int(low), int(high)]
    cfg.params[cfg.opt_refi] = refine == "1"
    cfg.params[cfg.opt_prnt] = False
    LfpContrast.auto_hist_align = lambda _, picture, **__: picture
    GammaConverter.srgb_conv = lambda _, img: img
    LfpExporter.save_refo_slice = lambda *_, **__: None
    for _ in sys.stdin:
        begun, wall = time.process_time(), time.perf_counter()
        refocuser = LfpShiftAndSum(vp_img_arr=views, cfg=cfg, sta=PlenopticamStatus())
        refocuser.refo_from_vp()
        seconds = time.process_time() - begun, time.perf_counter() - wall
        np.save(target, np.stack(refocuser.refo_stack) / len(views))  # it divides the sums by N once, not twice
        print(*seconds, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
