"""Gates files: what they mean, and that whatever is wrong with one is refused in one line with file and line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.estimators.constant import Constant
from harness.estimators.coupled import Coupled
from harness.estimators.images import Images
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.files import data_dir
from harness.gates import load_gates
from harness.gates.lines import lines
from harness.scene import SceneFile
from harness.stats.levels import family_level
from harness.stats.verdicts import Tolerance
from tests.support.gates import GATES, one_gate, write

MINIMAL = """[[gate]]
name = "a"
scene = "spheres"
strategy = "mixture"
reason = "Why not."
"""


def refused(folder: Path, text: str) -> str:
    """The message about a gates file, less the folder; one line."""
    path = write(folder, text)
    with pytest.raises(HarnessError) as caught:
        load_gates(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{path}:")
    return message.removeprefix(f"{folder}/")


class TestMeaning:
    """What becomes of a file that is right."""

    def test_a_minimal_gate_has_the_defaults_of_the_harness(self, tmp_path: Path) -> None:
        gate = one_gate(tmp_path, MINIMAL)
        assert gate.scene == SceneFile(data_dir("mitsuba_scenes") / "spheres.xml")
        assert (gate.test, gate.strategy, gate.reason) == (Tracer("mixture"), "mixture", "Why not.")
        assert gate.tolerance == Tolerance()
        assert (gate.reference, gate.reference_spp) == (Mitsuba(), 32)
        assert gate.pass_level == pytest.approx(0.05)
        assert gate.not_finite == 0.0
        assert gate.origin == f"{tmp_path / 'gates.toml'}:1"

    def test_samples_of_the_reference_may_be_spread_evenly(self, tmp_path: Path) -> None:
        gate = one_gate(tmp_path, MINIMAL + 'reference = { spp = 36, sampler = "multijitter" }\n')
        assert (gate.reference, gate.reference_spp) == (Mitsuba(sampler="multijitter"), 36)

    def test_a_sampler_of_its_own_draws_both_sides_of_a_coupled_gate(self, tmp_path: Path) -> None:
        gate = one_gate(tmp_path, MINIMAL + 'sampler = "sobol"\n')
        assert (gate.test, gate.reference) == (Tracer("mixture", sampler="sobol"), Mitsuba())
        gate = one_gate(tmp_path, MINIMAL + 'sampler = "sobol"\nreference = { coupled = true }\n')
        assert gate.reference == Coupled("mixture", "sobol")

    def test_a_list_of_strategies_makes_a_gate_of_each(self, tmp_path: Path) -> None:
        file = load_gates(write(tmp_path, MINIMAL.replace('"mixture"', '["uniform", "mixture"]')))
        assert {gate.name: gate.strategy for gate in file.gates} == {"a-uniform": "uniform", "a-mixture": "mixture"}

    def test_the_family_shares_its_false_alarms(self, tmp_path: Path) -> None:
        text = "[suite]\nfalse_alarms = 0.05\n" + MINIMAL.replace('"mixture"', '["uniform", "cosine", "mixture"]')
        file = load_gates(write(tmp_path, text + MINIMAL.replace('"a"', '"b"')))
        assert file.false_alarms == 0.05
        assert {gate.fail_level for gate in file.gates} == {family_level(0.05, 4)}

    def test_a_gates_own_values_win_over_the_files_defaults(self, tmp_path: Path) -> None:
        text = "[defaults]\nspp = 7\nsize = [20, 10]\ntolerance = { fine = 0.9, coarse = 0.5 }\n" + MINIMAL
        gate = one_gate(tmp_path, text + "spp = 9\ntolerance.coarse = 0.3\nconfidence = 0.9\nnot_finite = 0.5\n")
        assert (gate.spp, gate.scene.size) == (9, (20, 10))
        assert gate.tolerance == Tolerance(Tolerance().mean, 0.3, 0.9)
        assert gate.pass_level == pytest.approx(0.1)
        assert gate.not_finite == 0.5

    def test_files_are_found_beside_the_gates_file(self, tmp_path: Path) -> None:
        (tmp_path / "own").mkdir()
        for name in ("truth.exr", "own.frag"):
            (tmp_path / name).touch()
        gate = one_gate(tmp_path, MINIMAL.replace('"spheres"', '"sky.xml"')
                        + 'reference = { file = "truth.exr" }\nshader = "own.frag"\nglsl = "own"\n')
        assert gate.scene == SceneFile(tmp_path / "sky.xml")
        assert gate.reference == Images((tmp_path / "truth.exr",))
        assert gate.test == Tracer("mixture", shader=tmp_path / "own.frag", folder=tmp_path / "own")

    def test_a_closed_form_is_a_colour(self, tmp_path: Path) -> None:
        assert one_gate(tmp_path).reference == Constant((0.5, 0.5, 0.5))

    def test_gates_are_chosen_by_their_name_or_their_entrys(self, tmp_path: Path) -> None:
        file = load_gates(write(tmp_path, MINIMAL.replace('"mixture"', '["uniform", "mixture"]')
                                + MINIMAL.replace('"a"', '"b"')))
        assert [gate.name for gate in file.select([])] == ["a-uniform", "a-mixture", "b"]
        assert [gate.name for gate in file.select(["b", "a-mixture"])] == ["a-mixture", "b"]
        assert [gate.name for gate in file.select(["a"])] == ["a-uniform", "a-mixture"]
        with pytest.raises(HarnessError, match="no gate is called 'c'; choose from a-uniform, a-mixture, b"):
            file.select(["c"])


class TestRefusals:
    """Bad input: file, line, what was found, what is allowed."""

    @pytest.mark.parametrize(("text", "message"), [
        ("x = \n", "gates.toml:1: malformed TOML: Invalid value"),
        ("\n[[gate]\n", "gates.toml:2: malformed TOML: Expected ']]' at the end of an array declaration"),
        ('a = 1\nb = "', "gates.toml:2: malformed TOML: Unterminated string"),
        ("", "gates.toml:1: no gate in this file; add a [[gate]] with name, scene, strategy and reason"),
        ("[gate]\n", "gates.toml:1: 'gate' must be an array of tables: begin each with [[gate]]"),
        ("gates = 1\n", "gates.toml:1: unknown key 'gates'; allowed: suite, defaults, coupled, gate"),
        ("[suite]\n\nfalse_alarms = 1\n", "gates.toml:3: 'false_alarms' must be a number above 0 and below 0.5, found"),
        ("[suite]\nname = 1\n", "gates.toml:2: unknown key 'name'; allowed: false_alarms"),
        ("\n[defaults]\nname = 'x'\n", "gates.toml:3: unknown key 'name'; allowed: strategy, tolerance"),
        ("defaults = 3\n", "gates.toml:1: 'defaults' must be a table, found 3"),
    ])
    def test_of_the_file(self, tmp_path: Path, text: str, message: str) -> None:
        assert refused(tmp_path, text).startswith(message)

    @pytest.mark.parametrize(("key", "line", "message"), [
        ('scene = "sphere"', 3, "unknown scene 'sphere'; name an .xml file, or one of "),
        ('scene = "typo.xml"', 3, "no such file: 'typo.xml'; paths are relative to gates.toml"),
        ("scene = 3", 3, "'scene' must be a text, found 3"),
        ('strategy = "metropolis"', 4, "unknown strategy 'metropolis'; choose from uniform, cosine, phong, lobes"),
        ("strategy = []", 4, "expected one or more strategies, each once, found []"),
        ('strategy = ["cosine", "cosine"]', 4, "expected one or more strategies, each once"),
        ('name = "../a"', 2, "a gate's name becomes that of a folder"),
        ('reason = " "', 5, "'reason' must be a text, found ' '"),
        ('sampler = "halton"', 6, "unknown sampler 'halton'; choose from independent, sobol"),
        ("tolerence = 0.1", 6, "unknown key 'tolerence'; allowed: name, scene, strategy, reason, tolerance"),
        ("tolerance = 0.1", 6, "'tolerance' must be a table, found 0.1"),
        ("tolerance = { mean = 0 }", 6, "'mean' must be a number above 0 up to 1, found 0"),
        ("tolerance = { mean = -0.1 }", 6, "'mean' must be a number above 0"),
        ("tolerance = { mean = 1.5 }", 6, "'mean' must be a number above 0 up to 1, found 1.5"),
        ("tolerance = { fine = 11 }", 6, "'fine' must be a number above 0 up to 10, found 11"),
        ("tolerance = { tile = 0.1 }", 6, "unknown key 'tile'; allowed: mean, coarse, fine"),
        ("[gate.tolerance]\nmean = 0.002\n\ncoarse = 0.001", 9,
         "contradictory tolerances: 'coarse' (0.001), of a part of the image, is below 'mean' (0.002)"),
        ("tolerance = { mean = 0.9 }", 6, "contradictory tolerances: 'coarse' ("),
        ("replicas = 4", 6, "a budget of 4 replicas is too small to decide: the first look, at a 4th of it, must tell "
                            "its own variance; 64 would do"),
        ("replicas = 70", 6, "must be a multiple of 4, found 70"),
        ("replicas = 1000", 6, "'replicas' must be a whole number from 1 to 256, found 1000"),
        ("spp = 0", 6, "'spp' must be a whole number from 1 to"),
        ("spp = 1.5", 6, "'spp' must be a whole number from 1 to"),
        ("spp = true", 6, "'spp' must be a whole number from 1 to"),
        ("size = [0, 3]", 6, "expected [width, height], each 1 to 1024, found [0, 3]"),
        ("size = 64", 6, "expected [width, height]"),
        ("max_depth = 0", 6, "'max_depth' must be a whole number from 1 to 1024, found 0"),
        ("max_depth = 2.0", 6, "'max_depth' must be a whole number from 1 to 1024, found 2.0"),
        ("max_depth = 1025", 6, "'max_depth' must be a whole number from 1 to 1024, found 1025"),
        ('scene = "scenes/plates"', 3, "unknown scene 'scenes/plates'; name an .xml file, or one of "),
        ("confidence = 95", 6, "'confidence' must be a number above 0.5 and below 1, found 95"),
        ("confidence = nan", 6, "'confidence' must be a number"),
        ("not_finite = 1", 6, "'not_finite' must be a number from 0 and below 1, found 1"),
        ("reference = { spp = 4, value = [1, 1, 1] }", 6, "expected one of { spp = 32 }, "),
        ('reference = { spp = 4, sampler = "metropolis" }', 6, "Mitsuba has no sampler 'metropolis'; choose from i"),
        ('reference = { sampler = "multijitter" }', 6, "expected one of { spp = 32 }, "),
        ('reference = { value = [1, 1, 1], sampler = "multijitter" }', 6, "expected one of { spp = 32 }, "),
        ("reference = { value = [1, -1, 1] }", 6, "expected [red, green, blue], each zero or more, found [1, -1, 1]"),
        ('reference = { file = "typo.exr" }', 6, "no such file: 'typo.exr'"),
        ('shader = "typo.frag"', 6, "no such file: 'typo.frag'"),
        ('glsl = "gates.toml"', 6, "no such folder: 'gates.toml'"),
    ])
    def test_of_a_gate(self, tmp_path: Path, key: str, line: int, message: str) -> None:
        name = key.partition(" ")[0]
        kept = [key if text.startswith(f"{name} =") else text for text in MINIMAL.splitlines()]
        text = "\n".join(kept if key in kept else [*kept, key])
        assert refused(tmp_path, text).startswith(f"gates.toml:{line}: {message}")

    @pytest.mark.parametrize("key", ["name", "scene", "reason"])
    def test_of_a_gate_that_lacks_a_key_points_to_the_gate(self, tmp_path: Path, key: str) -> None:
        text = "".join(line for line in MINIMAL.splitlines(keepends=True) if not line.startswith(key))
        assert refused(tmp_path, f"# one\n\n{text}") == f"gates.toml:3: '{key}' is missing"

    def test_of_a_default_points_to_the_default(self, tmp_path: Path) -> None:
        assert refused(tmp_path, "[defaults]\nsize = 'x'\nreplicas = 8\n" + MINIMAL + "size = [4, 4]\n").startswith(
            "gates.toml:3: a budget of 8 replicas")

    def test_of_a_name_given_twice_tells_both_places(self, tmp_path: Path) -> None:
        assert refused(tmp_path, MINIMAL + MINIMAL) == (
            f"gates.toml:6: gate 'a': the name is taken by {tmp_path / 'gates.toml'}:1; choose another")

    @pytest.mark.parametrize(("content", "message"), [
        (None, "the gates file cannot be read"), (b"\xff", "not UTF-8 text")])
    def test_of_what_is_no_text(self, tmp_path: Path, content: bytes | None, message: str) -> None:
        path = tmp_path / "gates.toml"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(HarnessError, match=f"{path}: {message}"):
            load_gates(path)
        with pytest.raises(HarnessError, match=f"{tmp_path}: a folder, not a gates file"):
            load_gates(tmp_path)


class TestLines:
    """Where keys stand, whatever hides a bracket or a line's end."""

    TEXT = '''# [[gate]]
a = """
b = 1
[c]
"""  # "
"d e" = [ # ]
  1,
  { x = "]" } ]
[t] # not x
a.b = 'it # is'
[[gate]]
k = 1
[gate.sub]
k = 2
[[gate]]
k = [
  ["u"],
  ['t']]
[[gate]]
k = { l = 3 }
[other."x.y"]
z = 1
'''

    @pytest.mark.parametrize(("way", "line"), [
        (("a",), 2), (("b",), 1), (("d e",), 6), (("t",), 9), (("t", "x"), 9), (("t", "a"), 10), (("t", "a", "b"), 10),
        (("gate",), 11), (("gate", 0), 11), (("gate", 0, "k"), 12), (("gate", 0, "sub"), 13),
        (("gate", 0, "sub", "k"), 14), (("gate", 1), 15), (("u",), 1), (("gate", 1, "k"), 16), (("gate", 1, "l"), 15),
        (("gate", 2), 19), (("gate", 2, "k", "l"), 20), (("other", "x.y", "z"), 22), ((), 1),
    ])
    def test_of_a_key(self, way: tuple[str | int, ...], line: int) -> None:
        tomllib.loads(self.TEXT)
        assert lines(self.TEXT).line(*way) == line


def test_the_default_suite_is_right(tmp_path: Path) -> None:
    file = load_gates(Path(__file__).parents[1] / "gates.toml")
    assert file.false_alarms == 0.01
    covered = {gate.scene.path for gate in file.gates}
    folder = data_dir("mitsuba_scenes")
    assert covered == {*folder.glob("*.xml"), *folder.glob("traps/*.xml")}


def test_a_depth_is_the_gates_own_or_that_of_all(tmp_path: Path) -> None:
    second = GATES.partition("[[gate]]")[2].replace('"sky"', '"shallow"')
    text = GATES.replace("[defaults]", "[defaults]\nmax_depth = 5") + f"\n[[gate]]{second}\nmax_depth = 1\n"
    assert [gate.scene.max_depth for gate in load_gates(write(tmp_path, text)).gates] == [5, 1]
    assert one_gate(tmp_path).scene.max_depth is None


def test_the_example_of_the_tests_is_right(tmp_path: Path) -> None:
    assert one_gate(tmp_path, GATES).name == "sky"


def test_a_byte_order_mark_and_windows_lines_are_taken(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + GATES.replace("\n", "\r\n").encode())
    gate, = load_gates(path).gates
    assert gate.origin == f"{path}:8"
