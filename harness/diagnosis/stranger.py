"""Is a stranger's shader right on a scene? The reference, the verdict, and whether a transform explains what differs.

The reference is drawn twice: by Mitsuba's `path`, and by `bsdf_path`, which samples no lights. Where they differ it is
`path` that errs (rays to a light end before its surface by a part of the scene's size, and light leaks past what lies
in between), and the verdict uses the latter.
"""

from __future__ import annotations

import re
import time
from contextlib import nullcontext
from dataclasses import dataclass, replace

import numpy as np

from harness.diagnosis.causes.match import Seen, fit
from harness.diagnosis.causes.transforms import fitted, inner_pixels
from harness.diagnosis.pixels import PART, USUAL, View, find_spread, find_turn
from harness.errors import SceneError
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.shader import Shader, ShaderRenderer
from harness.policy import FALSE_ALARMS, tolerance_for, tolerances
from harness.progress import Progress, quiet
from harness.samples.estimate import Accumulator, Batch, Estimate, luminance, with_luminance
from harness.samples.store import Store
from harness.scene import SceneFile, load
from harness.scene.footprint import BOX, Footprint
from harness.stats.findings import TileFinding, summarised
from harness.stats.levels import Looks
from harness.stats.sequential import Looking
from harness.stats.tiles import TileAccumulator, TileSamples, tile_means, tile_size
from harness.stats.verdicts import BiasVerdict, Tolerance, bias_verdict
from harness.strangers.process import Process
from harness.strangers.single import Encoding
from harness.work.run import Run, reference_run

# Samples per pixel of the reference, of each of the two integrators, for an image of `REFERENCE_PIXELS` pixels; smaller
# images get more.
REFERENCE_SPP, REFERENCE_PIXELS = 4096, 64 * 48
MOST_SPP = 1 << 16
# Batches that a shader's frames are drawn in, and the shares of them at which the verdict looks.
BATCHES, SHARES = 64, (8, 4, 2, 1)
# Frames of a batch, and of all: beyond, their numbers are larger than authors ever try.
LEAST_RUN, MOST_RUN = 4, 2048
# Frames by which the time of one is measured.
TIMED_FRAMES = 4
# A machine may become slower than it was: when so many times the budget has passed, no further look is begun.
OVERDUE = 1.5
# Relative errors that float32 sums of exact answers have.
ROUNDING = 1e-4
# Lights that nothing hits, so that only `path` finds them.
HIDDEN_LIGHTS = ("point", "spot", "directional", "directionalarea", "projector", "collimated")
# Depth at which paths without a bound are cut for `bsdf_path`, which needs one.
DEEP = 64
# A factor without a name is no slip of a contract: too much albedo looks like that too.
_ANY_FACTOR = re.compile(r"\ba factor of (?!2$|4$)[\d.e+-]+$")
# Encodings that are tried on frames whose mean stays below this: encoded values end at 1.
ENCODED_MAX = 1.05


@dataclass(frozen=True, eq=False)
class Reference:
    """What is held against: the run, the integrator's name, and a sentence where the other one was not used."""

    run: Run
    integrator: str
    note: str = ""


@dataclass(frozen=True, eq=False)
class Judged:
    """The verdict on a shader's single frames.

    `verdict`: of the picture as it is. `transform`: what it was put through, in words, where undoing it makes it agree,
    else ''. `slope`, `offset`: of the straight line through the tiles' luminance against the reference's. `worst`: the
    tile furthest off. `found`, `reference`: both pictures, for whoever goes on to look for a cause.
    """

    scene: SceneFile
    verdict: BiasVerdict
    transform: str
    slope: float
    offset: float
    worst: TileFinding
    found: Estimate
    reference: Estimate
    integrator: str
    note: str
    frames: int
    seconds: float
    compared: tuple[Estimate, Estimate]
    view: View = USUAL

    @property
    def outcome(self) -> str:
        """pass, fail or inconclusive."""
        return self.verdict.outcome

    @property
    def is_right(self) -> bool:
        """The mean passes and nothing fails: of two thousand tiles a few stay undecided for long, as in a study."""
        return _is_right(self.verdict)


def _is_right(verdict: BiasVerdict) -> bool:
    return verdict.outcome == "pass" or (verdict.outcome == "inconclusive" and verdict.mean.outcome == "pass")


def judge_stranger(shader: Shader, scene: SceneFile, *, store: Store | None = None, budget: float = 60.0,
                   tolerance: float | None = None, encoding: Encoding = "", spp: int | None = None,
                   frames: int | None = None, transforms: bool = True, view: View | None = None,
                   process: Process | None = None, progress: Progress = quiet) -> Judged:
    """Hold a shader's single frames against Mitsuba's picture of the scene.

    `budget`: seconds for the shader's frames; the verdict is told as soon as it is certain. `encoding`: what the
    experiments found frames to be put through. `spp`: samples per pixel of the reference, enough for the film if None.
    `frames`: of each of its batches, instead of what fits into the budget. `transforms`: whether to ask what a picture
    that fails was put through, which way up it is and how its rays are spread about their pixels; `view`: what is known
    of that: it is judged so, and nothing is asked. `process`: draws all of it, and goes on afterwards; one of its own
    if None. Raises as the estimators do.
    """
    # One for all that is drawn: to start it takes longer than many a batch.
    with nullcontext(process) if process else Process(shader.limits) as held:
        return _judged(shader, scene, held, store, budget, tolerance, encoding, spp, frames, transforms, view, progress)


def _judged(shader: Shader, scene: SceneFile, process: Process, store: Store | None, budget: float,
            tolerance: float | None, encoding: Encoding, spp: int | None, frames: int | None, transforms: bool,
            view: View | None, progress: Progress) -> Judged:
    """See `judge_stranger`."""
    allowed = tolerance_of(scene, tolerance)
    began = time.perf_counter()
    with shader.open(scene, process) as renderer:  # first: it is the likelier to fail
        run = frames or _frames_of_a_batch(renderer, budget)
        shader = replace(shader, run=run, contract=renderer.contract)  # whose law need not be measured again
    held = reference(scene, allowed, spp=spp, store=store, footprint=view.footprint if view else BOX,
                     progress=progress)
    images, verdict = _drawn(shader, process, scene, held, allowed, budget, progress, view or USUAL)
    transform, compared = "", (_estimate(images, run), held.run.estimate())
    if verdict.outcome == "fail" and transforms and view is None:
        # First what is done to each frame: of it no transform of the mean is the inverse.
        transform = (_encoded(shader, process, scene, held, allowed, images, encoding)
                     or _transformed(images, run, scene, held, spp, store, progress))
        if not transform:
            view, seen = _view(images, run, scene, held, spp, store, progress)
            if not view.is_usual:  # judged once more, for what failed did so at the first look
                again, usual = _drawn(shader, process, scene, replace(held, run=seen), allowed, budget, progress, view)
                compared = _estimate(again, run), seen.estimate()
                if _is_right(usual):
                    parts = (view.turn, view.spread.defect.says if view.spread else "")
                    transform = f"the picture is right but for {' and '.join(part for part in parts if part)}"
    estimate = _estimate(images, run)
    slope, offset = _line(estimate.mean, held.run.estimate().mean, verdict.fine.tile)
    return Judged(scene, verdict, transform, slope, offset, _worst(verdict), estimate, held.run.estimate(),
                  held.integrator, held.note, len(images) * run, time.perf_counter() - began, compared, view or USUAL)


def reference(scene: SceneFile, tolerance: Tolerance, *, spp: int | None = None, store: Store | None = None,
              footprint: Footprint = BOX, progress: Progress = quiet) -> Reference:
    """Mitsuba's `path`, unless `bsdf_path` shows that it leaks light; `footprint`: how its rays are spread about their
    pixels."""
    run = _mitsuba(scene, "path", spp, store, progress, footprint)
    if reason := _hidden_light(scene):
        return Reference(run, "path", reason)
    other = _mitsuba(scene, "bsdf_path", spp, store, progress, footprint)
    verdict = bias_verdict(run.tiles(), other.tiles(), tolerance, fail_level=FALSE_ALARMS)
    if verdict.outcome != "fail":
        return Reference(run, "path")
    error, low, high = verdict.luminance
    return Reference(other, "bsdf_path", (
        f"Mitsuba's path and bsdf_path differ by {error:+.2%} ({low:+.2%} to {high:+.2%}) in the mean: path leaks "
        "light past what is close to a light, so the reference is bsdf_path"))


def tolerance_of(scene: SceneFile, asked: float | None) -> Tolerance:
    """The tolerance that was asked for, or that the noise of the scene allows."""
    if asked is not None:
        return tolerances(asked)
    try:
        return tolerance_for(load(scene))[0]
    except SceneError:  # a scene that only Mitsuba understands
        return Tolerance()


def _spp(scene: SceneFile) -> int:
    film = scene.film
    return min(MOST_SPP, max(256, REFERENCE_SPP * REFERENCE_PIXELS // (film.width * film.height)))


def _mitsuba(scene: SceneFile, integrator: str, spp: int | None, store: Store | None, progress: Progress,
             footprint: Footprint = BOX) -> Run:
    """So many samples of an integrator."""
    depth = DEEP if integrator == "bsdf_path" and scene.depth is None else None
    with Mitsuba(integrator, depth, footprint=footprint).open(scene) as renderer:
        samples = spp or _spp(scene)
        run = reference_run(renderer, samples, store)
        replicas = -(-samples // run.spp)
        with progress(replicas * run.spp, f"{scene.name} {integrator}") as advance:
            run.grow(replicas, advance)
    return run


def _hidden_light(scene: SceneFile) -> str:
    """Why `bsdf_path` would not see all light; empty where it does."""
    kinds = {str(node.props.plugin_name()) for node in scene.parsed().nodes} & set(HIDDEN_LIGHTS)
    return (f"the scene has a light that no path hits ({', '.join(sorted(kinds))}), so bsdf_path was not asked"
            if kinds else "")


def _frames_of_a_batch(renderer: ShaderRenderer, budget: float) -> int:
    """So many that all batches fit into the budget."""
    renderer.render_batch(0, 0, 1)  # in which drivers compile
    began = time.perf_counter()
    renderer.render_batch(0, 1, TIMED_FRAMES)
    each = (time.perf_counter() - began) / TIMED_FRAMES
    return int(np.clip(budget / (BATCHES * each), LEAST_RUN, MOST_RUN))


def _drawn(shader: Shader, process: Process, scene: SceneFile, held: Reference, tolerance: Tolerance, budget: float,
           progress: Progress, view: View) -> tuple[np.ndarray, BiasVerdict]:
    """Batches of frames, (B, H, W, 3), and the verdict, at the look that decided. Where the budget ends before all
    looks the last verdict stands. `view`: how they are turned."""
    counts = [BATCHES // share for share in SHARES]
    looking = Looking(Looks(tuple(shader.run * count for count in counts)), tolerance, FALSE_ALARMS)
    images: list[np.ndarray] = []
    began = time.perf_counter()
    truth = held.run.estimate().mean
    with shader.open(scene, process) as renderer, progress(BATCHES * shader.run, shader.name) as advance:
        state = renderer.state()[..., None]  # what is no radiance is neither right nor wrong
        for look, count in enumerate(counts):
            while len(images) < count:
                image = renderer.render_batch(len(images), 0, shader.run, advance).mean
                images.append(view.turned(np.where(state, view.turned(truth), image)))
            verdict = looking.decide(look, samples_of(np.stack(images), shader.run), held.run.tiles())
            if verdict.outcome != "inconclusive" or time.perf_counter() - began > OVERDUE * budget:
                break
    return np.stack(images).astype(np.float64), verdict


def samples_of(images: np.ndarray, frames: int) -> TileSamples:
    """Batches of `frames` samples, (B, H, W, 3), as tiles."""
    tiles = TileAccumulator(tile_size(*images.shape[1:3]))
    for image in images:
        tiles.add(with_luminance(image), frames)
    return tiles.samples()


def _transformed(images: np.ndarray, run: int, scene: SceneFile, held: Reference, spp: int | None,
                 store: Store | None, progress: Progress) -> str:
    """What the picture was put through after it was right: a factor, a curve, a flip, a shift by half a pixel, for
    which the reference is needed at twice the size."""
    film = scene.film
    # Four of its pixels make one: a quarter of the samples in each will do.
    double = scene.sized(2 * film.width, 2 * film.height)
    fine = _mitsuba(double, held.integrator, (spp or _spp(scene)) // 4 or 1, store, progress).estimate()
    found, truth = Seen.of(_estimate(images, run)), Seen.of(held.run.estimate())
    if fit(found, truth, inner_pixels(truth.mean.shape)).same:  # all that is off lies where shifts would lose pixels
        return ""
    for one in fitted(found, truth, Seen.of(fine)):
        if one.fit.same and not _ANY_FACTOR.search(one.says):
            return f"the picture is right but for {one.says}"
    return ""


def _view(images: np.ndarray, run: int, scene: SceneFile, held: Reference, spp: int | None, store: Store | None,
          progress: Progress) -> tuple[View, Run]:
    """How the picture has to be looked at, and the reference as its rays see it."""
    def seen(footprint: Footprint) -> Estimate:
        part = (spp or _spp(scene)) // PART or 1
        return _mitsuba(scene, held.integrator, part, store, progress, footprint).estimate()

    truth = held.run.estimate()
    view = View(find_turn(images.mean(axis=0), truth.mean))
    upright = np.stack([view.turned(image) for image in images])
    view = replace(view, spread=find_spread(_estimate(upright, run), truth, seen))
    return view, _mitsuba(scene, held.integrator, spp, store, progress, view.footprint) if view.spread else held.run


def _encoded(shader: Shader, process: Process, scene: SceneFile, held: Reference, tolerance: Tolerance,
             images: np.ndarray, found: Encoding) -> str:
    """Frames that are encoded before they are averaged, decoded one by one."""
    if not found and images.mean(axis=0).max() > ENCODED_MAX:
        return ""
    names = {"gamma": "x^(1/2.2)", "sqrt": "a square root", "srgb": "sRGB"}
    tried: tuple[Encoding, ...] = (found,) if found else ("gamma", "sqrt", "srgb")
    for encoding in tried:
        with replace(shader, encoding=encoding).open(scene, process) as renderer:
            decoded = np.stack([renderer.render_batch(k, 0, shader.run).mean for k in range(BATCHES // SHARES[1])])
        # No tile fails any more, and the mean does not either.
        if bias_verdict(samples_of(decoded.astype(np.float64), shader.run), held.run.tiles(), tolerance,
                        fail_level=FALSE_ALARMS).outcome != "fail":
            return f"each frame is encoded ({names[encoding]}) before it is averaged, and right otherwise"
    return ""


def _estimate(images: np.ndarray, run: int) -> Estimate:
    accumulator = Accumulator()
    for image in images:
        accumulator.add(Batch(image, run))
    return accumulator.estimate()


def _worst(verdict: BiasVerdict) -> TileFinding:
    """The tile furthest off: of the larger ones where those fail, of the smaller ones else. What rounding made of exact
    answers is none."""
    tiles = verdict.coarse if verdict.coarse.outcome == "fail" else verdict.fine
    return summarised(replace(tiles, z=np.where(np.abs(tiles.error) < ROUNDING, 0.0, tiles.z)))


def _line(found: np.ndarray, truth: np.ndarray, tile: int) -> tuple[float, float]:
    """Slope and offset of found = slope truth + offset over tiles, by least squares; no offset where truth is flat."""
    x, y = (tile_means(luminance(image)[..., None], tile).ravel() for image in (truth, found))
    if np.ptp(x) < 1e-6 * abs(x.mean()) or not np.isfinite(y).all():
        return (float(y.mean() / x.mean()) if x.mean() else float("nan")), 0.0
    slope, offset = np.polyfit(x, y, 1)
    return float(slope), float(offset)




def told(judged: Judged) -> list[str]:
    """The verdict in lines: outcome, size and sign, slope, worst tile, and what explains it."""
    error, low, high = judged.verdict.luminance
    worst = judged.worst
    seen = "right as far as its noise shows, the mean passes and no tile fails" if judged.is_right else judged.outcome
    lines = [f"{judged.outcome if judged.outcome == 'pass' else seen}: {judged.verdict.reason}",
             f"mean luminance {error:+.3%} ({low:+.3%} to {high:+.3%}) against Mitsuba's {judged.integrator}, from "
             f"{judged.frames} frames; slope {judged.slope:.4f}, offset {judged.offset:+.3g}",
             f"worst tile: x {worst.x} to {worst.x + worst.tile}, y {worst.y} to {worst.y + worst.tile}: "
             f"{worst.channel} {worst.error:+.2%} ({worst.low:+.2%} to {worst.high:+.2%})"]
    if judged.view.turn:
        lines.append(f"it resembles the reference with {judged.view.turn}, and was turned before it was looked at more "
                     "closely")
    if spread := judged.view.spread:
        lines.append(f"its edges are as of {spread.defect.says}: {spread.left:.0%} of what they are off by is left")
    if judged.transform:
        lines.append(judged.transform)
    if judged.outcome == "inconclusive":
        lines.append("more frames would decide the rest: give a larger --budget, or a wider --tolerance")
    if judged.note:
        lines.append(f"note: {judged.note}")
    return lines
