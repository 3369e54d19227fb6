"""`harness check`: somebody's shader as it is, its contract, its faults, and whether it is right on a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import CacheOption, DeviceOption, SizeOption, open_store, parse_size
from harness.cli.output import JsonOption, log, print_json, progress
from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.diagnosis.stranger import Judged
    from harness.estimators.shader import Shader
    from harness.scene import SceneFile
    from harness.shader.contract import Contract
    from harness.strangers.findings import Findings

# Pixels of the film that a shader is judged on unless somebody says otherwise.
WIDTH = 64
FilesArgument = Annotated[list[Path], typer.Argument(help="The shader's files, or a folder of them.",
                                                     show_default=False)]
ValueOption = Annotated[list[str] | None, typer.Option(
    "--set", metavar="NAME=VALUE", help="What a uniform is: a number, several with commas, a role (frame, time, …), or "
                                        "what a sampler reads (self, noise, file:PATH); may be given several times.")]


def check(
    files: FilesArgument,
    scene: Annotated[str | None, typer.Option("--scene", metavar="SCENE", help="The Mitsuba scene that it shows: a "
                                              "file, or the name of a bundled one.")] = None,
    host: Annotated[str | None, typer.Option("--host", help="The dialect, if its syntax does not tell it.")] = None,
    values: ValueOption = None,
    contract: Annotated[Path | None, typer.Option("--contract", metavar="FILE", help="A contract.toml, in place of "
                                                  "what would be read from the files.")] = None,
    size: SizeOption = None,
    budget: Annotated[float, typer.Option("--budget", min=0.5, max=86400.0, help="Seconds for its frames.")] = 60.0,
    tolerance: Annotated[float | None, typer.Option("--tolerance", min=1e-9, max=1.0, show_default=False, help=(
        "Bias, relative to the mean, that still counts as equivalent."))] = None,
    cache: CacheOption = True,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> int:
    """Judge somebody's shader as it is: how its frames are joined, its random numbers, its faults; on a scene, its
    picture.

    It runs in a process of its own, with limits on time and memory. Exit status 1 when something is wrong with it.

    Example: `harness check homework.frag --scene spheres`
    """
    from harness.cli.options import require_memory
    from harness.estimators.shader import Shader, require_known

    given = parse_values(values or ())
    shader = Shader(tuple(files), host, tuple(sorted(given.items())), _contract(contract, files))
    read = shader.read()
    require_known(read)
    file = None if scene is None else _scene(scene, size, read)
    if file is not None:
        require_memory(file)
        shader.check(file)
    found = _experiments(shader, read, file, size)
    judged = None
    if file is not None and not _hopeless(found):
        from harness.diagnosis.stranger import judge_stranger

        judged = judge_stranger(_completed(shader, found), file, store=open_store(cache), budget=budget,
                                tolerance=tolerance, encoding=found.encoding, progress=progress)
        # Here the causes are asked for, of a verdict that no transform explains: judged.found against judged.reference
        # on judged.scene (harness.diagnosis.causes).
    if json:
        print_json(as_json(found, judged))
    else:
        for line in lines(found, judged):
            print(line)
    if file is None and not json:
        log("note: give --scene SCENE to have its picture judged too")
    return 1 if found.faults or (judged is not None and judged.outcome != "pass") else 0


def lines(found: Findings, judged: Judged | None) -> list[str]:
    """All that was found out, for a reader."""
    told = [_paragraph(found)]
    told += [f"{one.severity}: {one.where + ': ' if one.where else ''}{one.told}" for one in found.found]
    told.append(f"accumulation: {found.accumulation.outcome}: {found.accumulation.told}")
    if judged is not None:
        from harness.diagnosis.stranger import told as of

        first, *others = of(judged)
        told += [f"estimator: {first}", *(f"  {line}" for line in others)]
    return told


def as_json(found: Findings, judged: Judged | None) -> dict[str, Any]:
    """The same as plain data."""
    contract = found.contract
    report: dict[str, Any] = {
        "contract": {"host": contract.host, "passes": [one.name for one in contract.passes],
                     "radiance": contract.radiance, "law": contract.law, "samples": contract.samples,
                     "notes": contract.notes, "said": contract.said},
        "law": found.law_told, "findings": found.found,
        "accumulation": {"outcome": found.accumulation.outcome, "told": found.accumulation.told,
                         "exact": found.accumulation.exact, "weights": found.accumulation.weights}}
    if judged is not None:
        error, low, high = judged.verdict.luminance
        report["estimator"] = {
            "outcome": judged.outcome, "reason": judged.verdict.reason, "transform": judged.transform, "error": error,
            "low": low, "high": high, "slope": judged.slope, "offset": judged.offset, "frames": judged.frames,
            "reference": judged.integrator, "note": judged.note,
            "worst": {name: getattr(judged.worst, name)
                      for name in ("x", "y", "tile", "channel", "error", "low", "high")}}
    return report


def _paragraph(found: Findings) -> str:
    """The contract in a paragraph."""
    contract = found.contract
    passes = ", ".join(one.name for one in contract.passes)
    parts = [f"host {contract.host}; passes: {passes}; radiance in '{contract.radiance}'", found.law_told]
    if contract.samples > 1:
        parts.append(f"{contract.samples} samples a frame")
    return "; ".join([*parts, *contract.notes])


def _experiments(shader: Shader, read: Contract, file: SceneFile | None, size: str | None) -> Findings:
    from harness.strangers.experiment import SIZE, experiment
    from harness.strangers.process import Process

    width, height = parse_size(size)
    film = (width, height) if width and height and file is None else SIZE
    with Process(shader.limits) as process, progress(None, f"{shader.name} experiments"):
        return experiment(read, process, film)


def _completed(shader: Shader, found: Findings) -> Shader:
    from dataclasses import replace

    return replace(shader, contract=found.contract)


def _hopeless(found: Findings) -> bool:
    """Whether there is nothing to hold against a reference."""
    from harness.strangers.experiment import HOPELESS

    return any(found.has(kind) for kind in HOPELESS)


def _scene(word: str, size: str | None, read: Contract) -> SceneFile:
    """The scene at the size asked for, at the author's own, or at a small one of the film's shape."""
    from harness.scene import SceneFile

    path = Path(word)
    file = SceneFile(path) if path.is_file() else SceneFile.bundled(word)
    width, height = parse_size(size)
    if width and height:
        return file.sized(width, height)
    if read.size:
        return file.sized(*read.size)
    film = file.film
    return file.sized(WIDTH, max(1, round(WIDTH * film.height / film.width)))


def _contract(path: Path | None, files: Sequence[Path]) -> Contract | None:
    if path is None:
        return None
    from harness.shader import contract_file

    return contract_file.load(path, files)


def parse_values(words: Sequence[str]) -> Mapping[str, Any]:
    """What --set says: numbers, truth values, or a word."""
    given: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not (name.strip() and equals and value.strip()):
            raise HarnessError(f"--set: expected NAME=VALUE, such as samples=4; found '{word}'")
        given[name.strip()] = _value(value.strip())
    return given


def _value(text: str) -> Any:
    if text in ("true", "false"):
        return text == "true"
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return text
    if len(numbers) > 1:
        return numbers
    return int(numbers[0]) if text.lstrip("+-").isdecimal() else numbers[0]
