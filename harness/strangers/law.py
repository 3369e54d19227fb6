"""How a frame is joined to its past, found by drawing one and the same frame on doctored copies of that past.

All random numbers stay as they are, so what changes is exact: out = a past + b sample, and `a` is a difference
quotient. No line of the author's is read for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from harness.gpu.frames import Moment
from harness.shader.contract import Contract, Law, ShaderPass
from harness.strangers.single import Encoding, FrameSource, decoded

# Frames in the past when the weight of that past is looked at.
COUNTS = (1, 2, 3, 5, 8, 16)
# What the past is set to, all of it: three values, so that it shows whether the answer is linear.
LEVELS = (0.0, 0.25, 0.75)
# Difference quotients of float32 are exact to about 1e-6; the weights of neighbouring counts differ by 3e-3 at 16.
NEAR = 1e-3
# Most pixels must agree; of some, the sample may be clamped or not finite.
MOST = 0.6
# Counts that it takes to know a law by; at earlier ones the past may be thrown away.
LEAST = 3
# Pixels at the margins that are left alone, at most a third of the film: authors keep their state in corners.
MARGIN = 8
# Offsets from which frames of a mean may be counted.
OFFSETS = (0, 1, -1, 2, -2)
Count = Literal["frame", "uniform", "alpha", "inverse_alpha"]
ENCODINGS: tuple[Encoding, ...] = ("", "gamma", "sqrt", "srgb")


@dataclass(frozen=True)
class LawFound:
    """A law, in words and with what it was found from. `contract`: with roles put right that the experiment showed to
    be others. `shift`: where a pixel of the past comes back: '' in its place, else told."""

    law: Law
    told: str
    contract: Contract
    shift: str = ""
    alpha_step: float = 0.0


@dataclass(frozen=True)
class _At:
    """What was seen with `n` frames in the past: the past's weight by encoding (None where the answer is not linear in
    it), what alpha grew by and what 1 / alpha did, and whether the colour heeds alpha."""

    n: int
    weights: dict[Encoding, float | None]
    alpha_step: float
    inverse_step: float
    heeds_alpha: bool


def find_law(source: FrameSource) -> LawFound:
    """The law of the pass that holds radiance. Whether a host's weight is that of the new frame is for
    `weight_is_of_the_new` to say."""
    contract = source.contract
    one = radiance_pass(contract)
    if not any(channel.reads == "self" for channel in one.channels):
        return LawFound(Law("none"), "no sampler reads what it left: every frame stands alone", contract)
    seen = _look(source, COUNTS)
    law, told = _classified(seen, contract)
    shift = "" if law.kind == "none" else _shift(source)
    return LawFound(law, told, contract, shift, seen[-1].alpha_step)


def radiance_pass(contract: Contract) -> ShaderPass:
    """The pass whose output holds radiance. ValueError for a contract that names another."""
    for one in contract.passes:
        if one.name == contract.radiance:
            return one
    raise ValueError(f"no pass '{contract.radiance}'")


def with_weight_of_the_new(contract: Contract) -> Contract:
    """The contract with uniforms that were taken for the past's weight as the new frame's."""
    passes = tuple(replace(one, roles=tuple(
        (name, "new_weight" if role == "past_weight" else role) for name, role in one.roles))
        for one in contract.passes)
    return replace(contract, passes=passes)


def inner(size: tuple[int, int]) -> np.ndarray:
    """Which pixels are off the margins, (H, W) bool."""
    width, height = size
    mask = np.zeros((height, width), bool)
    mask[min(MARGIN, height // 3):, min(MARGIN, width // 3):] = True
    return mask


def weight_is_of_the_new(found: LawFound) -> bool:
    """Whether a host's weight was told of the wrong one: the past then has 1 / (n + 1)."""
    has = any(role == "past_weight" for one in found.contract.passes for _, role in one.roles)
    return has and len(found.law.measured) > 1 and all(abs(a - 1 / (n + 1)) < NEAR for n, a in found.law.measured)


def _look(source: FrameSource, counts: Sequence[int]) -> list[_At]:
    """Run the author's loop, and stop at each count to doctor the past."""
    contract, seen, done = source.contract, [], 0
    source.clear()
    for count in counts:
        while done < count:
            source.frame(Moment.of(contract.first_frame + done, done))
            done += 1
        held = {one.name: source.read(one.name) for one in contract.passes if not one.displays}
        seen.append(_at(source, held, count))
        for name, pixels in held.items():
            source.write(name, pixels)
    return seen


def _at(source: FrameSource, held: dict[str, np.ndarray], n: int) -> _At:
    contract = source.contract
    mask, base = inner(source.size), held[contract.radiance]

    def draw(past: np.ndarray) -> np.ndarray:
        for name, pixels in held.items():
            source.write(name, past if name == contract.radiance else pixels)
        source.frame(Moment.of(contract.first_frame + n, n))
        return source.read(contract.radiance).astype(np.float64)

    def level(value: float) -> np.ndarray:
        past = base.copy()
        past[mask, :3] = value
        return past

    out = [draw(level(value))[mask] for value in LEVELS]
    more = level(LEVELS[1])
    more[mask, 3] += 1.0
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        weights = {encoding: _weight([pixels[:, :3] for pixels in out], encoding) for encoding in ENCODINGS}
        alpha, before = out[1][:, 3], base[mask, 3].astype(np.float64)
        inverse = _median(1 / alpha - 1 / before)
        changed = np.nanmax(np.abs(draw(more)[mask, :3] - out[1][:, :3]), initial=0.0)
    return _At(n, weights, _median(alpha - before), inverse, bool(changed > 1e-6))


def _weight(out: Sequence[np.ndarray], encoding: Encoding) -> float | None:
    """The past's weight where the answer is linear in it once it is decoded, in most pixels."""
    levels = decoded(np.array(LEVELS), encoding)
    values = [decoded(pixels, encoding) for pixels in out]
    first, second = ((values[k + 1] - values[k]) / (levels[k + 1] - levels[k]) for k in range(2))
    weight = _median(second)
    if not np.isfinite(weight):
        return None
    close = (np.abs(first - weight) < 2 * NEAR) & (np.abs(second - weight) < 2 * NEAR)
    return weight if close.mean() > MOST else None


def _median(values: np.ndarray) -> float:
    """Of what is finite; NaN where nothing is."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def _classified(seen: Sequence[_At], contract: Contract) -> tuple[Law, str]:
    for encoding in ENCODINGS:
        weights = [at.weights[encoding] for at in seen]
        if any(weight is None for weight in weights):
            continue
        measured = tuple((at.n, float(weight)) for at, weight in zip(seen, weights, strict=True) if weight is not None)
        law = _kind(measured, encoding)
        count, how = _counted(seen, law, contract)
        law = replace(law, count=count)
        return law, f"{_told(law)}{how}; weight of the past with n frames in it: {_listed(measured)}"
    return Law("other"), ("the frame is not a linear function of its past, nor of a past kept encoded: it is clamped, "
                          "divided by a count, or tone-mapped before it is kept")


def _kind(measured: tuple[tuple[int, float], ...], encoding: Encoding) -> Law:
    weights = [a for _, a in measured]
    later = _after_zeros(measured)
    if all(abs(a) < NEAR for a in weights):
        return Law("none", measured=measured)
    if all(abs(a - 1) < NEAR for _, a in later):
        return Law("sum", encoding=encoding, measured=measured)
    for offset in OFFSETS:
        if all(abs(a - max(n + offset, 0) / max(n + offset + 1, 1)) < NEAR for n, a in later):
            return Law("mean", offset=offset, encoding=encoding, measured=measured)
    if all(abs(a - weights[-1]) < NEAR for _, a in later):
        return Law("blend", weight=weights[-1], encoding=encoding, measured=measured)
    return Law("other", encoding=encoding, measured=measured)


def _after_zeros(measured: tuple[tuple[int, float], ...]) -> tuple[tuple[int, float], ...]:
    """Without the first counts at which the past is thrown away, where enough are left to know a law by."""
    kept = next((k for k, (_, a) in enumerate(measured) if abs(a) >= NEAR), 0)
    return measured[kept:] if len(measured) - kept >= LEAST else measured


def _counted(seen: Sequence[_At], law: Law, contract: Contract) -> tuple[Count, str]:
    """Where the number of frames stands, and how that shows."""
    last = seen[-1]
    steps = [at.alpha_step for at in seen]
    if law.kind == "sum":
        if all(abs(step - steps[0]) < NEAR for step in steps) and steps[0] > 0.5:
            return "alpha", f", alpha counts its samples (+{steps[0]:g} a frame)"
        return "frame", ""
    if law.kind in ("mean", "other") and last.heeds_alpha:
        if abs(last.inverse_step - 1) < NEAR:
            return "inverse_alpha", ", its count kept in alpha as 1 / n"
        return "alpha", ", its count kept in alpha"
    roles = {role for one in contract.passes for _, role in one.roles}
    if law.kind == "mean" and roles & {"past_weight", "new_weight", "count"} and "frame" not in roles:
        return "uniform", ", its count given by the host"
    return "frame", ""


def _told(law: Law) -> str:
    kept = {"": "", "gamma": " kept as x^(1/2.2)", "sqrt": " kept as a square root", "srgb": " kept sRGB-encoded"}
    match law.kind:
        case "sum":
            return f"running sum{kept[law.encoding]}"
        case "mean":
            counted = f", frames counted from {law.offset + 1}" if law.offset else ""
            return f"running mean{kept[law.encoding]}{counted}"
        case "blend":
            return f"exponential average{kept[law.encoding]}: the past always has the weight {law.weight:.4g}"
        case "none":
            return "the past is ignored"
        case _:
            return "the weight of the past follows no rule that is known"


def _listed(measured: Sequence[tuple[int, float]]) -> str:
    return ", ".join(f"{n}: {a:.4f}" for n, a in measured)


def _shift(source: FrameSource) -> str:
    """Whether a bright pixel of the past comes back in its place, and there alone."""
    contract, (width, height) = source.contract, source.size
    n = COUNTS[-1]
    held = {one.name: source.read(one.name) for one in contract.passes if not one.displays}
    y, x = (height + height // 3) // 2, (width + width // 3) // 2

    def draw(bright: float) -> np.ndarray:
        for name, pixels in held.items():
            past = pixels.copy()
            if name == contract.radiance:
                past[inner(source.size), :3] = 0.25
                past[y, x, :3] += bright
            source.write(name, past)
        source.frame(Moment.of(contract.first_frame + n, n))
        return np.nan_to_num(source.read(contract.radiance)[..., :3].astype(np.float64))

    changed = np.argwhere(np.abs(draw(8.0) - draw(0.0)).max(axis=-1) > 1e-3)
    if len(changed) == 0:
        return "does not come back at all"
    if len(changed) > 1:
        return f"comes back spread over {len(changed)} pixels"
    dy, dx = (int(v) for v in changed[0] - (y, x))
    return "" if dx == dy == 0 else f"comes back {dx:+d} pixels to the right and {dy:+d} up"
