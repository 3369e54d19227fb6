"""Every check that a shader's library allows, function by function: what `harness check-library` asks of one's files.

The functions are those of glsl/lib/ with somebody's files in place of ours. They are asked in the order in which they
build on each other, so the first that fails is the one to mend: what comes after may fail by it. A generator whose
samples follow a sequence, a basis of one's own, another distribution with its own pdf are no errors, and none is found.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path

from harness.checks import own_environment, own_lights, own_phong, own_random, own_sampling
from harness.checks.finding import Finding
from harness.checks.shader import Probe, probe_of
from harness.errors import HarnessError, ShaderError
from harness.shader.functions import Function, functions
from harness.shader.library import Library
from harness.shader.own_files import own_library

# The probes of a topic, the first of which tells what files they take up; and its checks.
Checks = Callable[[Probe], Iterator[Finding]]
TOPICS: Mapping[str, tuple[str, Checks]] = {
    "random numbers": ("random.frag", own_random.findings),
    "frames": ("basis.frag", own_sampling.frames_of),
    "sampling": ("sampling.frag", own_sampling.findings),
    "light sampling": ("light_sampling.frag", own_lights.findings),
    "the environment map": ("environment_sampling.frag", own_environment.findings),
    "the BRDF and its strategies": ("phong.frag", own_phong.findings),
}


@dataclass(frozen=True, eq=False)
class Proofs:
    """What the checks of a library found, in the order in which its functions build on each other.

    `unchecked`: topics that could not be asked, each with the reason. `shared`: functions of the library that all that
    failed call, where that is more than one.
    """

    findings: tuple[Finding, ...]
    unchecked: tuple[str, ...]
    shared: tuple[str, ...] = ()

    @property
    def failed(self) -> tuple[Finding, ...]:
        """The first of each function and check that failed."""
        first: dict[tuple[str, str], Finding] = {}
        for found in self.findings:
            if not found.passed:
                first.setdefault((found.function, found.check), found)
        return tuple(first.values())

    @property
    def functions(self) -> tuple[str, ...]:
        """Those that were asked about."""
        return tuple(dict.fromkeys(found.function for found in self.findings))


def check_library(folder: Path, advance: Callable[[float], None] | None = None) -> Proofs:
    """Check the functions of a folder of shader files that stand in for ours of the same name.

    `advance(1)` is told of each of TOPICS. HarnessError for a folder without such files, or with none that is checked;
    ShaderError where one does not compile.
    """
    if not folder.is_dir():
        raise HarnessError(f"'{folder}' is not a folder; give one that holds lib/sampling.glsl, for example")
    library = own_library(None, folder)
    own = {file.shown for file in library.files}
    topics = {name: topic for name, topic in TOPICS.items()
              if own & {file for file, _ in library.probe(topic[0]).files}}
    if not topics:
        files = sorted({file for probe, _ in TOPICS.values() for file, _ in Library().probe(probe).files
                        if file.startswith("lib/")})
        raise HarnessError(f"'{folder}' holds none of the files whose functions are checked: {', '.join(files)}; "
                           "`harness autopsy --library` looks at the others")
    return checked(library, topics, advance)


def checked(library: Library, topics: Sequence[str] | Mapping[str, object] = tuple(TOPICS),
            advance: Callable[[float], None] | None = None) -> Proofs:
    """The checks of these topics on a library, ours or any other. ShaderError where a file of it does not compile."""
    found: list[Finding] = []
    unchecked: list[str] = []
    texts: dict[str, str] = {}
    probe = probe_of(library)
    for name in topics:
        main, checks = TOPICS[name]
        defined = functions(library.probe(main))
        texts |= {function: each.text for function, each in defined.items()}
        try:
            found += [_placed(each, defined) for each in checks(probe)]
        except ShaderError as error:
            # Where the probe itself does not compile, the library's functions are others, or take something else.
            if not str(error).startswith("probes/"):
                raise
            unchecked.append(f"{name}: its functions do not fit ({error}); keep the names and the parameters of ours")
        if advance:
            advance(1)
    return Proofs(tuple(found), tuple(unchecked), _shared(texts, {each.function for each in found if not each.passed}))


def _shared(texts: Mapping[str, str], failed: Set[str]) -> tuple[str, ...]:
    """The functions that several functions, by their texts, all call."""
    called = [{name for name in texts if name != function and re.search(rf"\b{name}\s*\(", texts.get(function, ""))}
              for function in failed]
    return tuple(sorted(set.intersection(*called))) if len(called) > 1 else ()


def _placed(found: Finding, defined: Mapping[str, Function]) -> Finding:
    """The finding with the place where its function is defined, file:line."""
    function = defined.get(found.function)
    return replace(found, where=f"{function.file}:{function.line}" if function else "")
