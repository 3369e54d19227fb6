"""The frame, the pdfs and the samplers of lib/sampling.glsl: each pdf integrates to 1, each sampler follows its pdf."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from harness.checks.chi2 import Pdf, chi2, pearson
from harness.checks.domains import UP, Axis, Crowded
from harness.checks.finding import LEVEL, Finding
from harness.checks.frame import ORTHONORMAL, axes, frame
from harness.checks.integral import integral
from harness.checks.shader import Probe, frames, sampler

# Exact in float32, none of its coordinates in any frame's favour.
_X, _Y, _Z = np.array([-0.4, 0.5, -0.2], dtype=np.float32) / np.float32(np.sqrt(0.45))
TILTED: Axis = float(_X), float(_Y), float(_Z)
CASES = (("uniform", 0.0), ("cosine", 1.0), ("lobe", 1.0), ("lobe", 10.0), ("lobe", 100.0))
# Over the whole sphere, since a pdf may be wrong below the horizon; so many rows that its jump there is off by 2e-4.
ROWS = (20_000, 1)
# What a pdf's integral is often off by.
FACTORS = {"pi": np.pi, "1/pi": 1 / np.pi, "2": 2.0, "1/2": 0.5, "2 pi": 2 * np.pi, "1/(2 pi)": 0.5 / np.pi,
           "pi/2": np.pi / 2, "2/pi": 2 / np.pi, "pi^2": np.pi**2, "4": 4.0, "1/4": 0.25}
COUNT = 1 << 17
STEPS = 8  # midpoints along each side of a cell: what is tested is smooth, but for the horizon
TURNS = 180  # parts of a turn in which azimuths are counted
UNIT = 1e-5  # of a direction's length, in float32


def frames_of(probe: Probe) -> Iterator[Finding]:
    """Whether `to_world` is orthonormal about every axis, and takes z to it."""
    make = frames(probe)
    yield replace(frame(make), function="to_world")
    about = axes()
    off = np.nan_to_num(np.abs(make(about)[:, 2] - about).max(axis=1), nan=np.inf)
    worst = ", ".join(f"{value:.4g}" for value in about[off.argmax()])
    yield Finding("axis", float(off.max()), 0.0, bool(off.max() <= ORTHONORMAL),
                  f"(0, 0, 1) becomes the axis to within {off.max():.2g}, expected {ORTHONORMAL:g}; worst about "
                  f"({worst})", error=ORTHONORMAL, function="to_world")


def findings(probe: Probe, cases: Sequence[tuple[str, float]] = CASES) -> Iterator[Finding]:
    """Of each sampler and its pdf, by exponent."""
    for name, alpha in cases:
        at = f" at alpha = {alpha:g}" if name == "lobe" else ""
        _, pdf = sampler(probe, name, UP, alpha)
        total = integral(pdf, Crowded(UP), points=ROWS)
        yield replace(total, function=f"pdf_{name}", sentence=f"{total.sentence}{at}{_factor(total, alpha, name)}")
        yield from _directions(probe, name, alpha, total.value, at)


def _directions(probe: Probe, name: str, alpha: float, total: float, at: str) -> Iterator[Finding]:
    """Whether directions have length 1, and whether they follow the pdf, whatever factor that has."""
    scale = 1 / total if np.isfinite(total) and total > 0 else 1.0
    for axis in (UP, TILTED):
        sample, pdf = sampler(probe, name, axis, alpha)
        drawn = sample(np.random.default_rng(0).random((COUNT, 2), dtype=np.float32))
        length = np.linalg.norm(drawn.astype(np.float64), axis=1)
        off = float(np.nan_to_num(np.abs(length - 1), nan=np.inf).max())
        yield Finding("length", off, 0.0, off <= UNIT, f"directions{at} are off unit length by {off:.2g}, expected "
                      f"{UNIT:g} at most", error=UNIT, function=f"sample_{name}")
        if off > UNIT:
            continue
        yield _azimuth(drawn.astype(np.float64), axis, name, at)

        def scaled(d: np.ndarray, pdf: Pdf = pdf) -> np.ndarray:
            return pdf(d) * scale

        def given(u: np.ndarray, drawn: np.ndarray = drawn) -> np.ndarray:
            return drawn

        found = chi2(given, scaled, Crowded(axis), count=COUNT, steps=STEPS)
        if found.passed:
            yield replace(found, function=f"sample_{name}")
            continue
        # One of the two is wrong; what the name promises tells which.
        promised = chi2(given, _promised(name, alpha, axis), Crowded(axis), count=COUNT, steps=STEPS)
        blamed = f"pdf_{name}" if promised.passed else f"sample_{name}"
        told = (f"; the directions are those of {_words(name)}, the pdf is not" if promised.passed
                else f"; nor are they those of {_words(name)}")
        yield replace(found, function=blamed, sentence=f"{found.sentence}{at}{told}")


def _azimuth(drawn: np.ndarray, axis: Axis, name: str, at: str) -> Finding:
    """Whether directions are even around their axis, as they are where a pdf knows the cosine alone: a gap, which the
    cells of `chi2` are too many to show."""
    turns = Crowded(axis).backward(drawn)[:, 0]
    counts = np.bincount(np.minimum(turns * TURNS, TURNS - 1).astype(int), minlength=TURNS).astype(float)
    statistic, dof = pearson(counts, np.full(TURNS, len(drawn) / TURNS))
    p = float(special.chdtrc(dof, statistic))
    return Finding("azimuth", statistic / dof, 1.0, p > LEVEL, f"azimuths{at} about their axis have a χ² of "
                   f"{statistic / dof:.3g} per degree of freedom, p = {p:.2g}; the emptiest of {TURNS} parts holds "
                   f"{counts.min():,.0f} where {len(drawn) / TURNS:,.0f} are expected", p=p, function=f"sample_{name}")


def _promised(name: str, alpha: float, axis: Axis) -> Pdf:
    """The density that a sampler's name promises."""
    def density(d: np.ndarray) -> np.ndarray:
        cosine = d @ np.array(axis)
        exponent = {"uniform": 0.0, "cosine": 1.0, "lobe": alpha}[name]
        return np.where(cosine > 0, (exponent + 1) / (2 * np.pi) * np.maximum(cosine, 1e-300)**exponent, 0.0)

    return density


def _words(name: str) -> str:
    return {"uniform": "a uniform hemisphere", "cosine": "cos / pi", "lobe": "(alpha + 1)/(2 pi) cos^alpha"}[name]


def _factor(total: Finding, alpha: float, name: str) -> str:
    """What an integral is, where it is a number that such slips give."""
    if total.passed:
        return ""
    known = dict(FACTORS)
    if name == "lobe":
        known |= {"(alpha + 2)/(alpha + 1)": (alpha + 2) / (alpha + 1), "alpha/(alpha + 1)": alpha / (alpha + 1),
                  "1/(alpha + 1)": 1 / (alpha + 1), "alpha + 1": alpha + 1}
    words = [word for word, value in known.items() if abs(total.value / value - 1) < 1e-3]
    return f", {words[0]} times too much" if words else ""
