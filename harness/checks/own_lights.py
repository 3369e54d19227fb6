"""Directions towards lights, drawn by lib/lights.glsl: does their density measure the light, part by part?

Whatever the distribution, 1 / pdf is the solid angle that a sample stands for: summed over the samples that fall on a
part of a light, per sample, it is that part's solid angle. So a library may draw as it likes; where a sum is off, its
density is not the one that it draws by. What is expected comes from geometry in double precision, by quadrature.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from harness.checks.domains import midpoints
from harness.checks.finding import LEVEL, Finding, Histogram
from harness.checks.shader import Probe

COUNT = 1 << 16
CELLS = (8, 16)  # rows and columns of each face's parts
STEPS = 24  # midpoints along each side of a part
LEAST = 50  # samples in a part, from which on its sum is about normal
UNIT = 1e-5  # of a direction's length, in float32
# Of a density that is told of a ray that has met the light, beside the one that it was drawn with, where its cosine is
# at least GRAZING: below, rounding moves the point that is met, and the cosine with it. At an edge the ray may meet
# another face.
AGREE, GRAZING, FIRM = 3e-3, 0.02, 0.999
# As glsl/probes/light_sampling.frag numbers them.
SHAPES = ("ball", "rectangle", "disk", "cube", "cylinder")
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Lit:
    """A light as the probe is given it, and where it is seen from. `edges`: half its edges, at right angles, the last
    its normal where it is flat; of a cylinder its radii and whole length, from its foot. `side`: 1 outwards. `dark`:
    where no light of it arrives, whatever hides it."""

    name: str
    shape: str
    seen_from: Vector
    middle: Vector
    edges: tuple[Vector, Vector, Vector]
    sample: str
    pdf: str
    dark: Vector | None
    side: float = 1.0

    def faces(self) -> tuple[tuple[np.ndarray, ...], ...]:
        """Of each flat face: its middle, its two half edges, its unit normal outwards."""
        x, y, z = (np.array(edge) for edge in self.edges)
        m = np.array(self.middle)
        if self.shape == "rectangle":
            return ((m, x, y, z / np.linalg.norm(z)),)
        return tuple((m + sign * a, b, c, sign * a / np.linalg.norm(a))
                     for a, b, c in ((x, y, z), (y, z, x), (z, x, y)) for sign in (-1.0, 1.0))


_BALL: tuple[Vector, Vector, Vector] = ((0.8, 0.0, 0.0), (0.0, 0.8, 0.0), (0.0, 0.0, 0.8))
_LARGE: tuple[Vector, Vector, Vector] = ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0))
_LEANING: tuple[Vector, Vector, Vector] = ((0.6, 0.0, 0.8), (0.0, 0.5, 0.0), (0.8, 0.0, -0.6))
AT, BEHIND = (0.2, -0.1, -0.3), (-1.0, 0.1, 2.5)
CASES = (
    Lit("a ball", "ball", AT, (0.0, 0.0, 2.5), _BALL, "sample_sphere", "pdf_ball", (0.1, 0.0, 2.5)),
    Lit("a ball that is almost touched", "ball", (0.0, 0.0, 0.5), (0.0, 0.0, 1.31), _BALL, "sample_sphere", "pdf_ball",
        (0.0, 0.0, 0.9)),
    Lit("a ball far away", "ball", AT, (400.0, -300.0, 900.0), _LARGE, "sample_sphere", "pdf_ball",
        (400.0, -300.0, 900.5)),
    Lit("a ball from inside", "ball", AT, (0.0, 0.0, 0.0), _BALL, "sample_around", "", (0.0, 1.1, 0.2), side=-1.0),
    Lit("a rectangle", "rectangle", AT, (0.3, 0.0, 1.0), _LEANING, "sample_rectangle", "pdf_area", BEHIND),
    Lit("a disk", "disk", AT, (0.3, 0.0, 1.0), _LEANING, "sample_disk_light", "pdf_area", BEHIND),
    Lit("a box", "cube", (1.5, 0.3, -0.8), (0.0, 0.4, 1.2), ((0.48, 0.36, 0.0), (-0.48, 0.64, 0.0), (0.0, 0.0, 0.7)),
        "sample_cube", "pdf_cube", (0.1, 0.4, 1.1)),
    Lit("a tube", "cylinder", (0.1, 1.4, 0.2), (0.0, 0.0, -0.6), ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 1.4)),
        "sample_cylinder", "pdf_cylinder", (0.1, 0.2, 0.3)),
    Lit("a tube from inside", "cylinder", (0.1, 0.15, 0.2), (0.0, 0.0, -0.6),
        ((0.8, 0.0, 0.0), (0.0, 0.8, 0.0), (0.0, 0.0, 1.4)), "sample_cylinder", "pdf_cylinder", None, side=-1.0),
)


def findings(probe: Probe) -> Iterator[Finding]:
    """Of each function that draws a direction towards a shape, and of the density of a ray that met it."""
    numbers = np.floor(np.random.default_rng(3).random((COUNT, 2)) * 2**24) / 2**24
    for lit in CASES:
        drawn, _ = probed(probe, lit, numbers, np.ones(COUNT), np.ones(COUNT))
        l, pdf = drawn[:, :3].astype(np.float64), drawn[:, 3].astype(np.float64)  # noqa: E741
        off = float(np.nan_to_num(np.abs(np.linalg.norm(l, axis=1) - 1), nan=np.inf).max())
        yield Finding("length", off, 0.0, off <= UNIT, f"directions to {lit.name} are off unit length by {off:.2g}, "
                      f"expected {UNIT:g} at most", error=UNIT, function=lit.sample)
        if off > UNIT:
            continue
        part, t, facing = met(lit, l)
        hit = (part >= 0) & (pdf > 0) & np.isfinite(pdf)
        yield _measure(lit, part, np.where(hit, 1 / np.where(hit, pdf, 1), 0.0))
        if lit.dark:
            yield _darkness(probe, replace(lit, seen_from=lit.dark), numbers)
        if lit.pdf:
            yield _agreement(probe, lit, numbers, t, facing, pdf, hit & (facing > GRAZING))


def probed(probe: Probe, lit: Lit, numbers: np.ndarray, t: np.ndarray,
           facing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For numbers (N, 2): directions and densities (N, 4), and the densities (N,) of rays that meet the light at
    distances t (N,) and cosines (N,)."""
    rows = np.tile([*lit.seen_from, 0.0], (len(numbers), 1))
    found = probe("light_sampling.frag", rows, np.c_[numbers, t, facing], outputs=2,
                  defines={"SHAPE": SHAPES.index(lit.shape)},
                  uniforms={"middle": lit.middle, "side": lit.side,
                            **dict(zip(("edge_x", "edge_y", "edge_z"), lit.edges, strict=True))})
    return found[:, :4], found[:, 4]


def met(lit: Lit, l: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: E741
    """Of rays along l (N, 3): the part of the light that each meets first on its shining side, -1 for none, (N,); the
    distance and the cosine there."""
    if lit.shape == "ball":
        return _met_ball(lit, l)
    if lit.shape in ("rectangle", "cube"):
        return _met_flat(lit, l)
    return _met_disk(lit, l) if lit.shape == "disk" else _met_tube(lit, l)


def measures(lit: Lit) -> np.ndarray:
    """The solid angle of each part of the light that shines at where it is seen from, (parts,), by midpoints."""
    at = midpoints(CELLS[0] * STEPS, CELLS[1] * STEPS)
    parts = _cell(at)
    count = CELLS[0] * CELLS[1]
    if lit.shape == "ball":
        whole = 2 * np.pi * _cap(lit)
        return np.full(count, whole / count)
    o = np.array(lit.seen_from)
    if lit.shape in ("rectangle", "cube"):
        found = []
        for m, x, y, n in lit.faces():
            p = m + (2 * at[:, :1] - 1) * x + (2 * at[:, 1:] - 1) * y
            found.append(_steradians(p - o, n, 4 * float(np.linalg.norm(x) * np.linalg.norm(y))))
        return np.concatenate([np.bincount(parts, each / STEPS**2 / count, minlength=count) for each in found])
    x, y, z = (np.array(edge) for edge in lit.edges)
    turn = 2 * np.pi * at[:, :1]
    if lit.shape == "disk":
        p = np.array(lit.middle) + np.sqrt(at[:, 1:]) * (np.cos(turn) * x + np.sin(turn) * y)
        each = _steradians(p - o, z / np.linalg.norm(z), np.pi * float(np.linalg.norm(x) * np.linalg.norm(y)))
    else:
        out = (np.cos(turn) * x + np.sin(turn) * y) / np.linalg.norm(x)
        p = np.array(lit.middle) + np.linalg.norm(x) * out + at[:, 1:] * z
        each = _steradians(p - o, lit.side * out, 2 * np.pi * float(np.linalg.norm(x) * np.linalg.norm(z)))
    return np.bincount(parts, each / STEPS**2 / count, minlength=count)


def _measure(lit: Lit, part: np.ndarray, steradians: np.ndarray) -> Finding:
    """Whether the solid angles that samples stand for add up to those of the light's parts."""
    expected = measures(lit)
    kept = part >= 0
    sums = np.bincount(part[kept], steradians[kept], minlength=len(expected)) / COUNT
    squares = np.bincount(part[kept], steradians[kept]**2, minlength=len(expected)) / COUNT
    counts = np.bincount(part[kept], minlength=len(expected))
    variance = np.maximum(squares - sums**2, (expected / 10)**2 / LEAST) / COUNT
    told = counts >= LEAST
    z = np.where(told, (sums - expected) / np.sqrt(np.maximum(variance, 1e-300)), 0.0)
    lost = float(expected[~told].sum() / expected.sum())
    statistic, dof = float((z**2).sum()), max(int(told.sum()), 1)
    p = float(special.chdtrc(dof, statistic))
    total, truth = float(sums.sum()), float(expected.sum())
    worst = int(np.abs(z).argmax())
    rows = (-1, CELLS[1])
    return Finding(
        "measure", total, truth, p > LEVEL and lost < 0.02,
        f"1 / pdf over samples of {lit.name} is {total:.5g} steradians where it takes {truth:.5g}; of its "
        f"{len(expected)} parts one has {sums[worst]:.4g} for {expected[worst]:.4g}, χ² {statistic / dof:.3g} per "
        f"part, p = {p:.2g}" + (f"; {lost:.0%} of it is never drawn" if lost >= 0.02 else ""), p=p, function=lit.sample,
        histogram=Histogram((sums * COUNT).reshape(rows), (expected * COUNT).reshape(rows),
                            np.zeros((len(expected) // CELLS[1], CELLS[1], 3))))


def _darkness(probe: Probe, lit: Lit, numbers: np.ndarray) -> Finding:
    """Whether nothing is drawn where none of the light arrives."""
    drawn, _ = probed(probe, lit, numbers, np.ones(COUNT), np.ones(COUNT))
    bright = float((drawn[:, 3] > 0).mean())
    return Finding("dark", bright, 0.0, bright == 0, f"from where nothing of {lit.name} shines, {bright:.2%} of the "
                   "directions have a density above zero", error=0.0, function=lit.sample)


def _agreement(probe: Probe, lit: Lit, numbers: np.ndarray, t: np.ndarray, facing: np.ndarray, pdf: np.ndarray,
               firm: np.ndarray) -> Finding:
    """Whether a ray that met the light is told the density with which it would have been drawn."""
    _, told = probed(probe, lit, numbers, t, facing)
    off = np.nan_to_num(np.abs(told[firm] / pdf[firm] - 1), nan=np.inf)
    worst = float(np.quantile(off, FIRM)) if len(off) else np.inf
    return Finding("agreement", worst, 0.0, worst <= AGREE, f"of rays that met {lit.name} the density is within "
                   f"{worst:.2g} of that with which they were drawn, for all but {1 - FIRM:.1%}, expected {AGREE:g}",
                   error=AGREE, function=lit.pdf)


def _cell(at: np.ndarray) -> np.ndarray:
    """The number of the part in which a point of a face's unit square lies."""
    inside = np.clip(np.nan_to_num(at), 0, 1 - 1e-12)
    return (inside[:, 1] * CELLS[0]).astype(int) * CELLS[1] + (inside[:, 0] * CELLS[1]).astype(int)


def _steradians(way: np.ndarray, n: np.ndarray, area: float) -> np.ndarray:
    """Per unit of the square that is spread evenly over `area`: cos θ / distance² of what faces the origin."""
    squared = (way**2).sum(axis=1)
    cosine = -(way * n).sum(axis=1) / np.sqrt(squared)
    return np.asarray(area * np.maximum(cosine, 0) / squared)


def _cap(lit: Lit) -> float:
    """1 - cos of the angle at which the ball is seen; 2 from inside."""
    away = float(np.linalg.norm(np.subtract(lit.middle, lit.seen_from)))
    sine = float(np.linalg.norm(lit.edges[0])) / away if away else np.inf
    return 2.0 if sine >= 1 else sine**2 / (1 + np.sqrt(1 - sine**2))


def _met_ball(lit: Lit, l: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: E741
    way = np.subtract(lit.middle, lit.seen_from)
    axis = way / np.linalg.norm(way)
    x = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    x /= np.linalg.norm(x)
    turn = np.arctan2(l @ np.cross(axis, x), l @ x) / (2 * np.pi) % 1
    across = (l @ x)**2 + (l @ np.cross(axis, x))**2
    drop = np.where(l @ axis > 0, across / (1 + np.abs(l @ axis)), 1 - l @ axis) / _cap(lit)
    return np.where(drop <= 1 + 1e-4, _cell(np.stack([turn, drop], axis=-1)), -1), np.ones(len(l)), np.ones(len(l))


def _met_flat(lit: Lit, l: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: E741
    part, t, facing = np.full(len(l), -1), np.ones(len(l)), np.zeros(len(l))
    for number, (m, x, y, n) in enumerate(lit.faces()):
        cosine = -(l @ n)
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (np.subtract(m, lit.seen_from) @ n) / -cosine
        p = np.array(lit.seen_from) + far[:, None] * l - m
        at = np.stack([p @ x / (x @ x), p @ y / (y @ y)], axis=-1)
        on = (cosine > 0) & (far > 0) & (np.abs(at) <= 1 + 1e-5).all(axis=1)
        part = np.where(on, number * CELLS[0] * CELLS[1] + _cell((at + 1) / 2), part)
        t, facing = np.where(on, far, t), np.where(on, cosine, facing)
    return part, t, facing


def _met_disk(lit: Lit, l: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: E741
    x, y, z = (np.array(edge) for edge in lit.edges)
    cosine = -(l @ z) / np.linalg.norm(z)
    far = np.subtract(lit.middle, lit.seen_from) @ z / np.where(l @ z == 0, np.inf, l @ z)
    p = np.array(lit.seen_from) + far[:, None] * l - lit.middle
    a, b = p @ x / (x @ x), p @ y / (y @ y)
    at = np.stack([np.arctan2(b, a) / (2 * np.pi) % 1, a * a + b * b], axis=-1)
    on = (cosine > 0) & (far > 0) & (at[:, 1] <= 1 + 1e-4)
    return np.where(on, _cell(at), -1), far, cosine


def _met_tube(lit: Lit, l: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: E741
    x, y, z = (np.array(edge) for edge in lit.edges)
    radius = float(np.linalg.norm(x))
    units = np.stack([x / radius, y / radius])
    o, d = units @ np.subtract(lit.seen_from, lit.middle), l @ units.T
    a, b, c = (d**2).sum(axis=1), d @ o, float(o @ o) - radius**2
    root = np.sqrt(np.maximum(b * b - a * c, 0))
    far = (-b - lit.side * root) / np.maximum(a, 1e-300)  # from outside the nearer point, from inside the farther
    out = (o + far[:, None] * d) / radius
    height = (np.subtract(lit.seen_from, lit.middle) @ z + far * (l @ z)) / (z @ z)
    facing = -lit.side * (d * out).sum(axis=1)
    at = np.stack([np.arctan2(out[:, 1], out[:, 0]) / (2 * np.pi) % 1, height], axis=-1)
    on = (facing > 0) & (far > 0) & (height >= -1e-5) & (height <= 1 + 1e-5) & (b * b - a * c >= -1e-6)
    return np.where(on, _cell(at), -1), far, facing
