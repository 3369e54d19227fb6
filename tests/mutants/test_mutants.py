"""The catalogue of seeded bugs: well formed, applicable to the shader as it is, and some of them run against gates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Self

import pytest

from harness.errors import HarnessError
from harness.files import data_dir
from harness.gpu.context import Program
from harness.mutants import runner
from harness.mutants.autopsy import wrong_functions
from harness.mutants.catalogue import Mutant, choose, load_catalogue, mutated
from harness.mutants.judge import ENOUGH
from harness.mutants.matrix import KillMatrix, as_json
from harness.mutants.memory import Memory
from harness.mutants.runner import MODULE_FOLDERS, Gates, run_mutants
from harness.shader.library import GENERATED, OURS

CATALOGUE = load_catalogue()
TESTS = Path(__file__).parents[1]
ENTRY = """[[mutant]]
id = "a"
file = "lib/phong.glsl"
line = "return m.kd;"
replacement = "return m.ks;"
imitates = "one coefficient for the other"
origin = "this test"
killer = "test_phong"
"""
GATES = f"""[[gate]]
name = "convex"
scene = "{data_dir('mitsuba_scenes').as_posix()}/furnace_convex.xml"
strategy = "cosine"
size = [24, 24]
spp = 8
replicas = 64
tolerance = {{ mean = 0.02, coarse = 0.1, fine = 0.5 }}
reason = "a small image that tells large errors"
"""


def write(folder: Path, text: str) -> Path:
    """A catalogue of one file."""
    (folder / "topic.toml").write_text(text, encoding="utf-8")
    return folder


class TestCatalogue:
    """The data."""

    def test_holds_eighty_mutants_of_every_part_of_the_shader(self) -> None:
        assert len(CATALOGUE) >= 80
        files = {f"lib/{path.name}" for path in (data_dir("glsl") / "lib").glob("*.glsl")}
        missing = files - {mutant.file for mutant in CATALOGUE}
        # What is declared alone has no line to get wrong that would compile.
        assert missing <= {"lib/trigonometry.glsl", "lib/interface.glsl"}, "a part of the library without a mutant"
        assert {"path_tracer.frag", "display.frag"} <= {mutant.file for mutant in CATALOGUE}

    @pytest.mark.parametrize("mutant", CATALOGUE, ids=lambda mutant: mutant.id)
    def test_applies_to_the_shader_as_it_is(self, mutant: Mutant) -> None:
        """Its line is there once, and afterwards no other line has changed."""
        original = (data_dir("glsl") / mutant.file).read_text(encoding="utf-8")
        changed = dict(mutated(mutant).assembled(mutant.file, {GENERATED: ""}).files)[mutant.file].splitlines()
        assert sum(a != b for a, b in zip(original.splitlines(), changed, strict=True)) == 1

    def test_names_tests_that_exist(self) -> None:
        modules = {path.stem for folder in MODULE_FOLDERS for path in (TESTS / folder).glob("test_*.py")}
        assert {mutant.killer for mutant in CATALOGUE if mutant.killer.startswith("test_")} <= modules

    def test_a_macro_is_wrong_in_what_uses_it(self) -> None:
        mutant, = choose(CATALOGUE, ["met-unweighted"])
        assert wrong_functions(mutant) == ("trace_samples",)

    def test_is_chosen_from_by_id_and_topic(self) -> None:
        assert choose(CATALOGUE, []) == CATALOGUE
        assert {mutant.topic for mutant in choose(CATALOGUE, ["random"])} == {"random"}
        assert [mutant.id for mutant in choose(CATALOGUE, ["jitter-off"])] == ["jitter-off"]
        with pytest.raises(HarnessError, match=r"unknown mutant 'jiter'; give ids, or topics: .*camera"):
            choose(CATALOGUE, ["jiter"])


@pytest.mark.parametrize(("text", "message"), [
    ("", r"topic\.toml:1: expected \[\[mutant\]\] tables and nothing else, found nothing"),
    ("[[mutant]]\nid = 'a", r"topic\.toml:2: not TOML"),
    (ENTRY.replace("origin", "source"), r"topic\.toml:1: unknown key 'source' of a mutant; allowed: id, file"),
    (ENTRY.replace('origin = "this test"', ""), r"topic\.toml:1: a mutant needs 'origin'"),
    (ENTRY.replace('"this test"', '" "'), r"topic\.toml:1: a mutant needs 'origin', a text that is not empty"),
    (ENTRY.replace("m.ks;", "m.kd;"), r"topic\.toml:1: the replacement of mutant 'a' is the line itself"),
    (ENTRY + "\n" + ENTRY, r"topic\.toml:10: the id 'a' is taken by .*topic\.toml:1"),
])
def test_malformed_catalogues_are_refused(tmp_path: Path, text: str, message: str) -> None:
    """With the file and the line of the entry."""
    with pytest.raises(HarnessError, match=message):
        load_catalogue(write(tmp_path, text))


def test_an_empty_folder_is_no_catalogue(tmp_path: Path) -> None:
    with pytest.raises(HarnessError, match="no mutants there"):
        load_catalogue(tmp_path)


@pytest.mark.parametrize(("old", "new", "message"), [
    ("return m.kd;", "return m.kq;", r"mutant 'a' does not apply: its line is not in lib/phong\.glsl: `return m\.kq;`"),
    ("return m.kd;", "{", r"does not apply: its line occurs \d+ times in lib/phong\.glsl: `\{`"),
    ("lib/phong.glsl", "lib/fong.glsl", r"does not apply: no shader file 'lib/fong\.glsl'"),
])
def test_a_mutant_that_does_not_apply_is_an_error(tmp_path: Path, old: str, new: str, message: str) -> None:
    """The shader has changed, and the catalogue has to follow."""
    mutant, = load_catalogue(write(tmp_path, ENTRY.replace(old, new)))
    with pytest.raises(HarnessError, match=message):
        mutated(mutant)


def test_the_defect_is_in_its_library_and_nowhere_else(tmp_path: Path) -> None:
    """A whole library, whose other shaders compile; what comes with the harness stays as it is."""
    mutant, = load_catalogue(write(tmp_path, ENTRY))
    library = mutated(mutant)
    assert "return m.ks;" in library.assembled("lib/phong.glsl").text
    Program(library.assembled("display.frag")).release()
    assert "return m.ks;" not in OURS.assembled("lib/phong.glsl").text


@pytest.fixture(scope="module")
def gates(tmp_path_factory: pytest.TempPathFactory) -> Gates:
    """One gate, and the test modules of this repository."""
    file = tmp_path_factory.mktemp("gates") / "gates.toml"
    file.write_text(GATES, encoding="utf-8")
    return Gates.of(file, TESTS)


def seeded(**changes: str) -> Mutant:
    """A mutant that the gate should kill."""
    values = {"id": "x", "file": "lib/path.glsl", "line": "throughput = vec3(1.0);", "imitates": "i", "origin": "o",
              "replacement": "throughput = vec3(1.1);", "killer": "convex", "where": "here.toml:1", **changes}
    return Mutant(**values)


@pytest.fixture(scope="module")
def matrix(gates: Gates) -> KillMatrix:
    """Three that die by different gates, one only by all its looks, one that is tolerated, one that nothing can see,
    and one that the gate's shader leaves out: it would not compile."""
    chosen = [mutant for mutant in CATALOGUE if mutant.id in ("display-gamma", "seed-without-replica")]
    return run_mutants([
        seeded(), *chosen, seeded(id="as large as the tolerance", replacement="throughput = vec3(1.02);"),
        seeded(id="half the tolerance", replacement="throughput = vec3(1.01);"),
        seeded(id="y", file="lib/motion.glsl", replacement="float path_time = 0.0;",
               line="float path_time;  // the moment at which the current path sees the scene"),
        seeded(id="z", line="ray.weight *= throughput;", replacement="ray.weight *= nothing_of_this_name;")], gates)


class TestRun:
    """Real mutants, a small gate and a fast test module, in a process of their own."""

    def test_gates_kill_what_they_can_see(self, matrix: KillMatrix) -> None:
        killers = {mutant.id: [gate for gate, state in zip(matrix.gates, row, strict=True) if state == "killed"]
                   for mutant, row in zip(matrix.mutants, matrix.cells, strict=True)}
        assert killers["x"] == ["convex"]
        assert killers["display-gamma"] == ["test_display"]
        # The image gate sees it as well: replicas without variance cannot agree with anything.
        assert killers["seed-without-replica"] == ["convex", "test_random"]
        # At a glance it does not fail; but it cannot pass.
        assert killers["as large as the tolerance"] == ["convex"]
        assert killers["half the tolerance"] == killers["y"] == killers["z"] == []

    def test_what_does_not_change_a_pixel_is_told_from_what_survives(self, matrix: KillMatrix) -> None:
        states = {mutant.id: dict(zip(matrix.gates, row, strict=True))
                  for mutant, row in zip(matrix.mutants, matrix.cells, strict=True)}
        assert states["display-gamma"]["convex"] == "untouched"
        assert states["y"] == states["z"] == {**dict.fromkeys(matrix.gates, "not run"), "convex": "untouched"}

    def test_survivors_and_idle_gates_are_named(self, matrix: KillMatrix) -> None:
        assert [mutant.id for mutant in matrix.survivors] == ["half the tolerance", "y", "z"]
        assert matrix.idle == matrix.missed == ()
        assert list(as_json(matrix)["survivors"]) == ["half the tolerance", "y", "z"]

    def test_gates_are_asked_until_enough_have_killed_it(self, tmp_path: Path) -> None:
        """Which, differs between mutants, but the one that is expected to is always among them."""
        names = [f"gate-{number}" for number in range(ENOUGH + 3)]
        (tmp_path / "many.toml").write_text("".join(GATES.replace('"convex"', f'"{name}"') for name in names), "utf-8")
        many = Gates.of(tmp_path / "many.toml", TESTS)
        kills: dict[str, set[str]] = {}
        for full in (False, True):
            found = run_mutants([seeded(id=each, killer="gate-5") for each in ("a", "c")], many, full=full,
                                store=tmp_path)
            for mutant, row in zip(found.mutants, found.cells, strict=True):
                kills[f"{mutant.id}{full}"] = {gate for gate, state in zip(many.names, row, strict=True)
                                               if state == "killed"}
        assert kills["aTrue"] == kills["cTrue"] == set(names)
        assert {len(kills["aFalse"]), len(kills["cFalse"])} == {ENOUGH}
        assert "gate-5" in kills["aFalse"] & kills["cFalse"] and kills["aFalse"] != kills["cFalse"]

    def test_a_mutant_that_does_not_compile_is_an_error(self, gates: Gates) -> None:
        with pytest.raises(HarnessError, match=r"here\.toml:1: mutant 'x' does not compile: lib/path\.glsl:\d+: "):
            run_mutants([seeded(replacement="throughput = 1.1;")], gates)

    def test_a_gate_that_fails_with_the_right_shader_is_an_error(self, tmp_path: Path) -> None:
        """It would kill everything."""
        wrong = GATES.replace("tolerance =", "reference = { value = [2.0, 2.0, 2.0] }\ntolerance =")
        (tmp_path / "wrong.toml").write_text(wrong, encoding="utf-8")
        with pytest.raises(HarnessError, match=r"wrong\.toml:\d+: gate 'convex' does not pass with the shader as"):
            run_mutants([seeded()], Gates.of(tmp_path / "wrong.toml", TESTS))

    def test_what_was_judged_is_kept_and_read_back(self, gates: Gates, tmp_path: Path,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
        """One that is already known is not judged again, nor is a gate checked for it; a damaged one is no answer."""
        monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
        first = run_mutants([seeded()], gates, store=tmp_path / "batches")

        class Idle:
            def __enter__(self) -> Self:
                return self

            def __exit__(self, *error: object) -> None:
                pass

            def map(self, work: object, items: Iterable[object]) -> Iterator[object]:
                assert list(items) == [], "judged again"
                return iter(())

        monkeypatch.setattr(runner, "executor", lambda *arguments: Idle())
        assert run_mutants([seeded()], gates, store=tmp_path / "batches") == first
        memory = Memory((), gates.file, ())
        assert memory.recall(seeded()) is None, "other gates"
        kept, = (tmp_path / "mutants").iterdir()
        kept.write_text('{"convex": "kill', encoding="utf-8")
        with pytest.raises(AssertionError, match="judged again"):
            run_mutants([seeded()], gates, store=tmp_path / "batches")

    def test_a_mutant_that_names_no_gate_is_an_error(self, gates: Gates) -> None:
        with pytest.raises(HarnessError, match="mutant 'x' names the gate 'konvex', which does not exist; choose"):
            run_mutants([seeded(killer="konvex")], gates)
