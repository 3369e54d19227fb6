"""The memory of judged mutants: an interrupted run goes on where it was, and one where nothing changed is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, cast, get_args

from harness.errors import StoreError
from harness.files import cache_dir
from harness.gates import Gate
from harness.mutants.catalogue import Mutant, mutated
from harness.mutants.matrix import State
from harness.samples import json
from harness.samples.keys import code_digest, digest, folder_digest
from harness.shader.library import OURS
from harness.work.provenance import versions

States = dict[str, State]
# What decides is `judge`; `runner` decides which gates there are.
JUDGE = "harness.mutants.judge"


class Memory:
    """What every gate said of a mutant, by all that it depends on: the mutant's library and ours, the gates with their
    scenes, the tests that are gates with all that supports them, the code, and the versions."""

    def __init__(self, gates: Sequence[Gate], file: Path, tests: Sequence[Path]) -> None:
        """`gates`: those of `file` that are run; `tests`: folders whose modules are gates, or support those."""
        self._folder = cache_dir() / "mutants"
        self._common = {"gates": file.read_text(encoding="utf-8"), "ours": OURS.digest, "versions": versions(),
                        "scenes": {gate.name: gate.scene.hash for gate in gates}, "code": code_digest(JUDGE),
                        "tests": [folder_digest(folder, ".py", ".toml") for folder in tests]}

    def recall(self, mutant: Mutant, *, full: bool = False) -> States | None:
        """What was kept of it; None where there is nothing, or nothing that can be read. What all gates were asked
        (`full`) answers also where fewer need be."""
        for each in (True, False)[:1 if full else 2]:
            with suppress(StoreError):
                return json.load(self._path(mutant, full=each), _states, what="what gates said of a mutant",
                                 mend="it is judged again")
        return None

    def keep(self, mutant: Mutant, states: Mapping[str, State], *, full: bool = False) -> None:
        """A cache that cannot be written costs only time."""
        with suppress(StoreError):
            json.save(self._path(mutant, full=full), states)

    def _path(self, mutant: Mutant, *, full: bool) -> Path:
        key = {**self._common, "mutant": mutated(mutant).digest, "file": mutant.file, "killer": mutant.killer,
               "id": mutant.id, "full": full}
        return self._folder / f"{digest(key, 24)}.json"


def _states(held: Any) -> States:
    """ValueError for a state that is none."""
    if not set(held.values()) <= set(get_args(State)):
        raise ValueError("a state that is none")
    return cast(States, {str(name): state for name, state in held.items()})
