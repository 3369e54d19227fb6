"""`harness gallery` and `--executor`: where samples are drawn, what that lacks, and what a picture would cost."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from harness.work import forecast
from tests.cli.conftest import Harness, refusal

SMALL = ("--size", "16x12", "--spp", 8, "-o", "pictures")


@pytest.fixture(autouse=True)
def short_pilot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forecast, "PILOT_SECONDS", 0.0)


class TestGallery:
    """Pictures, and what they take."""

    def test_says_what_is_new_and_what_it_took(self, harness: Harness, sky: Path) -> None:
        first = harness("gallery", sky, *SMALL)
        assert first.status == 0
        assert re.search(r"sky\.png: 16 x 12, 8 spp, 8 of them new; [\d.e-]+ s of \w", first.out)
        assert "0 of them new" in harness("gallery", sky, *SMALL).out

    def test_on_slurm_it_is_the_same(self, harness: Harness, sky: Path) -> None:
        here = harness("gallery", sky, *SMALL, "--json").json["pictures"][0]
        Path("cluster.toml").write_text('[slurm]\ncluster = "debug"\npartition = "cpu"\n[dask]\nscheduler = "x"\n')
        there = harness("gallery", sky, *SMALL[:-1], "there", "--executor", "slurm", "--cluster", "cluster.toml",
                        "--json")
        assert there.status == 0
        assert {**there.json["pictures"][0], "png": "", "exr": "", "resumed": 0} == {
            **here, "png": "", "exr": "", "resumed": 0}
        assert Path("there/sky.png").read_bytes() == Path("pictures/sky.png").read_bytes()

    def test_an_estimate_says_its_error_and_renders_no_picture(self, harness: Harness, sky: Path) -> None:
        done = harness("gallery", sky, *SMALL, "--spp", 1000, "--jobs", 4, "--estimate")
        assert done.status == 0
        assert re.search(r"sky: 16 x 12, 1000 spp: [\d.]+ (s|min|h) .*; 4 such workers take [\d.]+ (s|min|h).*\n.* a "
                         r"worker .* a batch .* a sample, "
                         r"fitted to \d+ samples; the first half of them said .* s of the second, "
                         r"which took .*: [+-]\d", done.out)
        assert not Path("pictures").exists()
        (told,) = harness("gallery", sky, *SMALL, "--spp", 1000, "--jobs", 4, "--estimate", "--json").json["estimates"]
        assert told["workers"] == 4 and told["seconds"] >= told["longest"] > 0


class TestExecutor:
    """The option, of every command that has it."""

    @pytest.mark.parametrize("command", ["study", "gallery"])
    @pytest.mark.parametrize(("name", "package"), [("dask", "distributed"), ("slurm", "submitit")])
    def test_a_missing_extra_is_3_with_the_line_that_installs_it(
            self, harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, command: str, name: str,
            package: str) -> None:
        monkeypatch.setitem(sys.modules, package, None)
        done = harness(command, sky, "--executor", name)
        assert done.status == 3
        assert f"pip install 'glsl-validation-harness[{name}]'" in done.err and done.err.count("\n") == 1

    @pytest.mark.parametrize(("arguments", "said"), [
        (("--executor", "cloud"), "unknown executor 'cloud'; choose from serial, processes, dask, slurm"),
        (("--executor", "slurm", "--cluster", "partition"), "--cluster: expected NAME=VALUE"),
        (("--executor", "slurm", "--cluster", "none.toml"), "none.toml: cannot be read as TOML"),
        (("--executor", "slurm", "--cluster", "odd.toml"), "odd.toml: [slurm] must be a table of texts and numbers"),
        (("--executor", "dask", "--cluster", "partition=cpu"), "executor 'dask' knows no 'partition'; allowed: "),
        (("--cluster", "partition=cpu"), "executor 'serial' knows no 'partition'; allowed: none"),
    ])
    def test_what_it_does_not_understand_is_refused(self, harness: Harness, sky: Path, arguments: tuple[str, ...],
                                                    said: str) -> None:
        Path("odd.toml").write_text("[slurm]\npartition = ['a', 'b']\n")
        assert said in refusal(harness("gallery", sky, *SMALL, *arguments))
