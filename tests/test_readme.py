"""The README and the help say what is so: their commands run, their names exist, their numbers are the code's."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

import harness
from harness import bench, rivals, studies
from harness import calibration as calibration_module
from harness.checks import own
from harness.cli import COMMANDS, EXIT_INTERRUPTED, main
from harness.cli import report as report_command
from harness.course import gallery
from harness.diagnosis import stranger
from harness.files import data_dir
from harness.mutants import runner
from harness.mutants.runner import MODULE_FOLDERS
from harness.policy import TOLERANCE
from harness.scene import Scene, load_scene
from harness.scene.materials import BSDFS
from harness.scene.shapes import PARAMETERS
from harness.scene.strategies import TABLE
from harness.studies import causes, oracle, storage
from tests.support import studies as made
from tests.support.calibration import calibration
from tests.support.tev import listening

ROOT = Path(harness.__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
# What makes an example of the README or of the help run in a moment.
BRIEF = {"--spp": "4", "--replicas": "2", "--reference-spp": "8"}
SIZE = ("--size", "16x12")
JUDGED = (*SIZE, "--budget", "0.5", "--tolerance", "1")  # of a picture that fails it is asked why, six times as long
BENCH_ROW = bench.BenchRow("diffuse", "cosine", "path", "compute", 5.0, 12.0, 2.0, 6.0, 5.5, 6.5, 6.1, 4.0)


def blocks(language: str = "") -> list[str]:
    """The README's fenced blocks in a language."""
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)  # an end never reads as a beginning
    return [text for found, text in fenced if found == language]


def commands(text: str) -> list[str]:
    """Lines that begin with `harness`, less their comments."""
    return [line.partition("#")[0].strip() for line in text.splitlines() if line.startswith("harness ")]


def section(title: str) -> str:
    return README.split(f"\n## {title}\n")[1].split("\n## ")[0]


# Somebody's shader: any that runs.
HOMEWORK = """uniform sampler2D pingpong0;
uniform int numpass;
in vec2 texcoord;
layout(location = 0) out vec4 color;
void main() { color = (numpass > 0 ? texture(pingpong0, texcoord) : vec4(0.0)) + vec4(0.5, 0.5, 0.5, 1.0); }
"""
# What `harness gate` runs by default, as small as it can be.
GATES = """[[gate]]
name = "spheres-mixture"
scene = "spheres"
strategy = "mixture"
size = [16, 12]
spp = 1
reference = { value = [0, 0, 0] }
reason = "For the tests of the commands: certain to fail at the first look."
"""


def first_column(text: str) -> list[str]:
    """The first cells of a section's table, less its head."""
    return [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("|")][2:]


class ClosedWindow:
    """In place of the window of `harness view`, which needs a display: its user closes it at once."""

    closed = True

    def __init__(self, size: tuple[int, int], title: str) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""


@pytest.fixture
def more_scenes(brief: None, tmp_path: Path) -> None:
    """A scene that declares parameters; reports would study it too."""
    path = tmp_path / "mitsuba_scenes" / "depth_of_field.xml"
    path.symlink_to(ROOT / "mitsuba_scenes" / path.name)


@pytest.fixture
def brief(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The checkout as its commands see it, but with one scene, and with profiles that render little."""
    monkeypatch.chdir(tmp_path)
    scenes = tmp_path / "mitsuba_scenes"
    scenes.mkdir()
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "gates.toml").write_text(GATES, encoding="utf-8")
    (scenes / "spheres.xml").symlink_to(data_dir("mitsuba_scenes") / "spheres.xml")
    for name in ("before", "after"):
        storage.save_study(made.study(made.line("uniform", scene="spheres")), tmp_path / name)
    (tmp_path / "my_glsl" / "lib").mkdir(parents=True)
    (tmp_path / "my_glsl" / "lib" / "sampling.glsl").symlink_to(data_dir("glsl") / "lib" / "sampling.glsl")
    monkeypatch.setattr(own, "TOPICS", {"frames": own.TOPICS["frames"]})
    monkeypatch.setattr("harness.gpu.window.Window", ClosedWindow)
    monkeypatch.setattr("harness.files.data_dir", {**{name: data_dir(name) for name in ("glsl", "reports")},
                                                   "mitsuba_scenes": scenes}.__getitem__)
    monkeypatch.setitem(studies.PROFILES, "quick", studies.Profile(spp=4, replicas=2, reference_spp=8))
    # Of four samples and two replicas no verdict is expected: none is waited for, by hundreds of replicas more.
    monkeypatch.setattr("harness.studies.study.STAGES", 0)
    monkeypatch.setattr(gallery, "FIGURES", (gallery.Figure("spheres", 2),))
    monkeypatch.setattr(gallery, "SIDE", 16)
    for folder in MODULE_FOLDERS:
        (tmp_path / "tests" / folder).symlink_to(ROOT / "tests" / folder)
    monkeypatch.setattr(runner, "run_mutants", lambda mutants, gates, **options: runner.KillMatrix(
        tuple(mutants), gates.names, tuple(("killed",) * len(gates.names) for _ in mutants)))
    monkeypatch.setattr(bench, "run", lambda **options: [BENCH_ROW])
    monkeypatch.setattr(rivals, "run", lambda **options: [])
    monkeypatch.setattr(calibration_module, "calibrate", lambda *arguments, **options: calibration())

    for file in ("homework.frag", "submissions/ada.frag"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(HOMEWORK, encoding="utf-8")
    monkeypatch.setattr(stranger, "REFERENCE_SPP", 16)
    monkeypatch.setattr(stranger, "BATCHES", 16)

    # Minutes; they have tests of their own.
    named = causes.load_causes(causes.causes_file())
    monkeypatch.setattr(causes, "measure_causes", lambda *arguments, **options: named)
    known = oracle.load_oracle(oracle.oracle_file())
    monkeypatch.setattr(oracle, "measure_oracle", lambda *arguments, **options: known)
    monkeypatch.setattr("harness.course.memo.remembered_exhibits", lambda *arguments, **options: ((), False))
    # Its processes would know nothing of all this.
    monkeypatch.setattr("harness.studies.ahead.make_ahead", lambda *arguments, **options: {})

    def small(path: Path) -> Scene:
        return load_scene(path, width=16, height=12)

    monkeypatch.setattr(report_command, "open_scene", small)


def run(command: str) -> int:
    """Run a command line with fewer samples and pixels."""
    words = shlex.split(command)[1:]
    if words[0] in ("check", "grade"):
        words.append("--no-causes")
    for option, value in BRIEF.items():
        if option in words:
            words[words.index(option) + 1] = value
    small = {"check": JUDGED, "grade": (*JUDGED, "--jobs", "1")}.get(words[0], ())
    return main([*words, *(SIZE if words[0] in ("render", "reference", "study") else small)])


class TestCommands:
    """What a reader may type."""

    def test_every_command_is_shown(self) -> None:
        shown = [line.split()[1] for line in commands("\n".join(blocks()))]
        assert shown == ["doctor", *(name for name in COMMANDS if name != "doctor")]

    def test_the_readmes_run_one_after_another(
        self, brief: None, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    ) -> None:
        """In its order, for `compare` reads what `render` and `reference` wrote. 1: so few samples decide nothing."""
        for command in commands("\n".join(blocks())):
            assert run(command) in (0, 1), f"{command}: {capsys.readouterr().err}"
        assert (tmp_path / "spheres.exr").is_file()
        assert (tmp_path / "truth.exr").is_file()
        assert (tmp_path / "reports" / "out" / "report.pdf").is_file()

    def test_the_tour_of_five_minutes_goes_as_it_says(
        self, brief: None, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    ) -> None:
        """Its lines in a shell, and where they are ours here; the last one's words are those that it shows."""
        (tmp_path / "glsl").symlink_to(data_dir("glsl"))
        (tmp_path / "mitsuba_scenes" / "cornell.xml").symlink_to(ROOT / "mitsuba_scenes" / "cornell.xml")
        lines = re.findall(r"^\$ (.*)", section("Five minutes"), re.MULTILINE)
        for line in (line.partition("  #")[0].strip() for line in lines):
            if line.startswith("harness "):
                status = run(line)
                said = capsys.readouterr()
                wrong = "wrong.exr truth.exr" in line or "autopsy" in line  # so few samples decide nothing else
                assert status in ((1,) if wrong else (0, 1)), f"{line}: {said.err}"
            else:
                subprocess.run(line, shell=True, check=True, cwd=tmp_path)
        shown = re.findall(r"^(FIRST DIFFERENCE.*|  computed by .*)", section("Five minutes"), re.MULTILINE)
        assert len(shown) == 2
        assert all(each in said.out for each in shown)

    def test_what_has_no_end_runs_until_ctrl_c(
        self, brief: None, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    ) -> None:
        """Its user ends it when the first image is there, in tev as well."""
        def ctrl_c(saved: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("harness.view.saved.Saved.wait", ctrl_c)
        (line,) = re.findall(r"^\$ (harness render .*--watch.*)", README, re.MULTILINE)
        with listening() as tev:
            monkeypatch.setattr("harness.view.tev.ADDRESS", tev.address)
            assert run(f"{line} --spp 4") == EXIT_INTERRUPTED, capsys.readouterr().err
        assert (tmp_path / "spheres.exr").is_file()
        assert tev.images["spheres mixture"].shape == (12, 16, 3)

    @pytest.mark.parametrize("name", [name for name in COMMANDS if name not in ("doctor", "report")])
    def test_the_examples_of_the_help_run(
        self, brief: None, capsys: pytest.CaptureFixture[str], name: str,
    ) -> None:
        """The other two are the README's own."""
        if name == "compare":
            run("harness render mitsuba_scenes/spheres.xml -o spheres.exr --spp 4")
            run("harness reference mitsuba_scenes/spheres.xml -o truth.exr --spp 4")
        main([name, "--help"])
        text = " ".join(capsys.readouterr().out.split())
        example = text.split("Example: `")[1].split("`")[0]
        if example.split() not in [command.split() for command in commands("\n".join(blocks()))]:  # else it has run
            assert run(example) in (0, 1), capsys.readouterr().err

    def test_those_for_a_cluster_run(self, brief: None, capsys: pytest.CaptureFixture[str],
                                     monkeypatch: pytest.MonkeyPatch) -> None:
        """With Slurm's jobs in this process, and no scheduler of Dask's."""
        monkeypatch.setattr("harness.work.executors.dask.CONNECT_SECONDS", 0.1)
        monkeypatch.setattr("harness.work.forecast.PILOT_SECONDS", 0.0)
        lines = [line.removeprefix("$ ") for line in section("On a cluster").splitlines() if line.startswith("$ ")]
        for line, status in zip(commands("\n".join(lines)), (0, 0, 2), strict=True):
            small = line.replace("partition=cpu", "cluster=debug").replace("tcp://10.0.0.1:8786", "tcp://127.0.0.1:9")
            assert run(f"{small} --spp 4 --jobs 2") == status, capsys.readouterr().err
        assert "tcp://127.0.0.1:9: no " in capsys.readouterr().err

    @pytest.mark.parametrize(("number", "smaller", "told"), [
        (2, {'"mitsuba_scenes/depth_of_field.xml"': 'harness.SceneFile("mitsuba_scenes/depth_of_field.xml", size=(16, '
                                                    '12))', "spp=256": "spp=4", "[1, 10, 100]": "[1, 10]",
             "[0, 0.1]": "[0]", "replicas=4": "replicas=2, tolerance=0.5"}, ["depth_of_field alpha="] * 2),
        (0, {'.xml"': '.xml", width=16, height=12', "spp=256": "spp=8", "replicas=4": "replicas=2"},
         ["uniform", "mixture"]),
        (1, {"size=(96, 72)": "size=(16, 12)", "spp=64": "spp=8", "replicas=4": "replicas=2"},
         ["mixture", "mitsuba bsdf_path"])])
    def test_the_python_examples_run(
        self, more_scenes: None, capsys: pytest.CaptureFixture[str], number: int, smaller: dict[str, str],
        told: list[str],
    ) -> None:
        programs = blocks("python")
        assert len(programs) == 3
        program = programs[number]
        for option, less in smaller.items():
            assert option in program
            program = program.replace(option, less)
        exec(compile(program, "README.md", "exec"), {})
        lines = capsys.readouterr().out.splitlines()
        assert all(line.startswith(name) for line, name in zip(lines, told, strict=True))

    def test_studies_over_parameters_run_one_after_another(
        self, more_scenes: None, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    ) -> None:
        typed = re.findall(r"^\$ (harness .*)", section("Studies over parameters"), re.MULTILINE)
        assert [command.split()[1] for command in typed] == ["study", "study", "compare-studies"]
        for command in typed:
            brief_one = command.replace("alpha=1,10,100", "alpha=10").replace("--spp 256", "--spp 4 --tolerance 0.5")
            assert run(brief_one) in (0, 1), capsys.readouterr().err
        said = capsys.readouterr().out
        assert "mixture       not distinguishable" in said and "mitsuba path  only in B" in said
        assert (tmp_path / "before" / "error-by-aperture.svg").is_file()

    def test_the_make_targets_exist(self) -> None:
        targets = set(re.findall(r"^([a-z]+):.*## ", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
        named = set(re.findall(r"\bmake ([a-z]+)\b(?=`|  +#)", README))
        assert {"report", "test", "setup", "lint"} <= named <= targets


class TestWords:
    """Names and numbers in the text."""

    def test_exit_statuses_are_those_of_the_code(self) -> None:
        from harness.cli import EXIT_USAGE
        from harness.errors import HarnessError, MachineError

        told = first_column(section("The command `harness`"))
        assert told == ["0", "1", "2", "3", "130"]
        assert (HarnessError.exit_status, EXIT_USAGE, MachineError.exit_status, EXIT_INTERRUPTED) == (2, 2, 3, 130)

    def test_every_strategy_is_explained(self) -> None:
        rows = re.findall(r"^\| `([a-z]+)` \| (.+) \|$", section("Strategies"), re.MULTILINE)
        assert rows == [(each.name, each.sentence) for each in TABLE]

    def test_the_tolerance_is_the_default(self) -> None:
        assert f"({TOLERANCE:.1%})".replace("%", " %") in section("Verdicts")

    @pytest.mark.parametrize(("element", "names"), [("shapes", tuple(PARAMETERS)), ("BSDFs", BSDFS)])
    def test_every_supported_plugin_is_listed(self, element: str, names: tuple[str, ...]) -> None:
        row = next(line for line in section("Scenes").splitlines() if line.startswith(f"| {element} "))
        assert set(names) <= set(re.findall(r"`([a-z]+)`", row))

    def test_every_place_exists(self) -> None:
        for cell in first_column(section("Where things are")):
            for place in re.findall(r"`([^`]+)`", cell):
                assert (ROOT / place).exists(), place
