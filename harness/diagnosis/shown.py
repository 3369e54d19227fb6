"""The question about the picture shown: the display pass over a ramp, against sRGB's definition."""

from __future__ import annotations

from functools import partial

import numpy as np

from harness.diagnosis.case import Case
from harness.diagnosis.seen import Seen
from harness.diagnosis.tally import Tally
from harness.gpu.display import display
from harness.samples.tone import encode_srgb

# Sums of so many samples, at these exposures (stops). Of a million it does not matter if one more is counted.
COUNTS, EXPOSURES = (1e6, 3.0), (0.0, 1.0)


def ask_display(case: Case, seen: Seen, tally: Tally) -> None:
    """A ramp from black to white, once for each number of samples and exposure."""
    pixels = case.scene.width * case.scene.height
    ramp = np.linspace(0, 1, pixels).reshape(case.scene.height, case.scene.width)
    lanes = np.arange(pixels)
    for samples in COUNTS:
        for exposure in EXPOSURES:
            sums = np.concatenate([np.repeat(ramp[..., None] * samples, 3, axis=2),
                                   np.full((*ramp.shape, 1), samples)], axis=2)
            shown = seen.once(("display", samples, exposure), partial(display, sums, exposure, case.library))
            shown = shown.reshape(pixels, 3).astype(np.float64)
            linear = np.repeat(np.clip(ramp.reshape(-1, 1) * 2**exposure, 0, 1), 3, axis=1)
            wanted = 255 * encode_srgb(linear)
            # The encoding is to blame where nothing but it is asked for, unless it is right and was done twice.
            alone = samples == COUNTS[0] and exposure == EXPOSURES[0]
            twice = np.abs(shown - 255 * encode_srgb(encode_srgb(linear))).max() < 2
            tally.ask("display", shown, wanted, lanes, vertex=case.scene.max_depth,
                      notes=[("encode_srgb" if alone and not twice else "main", np.ones(pixels, dtype=bool))])
