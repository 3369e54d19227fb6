"""A bias verdict that draws until it is decided or its budget ends, its repeated looks paid for in the error rates."""

from __future__ import annotations

from dataclasses import dataclass, field

from harness.stats.bias import Outcome
from harness.stats.levels import Looks
from harness.stats.tiles import ImageMoments, TileSamples
from harness.stats.verdicts import BiasVerdict, Tolerance, bias_outcome, bias_verdict


@dataclass(frozen=True)
class Looking:
    """A gate's plan: when it looks, what it tolerates, and how often it may err over all its looks together.

    `fail_level`: the probability with which a good render fails at any look. `pass_level`: twice that with which a
    render passes that is off by a tolerance. Knows nothing of renderers: the caller draws up to `looks.samples[k]` of
    test (and of the reference, if it grows as well), and asks.
    """

    looks: Looks
    tolerance: Tolerance = field(default_factory=Tolerance)
    fail_level: float = 0.01
    pass_level: float = 0.05

    def decide(self, look: int, test: TileSamples, reference: TileSamples) -> BiasVerdict:
        """The verdict at look number `look`, from 0; final unless it is inconclusive and a look is left."""
        return bias_verdict(test, reference, self.tolerance, fail_level=self.looks.level(look, self.fail_level),
                            pass_level=self.looks.level(look, self.pass_level))

    def outcome(self, look: int, test: ImageMoments, reference: ImageMoments) -> Outcome:
        """That of `decide`, from moments and without the rest of the verdict."""
        return bias_outcome(test, reference, self.tolerance, fail_level=self.looks.level(look, self.fail_level),
                            pass_level=self.looks.level(look, self.pass_level))
