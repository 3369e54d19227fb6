"""`harness gate`: verdicts and statuses, what is chosen, what is left behind, and what is refused before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.errors import MachineError
from tests.cli.conftest import Harness, refusal
from tests.support.gates import GATES, SKY, write

WRONG = GATES + """
[[gate]]
name = "wrong"
scene = "sky.xml"
strategy = ["cosine", "mixture"]
reference = { value = [0.5, 0.5, 0.51] }
reason = "The reference is 2 % off in blue."
"""


@pytest.fixture
def gates(here: Path) -> Path:
    """The gates file that the command takes by default, with one gate that is right."""
    (here / "tests").mkdir()
    return write(here / "tests")


def test_is_0_where_all_pass(harness: Harness, gates: Path) -> None:
    done = harness("gate")
    assert (done.status, done.err) == (0, "")
    assert done.out.splitlines()[-1] == "1 pass; reports/out/gates/summary.html"
    assert Path("reports/out/gates/summary.html").is_file()
    assert [path.name for path in Path("reports/out/gates/sky").iterdir()] == ["result.json"]


def test_is_1_where_one_fails_and_says_where_to_look(harness: Harness, gates: Path) -> None:
    write(gates.parent, WRONG)
    done = harness("gate", "-o", "out", "--only", "wrong-cosine", "--only", "sky")
    assert done.status == 1
    told, counted = done.out.splitlines()[-2:]
    assert told.startswith("wrong-cosine: fail: the image: blue -1.96 %")
    assert told.endswith("; see out/wrong-cosine; harness gate tests/gates.toml --only wrong-cosine")
    assert counted == "1 fail, 1 pass; out/summary.html"
    assert Path("out/wrong-cosine/z-map.png").is_file()
    assert not Path("out/wrong-mixture").exists()


def test_an_entrys_name_stands_for_all_its_strategies(harness: Harness, gates: Path) -> None:
    write(gates.parent, WRONG)
    found = harness("gate", "--only", "wrong", "--json").json
    assert [gate["gate"] for gate in found["gates"]] == ["wrong-cosine", "wrong-mixture"]


def test_json_is_one_object_with_every_look(harness: Harness, gates: Path) -> None:
    done = harness("gate", "tests/gates.toml", "--json", "--no-cache")
    assert done.status == 0
    assert done.json["false_alarms"] == 0.01
    gate, = done.json["gates"]
    assert (gate["gate"], gate["outcome"], gate["strategy"]) == ("sky", "pass", "cosine")
    assert gate["looks"][0]["samples"] == 16
    assert gate["command"] == "harness gate tests/gates.toml --only sky"


class TestBadInput:
    """One line, exit status 2, nothing rendered."""

    pytestmark = pytest.mark.usefixtures("no_renderer")

    def test_a_file_that_is_missing(self, harness: Harness, here: Path) -> None:
        assert refusal(harness("gate")) == (
            "tests/gates.toml: the gates file cannot be read (No such file or directory); name a .toml file")

    def test_a_file_that_is_malformed(self, harness: Harness, here: Path) -> None:
        Path("g.toml").write_text("\n[[gate]\n")
        assert refusal(harness("gate", "g.toml")).startswith("g.toml:2: malformed TOML: ")

    def test_a_name_that_is_unknown(self, harness: Harness, gates: Path) -> None:
        assert refusal(harness("gate", "--only", "ski")) == "tests/gates.toml: no gate is called 'ski'; choose from sky"

    def test_a_scene_that_is_bad_shows_before_the_first_render(self, harness: Harness, gates: Path) -> None:
        write(gates.parent, WRONG.replace('"wrong"\nscene = "sky.xml"', '"wrong"\nscene = "bad.xml"'))
        (gates.parent / "bad.xml").write_text(SKY.replace("</scene>", "<shape type='cone'/></scene>"))
        assert refusal(harness("gate")).startswith("tests/bad.xml:5: shape 'cone' is not supported")

    def test_a_strategy_that_does_not_suit(self, harness: Harness, gates: Path) -> None:
        write(gates.parent, GATES.replace('"sky.xml"', '"spheres"').replace('"cosine"', '"phong"'))
        assert refusal(harness("gate")).startswith("tests/gates.toml:8: gate 'sky': strategy 'phong' does not suit")


def test_a_budget_that_is_too_small_is_refused_with_what_would_do(harness: Harness, gates: Path) -> None:
    """At 16 samples per pixel the first look cannot tell; about so many times the samples would do."""
    write(gates.parent, GATES + """
[[gate]]
name = "small"
scene = "spheres"
strategy = "mixture"
reference = { spp = 1 }
size = [24, 18]
reason = "Too few samples."
""")
    done = harness("gate")
    message = done.err.strip().removeprefix("harness: error: ")
    assert (done.status, message.count("\n")) == (2, 0)
    assert message.startswith("tests/gates.toml:14: gate 'small': a budget of 64 replicas of 1 samples per pixel is "
                              "too small to decide; about ")
    assert message.endswith(" times the samples would do (of the reference as well), or wider tolerances")
    assert "1 pass" in Path("reports/out/gates/summary.html").read_text(encoding="utf-8")


def test_a_gate_that_cannot_be_run_does_not_stop_the_others(harness: Harness, gates: Path) -> None:
    """Thirty students' shaders in one file: one that does not compile is no reason to leave out the rest."""
    write(gates.parent, GATES + "".join(
        f'[[gate]]\nname = "{name}"\nscene = "sky.xml"\nstrategy = "cosine"\nshader = "own.frag"\nreason = "Mine."\n'
        for name in "ab"))
    (gates.parent / "own.frag").write_text("\nvoid main() { undeclared = 1; }\n")
    stale = Path("out/a/z-map.png")
    stale.parent.mkdir(parents=True)
    stale.touch()
    done = harness("gate", "-o", "out")
    assert done.status == 2
    assert done.err.startswith("harness: error: tests/own.frag:2: ")
    assert done.err.endswith(" (and 1 more; see out/summary.html)\n")
    told = [line for line in done.out.splitlines() if line.startswith("a: ")]
    assert len(told) == 1 and told[0].startswith("a: error: tests/own.frag:2: ")
    assert told[0].endswith("; harness gate tests/gates.toml --only a")
    assert done.out.splitlines()[-1] == "2 error, 1 pass; out/summary.html"
    assert not stale.exists()
    found = harness("gate", "--json")
    assert (found.status, [gate["outcome"] for gate in found.json["gates"]]) == (2, ["pass", "error", "error"])


def test_a_machine_that_lacks_something_stops_at_once(
    harness: Harness, gates: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    def lacking(*arguments: object, **options: object) -> None:
        raise MachineError("no headless OpenGL; type: make")

    monkeypatch.setattr("harness.gates.run_gate", lacking)
    done = harness("gate")
    assert (done.status, done.err) == (3, "harness: error: no headless OpenGL; type: make\n")
