"""Proofs of single components: does a sampler follow its pdf, does a pdf integrate to 1, is a frame orthonormal?

An image says that something is wrong; these say which function. None of them knows of shaders or scenes: each takes
plain functions of NumPy arrays and returns a `Finding`. To test a sampler and its pdf of your own:

    from harness import checks
    found = checks.chi2(sample, pdf)
    assert found.passed, found.sentence

where `sample(u)` turns uniform numbers (N, 2) into unit directions (N, 3), and `pdf(d)` is their density per steradian,
(N,). `checks.integral(pdf)` says whether that integrates to 1, `checks.weight` whether f cos / pdf has the right mean,
`checks.frame` whether a frame is orthonormal, `checks.distinct` and `checks.independent` judge random numbers. Where a
check fails, `found.histogram.write("directions.png")` shows where. Directions may crowd about an axis: `checks.Crowded`
has small cells there. `checks.shader` makes such functions of a shader's library.

After Mitsuba 3's chi2.py: domains map the unit square to where samples lie, adapters wrap what is under test.
"""

from harness.checks.chi2 import chi2
from harness.checks.domains import Crowded, Domain, Lobe, Sphere
from harness.checks.finding import LEVEL, Finding, Histogram, shared_level
from harness.checks.frame import defects, frame
from harness.checks.integral import integral, quadrature
from harness.checks.random import correlation, distinct, distinct_share, independent
from harness.checks.weight import weight

__all__ = ["LEVEL", "Crowded", "Domain", "Finding", "Histogram", "Lobe", "Sphere", "chi2", "correlation", "defects",
           "distinct", "distinct_share", "frame", "independent", "integral", "quadrature", "shared_level", "weight"]
