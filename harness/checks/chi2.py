"""Whether samples follow their pdf: Pearson's χ² over the cells of a domain."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import special

from harness.checks.domains import Domain, Sphere, midpoints
from harness.checks.finding import LEVEL, Finding, Histogram

# About what half an image of 1024² pixels takes for its first bounce.
COUNT = 1 << 18
# Rows and columns of cells: odd, so that no border falls together with a symmetry of what is tested, as the horizon.
CELLS = (51, 25)
# Midpoints along each side of a cell by which the pdf is integrated; as many for pdfs that jump inside a cell.
STEPS = 20
# Cells that expect fewer are joined: χ² is the limit of many.
LEAST = 5.0
NOTHING = 1e-9  # what divides where all cells together expect none

Sample = Callable[[np.ndarray], np.ndarray]  # uniform numbers (N, 2) to unit directions (N, 3)
Pdf = Callable[[np.ndarray], np.ndarray]  # unit directions (N, 3) to densities per steradian (N,)


def chi2(sample: Sample, pdf: Pdf, domain: Domain | None = None, *, count: int = COUNT,
         cells: tuple[int, int] = CELLS, steps: int = STEPS, level: float = LEVEL, seed: int = 0) -> Finding:
    """Judge `count` samples against their pdf, in rows and columns of cells of `domain`, by default the whole sphere.

    `sample` may draw numbers of its own, as long as it returns as many directions as it is given rows. Directions that
    are not finite, outside the domain, or in a cell where the pdf is zero fail at once, and so does a negative pdf.
    `value` is χ² per degree of freedom. Raises ValueError for directions of another shape.
    """
    domain = domain or Sphere()
    directions = np.asarray(sample(np.random.default_rng(seed).random((count, 2), dtype=np.float32)), dtype=np.float64)
    if directions.shape != (count, 3):
        raise ValueError(f"sample must return ({count}, 3) directions, found {directions.shape}")
    histogram = tabulate(directions, pdf, domain, cells, steps)
    wrong = int(count - histogram.observed.sum())
    strays = int(histogram.observed[histogram.expected == 0].sum())
    statistic, dof = pearson(histogram.observed.ravel(), histogram.expected.ravel())
    p = float(special.chdtrc(dof, statistic))
    valid = bool((histogram.expected >= 0).all())
    passed = wrong == 0 and strays == 0 and valid and p > level
    sentence = (f"χ² of {count:,} directions against their pdf is {statistic / dof:.3g} per degree of freedom "
                f"({dof:,} of them), p = {p:.2g}")
    if wrong:
        sentence += f"; {wrong:,} directions are not finite or outside the domain"
    if strays:
        sentence += f"; {strays:,} lie where the pdf is zero"
    if not valid:
        sentence += "; the pdf is negative or not a number somewhere"
    if not passed:
        sentence += f"; {histogram.worst}"
    return Finding("chi2", statistic / dof, 1.0, passed, sentence, p=p, histogram=histogram)


def tabulate(directions: np.ndarray, pdf: Pdf, domain: Domain, cells: tuple[int, int], steps: int) -> Histogram:
    """Counts of directions (N, 3) in cells, and what the pdf, integrated over each by midpoints, expects of N."""
    rows, columns = cells
    at = domain.backward(directions[np.isfinite(directions).all(axis=1)])
    inside = at[((at >= 0) & (at <= 1)).all(axis=1)]
    column, row = np.minimum((inside * [columns, rows]).astype(int), [columns - 1, rows - 1]).T
    observed = np.bincount(row * columns + column, minlength=rows * columns).reshape(rows, columns).astype(float)
    fine = midpoints(rows * steps, columns * steps)
    density = np.asarray(pdf(domain.forward(fine)), dtype=np.float64) * domain.jacobian(fine)
    share = density.reshape(rows, steps, columns, steps).mean(axis=(1, 3)) / (rows * columns)
    centers = domain.forward(midpoints(rows, columns)).reshape(rows, columns, 3)
    return Histogram(observed, share * len(directions), centers)


def pearson(observed: np.ndarray, expected: np.ndarray) -> tuple[float, int]:
    """χ² of counts (N,) and its degrees of freedom.

    Cells that expect less than LEAST are joined, the emptiest first, until each group expects more; what is left over
    joins the emptiest of the other cells.
    """
    order = np.argsort(expected)
    observed, expected = observed[order], expected[order]
    small = int((expected < LEAST).sum())
    starts, complete, group = [], True, 0.0
    for index in range(small):
        if complete:
            starts.append(index)
            group = 0.0
        group += float(expected[index])
        complete = group > LEAST
    others = range(small, len(expected))
    starts += others if complete else others[1:]
    observed, expected = np.add.reduceat(observed, starts), np.add.reduceat(expected, starts)
    return float(np.sum((observed - expected)**2 / np.maximum(expected, NOTHING))), max(len(expected) - 1, 1)
