"""Whether a pdf integrates to 1, and the quadrature by which other checks know what to expect."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.checks.domains import Domain, Sphere, midpoints
from harness.checks.finding import Finding

# Rows and columns of midpoints over a domain; good to 1e-6 for what is smooth in the domain's coordinates, and to 1e-3
# for what jumps inside it.
MIDPOINTS = (2000, 250)
# Of a pdf's integral.
TOLERANCE = 1e-3


def quadrature(function: Callable[[np.ndarray], np.ndarray], domain: Domain,
               points: tuple[int, int] = MIDPOINTS) -> np.ndarray:
    """∫ f over a domain by midpoints; f takes directions (N, 3) and returns (N,) or (N, C): a number, or (C,)."""
    at = midpoints(*points)
    values = np.asarray(function(domain.forward(at)), dtype=np.float64)
    return np.asarray((values.T * domain.jacobian(at)).T.mean(axis=0))


def integral(pdf: Callable[[np.ndarray], np.ndarray], domain: Domain | None = None, *,
             points: tuple[int, int] = MIDPOINTS, tolerance: float = TOLERANCE) -> Finding:
    """Whether a density per steradian integrates to 1 over `domain`, by default the whole sphere."""
    value = float(quadrature(pdf, domain or Sphere(), points))
    passed = bool(abs(value - 1) <= tolerance)
    return Finding("integral", value, 1.0, passed, f"the pdf integrates to {value:.6g}, expected 1 ± {tolerance:g}",
                   error=tolerance)
