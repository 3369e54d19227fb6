"""The numbers of the sampler `sobol` in drjit: glsl/samplers/sobol.glsl, written out a second time (see `draws`).

The state is an array of two components: what seeds the scrambles of the next call, and the sample's index with its
bits reversed.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

MULTIPLIER, INCREMENT, PERMUTATION = 747796405, 2891336453, 277803737  # PCG's, as in lib/random.glsl
# The step that mixes the digits of an index: Vegdahl 2021, "Building a Better LK Hash".
MIX = 0x05526C56
# By how much each step of Pascal's triangle modulo 2 shifts, and the digits that it changes.
PASCAL = ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF))


def seed_sample(stream: tuple[Any, Any], index: Any) -> Any:
    """The state with which sample number `index` of a stream begins."""
    import drjit as dr

    pair = import_module(type(stream[0]).__module__).Array2u
    return pair(stream[0], dr.brev(type(stream[0])(index)))


def rand(state: Any) -> tuple[Any, Any]:
    """A number in [0, 1) of 24 bits, and the state after it."""
    shift, factor, after = _seeds(state)
    return _fraction(_shuffled(state.y, shift, factor)), after


def rand2(state: Any) -> tuple[Any, Any, Any]:
    """Two numbers that are spread evenly over the square, and the state after them."""
    import drjit as dr

    before, hashed, after = _seeds(state)
    digits = dr.brev(_shuffled(state.y, before, hashed))
    upper = hashed >> 16
    first = _scrambled(digits, hashed, before >> 16)
    second = _scrambled(_second_digits(digits), before ^ upper, upper)
    return _fraction(dr.brev(first)), _fraction(dr.brev(second)), after


def _seeds(state: Any) -> tuple[Any, Any, Any]:
    """The generator's state, its output, and the state after the call."""
    before = state.x
    word = ((before >> ((before >> 28) + 4)) ^ before) * PERMUTATION
    return before, (word >> 22) ^ word, type(state)(before * MULTIPLIER + INCREMENT, state.y)


def _scrambled(digits: Any, shift: Any, factor: Any) -> Any:
    return (digits + shift) * (factor | 1)


def _shuffled(digits: Any, shift: Any, factor: Any) -> Any:
    digits = digits + shift
    digits = digits ^ (digits * MIX)
    return digits * (factor | 1)


def _second_digits(digits: Any) -> Any:
    for step, changed in PASCAL:
        digits = digits ^ ((digits >> step) & changed)
    return digits


def _fraction(digits: Any) -> Any:
    import drjit as dr

    float32: Any = dr.float32_array_t(type(digits))
    return float32(digits >> 8) * (1.0 / 16777216.0)
