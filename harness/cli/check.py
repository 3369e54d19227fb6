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
    from harness.diagnosis.checked import Checked
    from harness.scene import SceneFile
    from harness.shader.contract import Contract
    from harness.strangers.findings import Findings

FilesArgument = Annotated[list[Path], typer.Argument(help="The shader's files, or a folder of them.",
                                                     show_default=False)]
ValueOption = Annotated[list[str] | None, typer.Option(
    "--set", metavar="NAME=VALUE", help="What a uniform is: a number, several with commas, a role (frame, time, …), or "
                                        "what a sampler reads (self, noise, file:PATH); may be given several times.")]
CausesOption = Annotated[bool, typer.Option("--causes/--no-causes", help="Look for the cause of what is wrong; "
                                            "the first time on a scene takes a minute or two.")]


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
    spp: Annotated[int | None, typer.Option("--reference-spp", min=64, max=1 << 20, show_default=False, help=(
        "Samples per pixel of the reference, instead of what the film needs."))] = None,
    causes: CausesOption = True,
    keep: Annotated[Path | None, typer.Option("--keep-contract", metavar="FILE", help="Write what was found out of how "
                                              "it is to be run as a contract.toml, which may be edited.")] = None,
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
    from harness.diagnosis.checked import check_shader, sized
    from harness.estimators.shader import Shader

    given = parse_values(values or ())
    shader = Shader(tuple(files), host, tuple(sorted(given.items())), _contract(contract, files))
    read = shader.read()
    width, height = parse_size(size)
    asked = (width, height) if width and height else None
    file = None if scene is None else sized(scene_file(scene), asked or read.size)
    if file is not None:
        require_memory(file)
    checked = check_shader(shader, file, size=asked if file is None else None,
                           store=open_store(cache), budget=budget, tolerance=tolerance, spp=spp, causes=causes,
                           progress=progress)
    if keep is not None:
        from harness.shader import contract_file

        contract_file.save(checked.found.contract, keep)
    if json:
        print_json(as_json(checked))
    else:
        for line in lines(checked):
            print(line)
    if file is None and not json:
        log("note: give --scene SCENE to have its picture judged too; `harness new-scene NAME` writes one to fill in")
    return 0 if checked.is_right else 1


def lines(checked: Checked) -> list[str]:
    """All that was found out, for a reader."""
    found, judged = checked.found, checked.judged
    told = [_paragraph(found)]
    told += [f"{one.severity}: {one.where + ': ' if one.where else ''}{one.told}" for one in found.found]
    told.append(f"accumulation: {found.accumulation.outcome}: {found.accumulation.told}")
    if checked.hopeless:
        told.append(f"estimator: not judged: {checked.hopeless}")
    if judged is not None:
        from harness.diagnosis.stranger import told as of

        first, *others = of(judged)
        told += [f"estimator: {first}", *(f"  {line}" for line in others)]
    if checked.diagnosis is not None:
        first, *others = checked.diagnosis.sentences
        told += [f"cause: {first}", *(f"  {line}" for line in others)]
    if checked.repaired is not None:
        told.append(f"proof: {checked.repaired.sentence}")
    return told


def as_json(checked: Checked) -> dict[str, Any]:
    """The same as plain data."""
    found, judged, contract = checked.found, checked.judged, checked.found.contract
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
            "outcome": judged.outcome, "right": judged.is_right, "reason": judged.verdict.reason,
            "transform": judged.transform, "error": error,
            "low": low, "high": high, "slope": judged.slope, "offset": judged.offset, "frames": judged.frames,
            "reference": judged.integrator, "note": judged.note, "turn": judged.view.turn,
            "spread": judged.view.spread and {"id": judged.view.spread.defect.id, "left": judged.view.spread.left},
            "worst": {name: getattr(judged.worst, name)
                      for name in ("x", "y", "tile", "channel", "error", "low", "high")}}
    if checked.diagnosis is not None:
        report["diagnosis"] = checked.diagnosis.as_json()
    if (proof := checked.repaired) is not None:
        report["repair"] = {"where": proof.where, "before": proof.before, "after": proof.after, "says": proof.says}
    return report


def _paragraph(found: Findings) -> str:
    """The contract in a paragraph."""
    contract = found.contract
    passes = ", ".join(one.name for one in contract.passes)
    parts = [f"host {contract.host}; passes: {passes}; radiance in '{contract.radiance}'", found.law_told]
    if contract.samples > 1:
        parts.append(f"{contract.samples} samples a frame")
    return "; ".join([*parts, *contract.notes])


def scene_file(word: str) -> SceneFile:
    """A scene by its file, or by the name of a bundled one. HarnessError for what is neither."""
    from harness.scene import SceneFile

    path = Path(word)
    return SceneFile(path) if path.is_file() else SceneFile.bundled(word)


def _contract(path: Path | None, files: Sequence[Path]) -> Contract | None:
    if path is None:
        return None
    from harness.shader import contract_file

    contract = contract_file.load(path, files)
    if warning := contract_file.stale(path, contract):
        log(f"warning: {warning}")
    return contract


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
