"""The samplers, where a path's random numbers come from: their names, and what statistics may take for granted."""

from __future__ import annotations

from dataclasses import dataclass

from harness.errors import HarnessError
from harness.shader.library import Library

DEFAULT = "independent"
# The one that spreads a pixel's numbers evenly.
EVEN = "sobol"
# The file that samplers stand in for, function by function.
REPLACED = "lib/random.glsl"


@dataclass(frozen=True)
class Sampler:
    """Where a path's random numbers come from.

    `chunk`: the file under glsl/ whose functions stand in for those of lib/random.glsl, empty for these. `slopes`: what
    the root mean squared error of a pixel falls by with its number of samples, on double logarithmic axes, where pixels
    are smooth, hold edges, and hang on many numbers.
    `independent_batches`: whether the batches of one replica are independent of each other, so that their scatter is
    the noise of their mean; else only replicas are.
    """

    name: str
    slopes: tuple[float, float, float]
    chunk: str = ""
    independent_batches: bool = True


_ALL = (
    # Every number is drawn for itself, from a stream of integer hashes.
    Sampler(DEFAULT, (-0.5, -0.5, -0.5)),
    # The numbers of a pixel's samples are spread evenly, by Sobol's sequence in pairs, scrambled by hashes.
    Sampler(EVEN, (-1.0, -0.75, -0.5), "samplers/sobol.glsl", independent_batches=False),
)
SAMPLERS = tuple(sampler.name for sampler in _ALL)


def sampler_named(name: str) -> Sampler:
    """The sampler of this name. HarnessError for an unknown one."""
    for sampler in _ALL:
        if sampler.name == name:
            return sampler
    raise HarnessError(f"unknown sampler '{name}'; choose from {', '.join(SAMPLERS)}")


def named(strategy: str, sampler: str) -> str:
    """What an estimator of both is called: by its strategy alone where the sampler is the usual one."""
    return strategy if sampler == DEFAULT else f"{strategy} {sampler}"


def with_sampler(library: Library, name: str) -> Library:
    """The library with the numbers of this sampler.

    HarnessError for an unknown one, and where somebody's own file draws the numbers: it has no use for another.
    """
    sampler = sampler_named(name)
    if not sampler.chunk:
        return library
    for file in library.files:
        if file.name == REPLACED:
            raise HarnessError(f"'{file.shown}' draws the random numbers, and the sampler '{name}' would stand in its "
                               f"place; take the file away, or the sampler '{DEFAULT}'")
    return library.with_functions(sampler.chunk)
