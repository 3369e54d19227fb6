"""`make setup`: the lock file, and what bootstrap decides on machines unlike this one."""

from __future__ import annotations

import ast
import fcntl
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from harness.machine import bootstrap

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
LOCKED = re.findall(r"^([\w.-]+)==(\S+)(?: ; .*?)? \\\n(?: +--hash=sha256:[0-9a-f]{64}(?: \\)?\n)+", LOCK, re.MULTILINE)


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Bootstrap working on an empty copy of the checkout."""
    for name in bootstrap.INGREDIENTS:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    venv = tmp_path / ".venv"
    for name, value in {"ROOT": tmp_path, "VENV": venv, "PYTHON": venv / "bin" / "python",
                        "STAMP": venv / "setup-stamp.json", "LOCK": tmp_path / "requirements.lock"}.items():
        monkeypatch.setattr(bootstrap, name, str(value))
    return tmp_path


def make_bare_environment(checkout: Path) -> None:
    """What `python -m venv` leaves, as far as bootstrap looks."""
    (checkout / ".venv" / "bin").mkdir(parents=True)
    (checkout / ".venv" / "bin" / "python").symlink_to(os.path.realpath(sys.executable))
    (checkout / ".venv" / "bin" / "pip").write_text(f"#!{checkout}/.venv/bin/python\n")


class TestLock:
    """requirements.lock serves behind any mirror and pins everything."""

    def test_holds_no_url_and_no_host_name(self) -> None:
        assert not re.findall(r"://|--index|--extra-index|--find-links|--trusted-host|\b[\w-]+\.(?:org|com|net|io|dev)\b",
                              LOCK)

    def test_pins_every_package_by_hash(self) -> None:
        lines = [line for line in LOCK.splitlines() if line and not line.startswith((" ", "#"))]
        assert len(lines) == len(LOCKED) > 40

    @pytest.mark.parametrize("line", [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["dev"]])
    def test_satisfies_the_project(self, line: str) -> None:
        """On every Python that the project allows: some packages are locked once for each."""
        wanted = Requirement(line)
        versions = [version for name, version in LOCKED if name == canonicalize_name(wanted.name)]
        assert versions and all(version in wanted.specifier for version in versions)

    def test_holds_the_build_backend_and_the_installer(self) -> None:
        """Installing the project itself then fetches nothing, and the installer is as pinned as the rest."""
        assert {"hatchling", "uv"} <= {name for name, _ in LOCKED}
        lines = bootstrap.locked_lines("uv")
        assert lines.startswith("uv==") and lines in LOCK
        assert lines.count("--hash") == LOCK.split("\nuv==")[1].split("\n    #")[0].count("--hash")


class TestPython:
    """Which interpreter makes the environment."""

    def test_bootstrap_can_be_read_by_python_3_6(self) -> None:
        """Else an old interpreter answers with a syntax error instead of saying that it is old."""
        text = (ROOT / "harness" / "machine" / "bootstrap.py").read_text(encoding="utf-8")
        assert ast.parse(text, feature_version=(3, 6)).body

    def test_bootstrap_and_the_project_allow_the_same(self) -> None:
        allowed = SpecifierSet(PROJECT["requires-python"])
        for minor in range(20):
            assert (bootstrap.OLDEST <= (3, minor) <= bootstrap.NEWEST) == (f"3.{minor}" in allowed)

    @pytest.mark.parametrize(("version", "reason"), [((3, 8, 1), "too old"), ((3, 14, 0), "too new")])
    def test_an_unsupported_one_alone_is_a_message(
        self, monkeypatch: pytest.MonkeyPatch, version: tuple[int, ...], reason: str,
    ) -> None:
        monkeypatch.setattr(bootstrap.sys, "version_info", version)
        monkeypatch.setattr(bootstrap.shutil, "which", lambda name: None)
        with pytest.raises(bootstrap.SetupError, match=f"{reason}.*\n *apt-get install python3 python3-venv$"):
            bootstrap.find_python()

    @pytest.mark.parametrize(("has", "told"), [("python3.11", "python3.11 python3.11-venv"),  # Debian 12
                                               ("python3.13", "python3.13 python3.13-venv"),  # Debian 13
                                               ("python3.14", "python3 python3-venv")])
    def test_the_message_names_a_python_that_this_system_has(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, has: str, told: str,
    ) -> None:
        asked = tmp_path / "apt-cache"
        asked.write_text(f'#!/bin/sh\n[ "$1 $2" = "show {has}" ] || exit 100\n')
        asked.chmod(0o755)
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.setattr(bootstrap.sys, "version_info", (3, 8, 1))
        with pytest.raises(bootstrap.SetupError, match=rf"\n    apt-get install {told}$"):
            bootstrap.find_python()

    def test_a_supported_one_of_the_path_is_found(self, monkeypatch: pytest.MonkeyPatch) -> None:
        paths = {"python3.13": "/no/such/python3.13", "python3.12": sys.executable}
        monkeypatch.setattr(bootstrap.sys, "version_info", (3, 8, 1))
        monkeypatch.setattr(bootstrap.shutil, "which", paths.get)
        assert bootstrap.find_python() == sys.executable


class TestReadiness:
    """The second call ends at once, and never when it should not."""

    @pytest.fixture
    def ready(self, checkout: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """A checkout whose set-up ended, the slow steps left out."""
        make_bare_environment(checkout)
        for step in ("install_packages", "meet_native_needs"):
            monkeypatch.setattr(bootstrap, step, lambda: None)
        monkeypatch.setattr(bootstrap, "is_usable", lambda: True)
        bootstrap.set_up()
        assert bootstrap.is_ready()
        return checkout

    def test_a_finished_set_up_is_not_repeated(self, ready: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def fail() -> None:
            raise AssertionError("set up twice")
        monkeypatch.setattr(bootstrap, "set_up", fail)
        assert bootstrap.main() == 0

    @pytest.mark.parametrize("name", bootstrap.INGREDIENTS)
    def test_a_changed_ingredient_repeats_it(self, ready: Path, name: str) -> None:
        with (ready / name).open("a") as file:
            file.write("\n")
        assert not bootstrap.is_ready()

    def test_a_python_that_is_gone_repeats_it(self, ready: Path) -> None:
        (ready / ".venv" / "bin" / "python").unlink()
        assert not bootstrap.is_ready()

    def test_a_python_that_no_longer_runs_repeats_it(self, ready: Path) -> None:
        """As after an upgrade of the system that took its libraries away."""
        interpreter = ready / ".venv" / "bin" / "python"
        interpreter.unlink()
        interpreter.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
        interpreter.chmod(0o755)
        bootstrap.set_up()
        assert bootstrap.is_ready()
        interpreter.write_text("#!/bin/sh\nexit 127\n")
        assert not bootstrap.is_ready()

    def test_a_renamed_folder_repeats_it(self, ready: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        moved = ready.rename(ready.with_name("renamed"))
        monkeypatch.setattr(bootstrap, "ROOT", str(moved))
        monkeypatch.setattr(bootstrap, "VENV", str(moved / ".venv"))
        monkeypatch.setattr(bootstrap, "PYTHON", str(moved / ".venv" / "bin" / "python"))
        monkeypatch.setattr(bootstrap, "STAMP", str(moved / ".venv" / "setup-stamp.json"))
        assert not bootstrap.is_ready()

    def test_an_interrupted_set_up_is_continued(
        self, ready: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    ) -> None:
        (ready / ".venv" / "setup-stamp.json").unlink()

        def interrupt() -> None:
            raise KeyboardInterrupt
        with monkeypatch.context() as patch:
            patch.setattr(bootstrap, "install_packages", interrupt)
            assert bootstrap.main() == 130
        assert "`make setup` continues from here" in capsys.readouterr().err
        assert not bootstrap.is_ready()
        assert bootstrap.main() == 0
        assert bootstrap.is_ready()


class TestEnvironment:
    """When .venv is kept and when it is made again."""

    def test_scripts_that_name_another_folder_make_it_unusable(self, checkout: Path) -> None:
        make_bare_environment(checkout)
        (checkout / ".venv" / "bin" / "pip").write_text("#!/somewhere/else/.venv/bin/python\n")
        assert not bootstrap.is_usable()

    def test_a_working_one_is_usable(self, checkout: Path) -> None:
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(checkout / ".venv")], check=True)
        assert not bootstrap.is_usable()
        library = next((checkout / ".venv" / "lib").iterdir()) / "site-packages" / "pip"
        library.mkdir()
        (library / "__main__.py").touch()
        (library / "__init__.py").touch()
        (checkout / ".venv" / "bin" / "pip").write_text(f"#!{checkout}/.venv/bin/python\n")
        assert bootstrap.is_usable()

    def test_a_usable_one_is_kept_whichever_python_asks(
        self, checkout: Path, monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        make_bare_environment(checkout)
        monkeypatch.setattr(bootstrap, "is_usable", lambda: True)
        monkeypatch.setattr(bootstrap.sys, "version_info", (3, 8, 1))
        monkeypatch.setattr(bootstrap.shutil, "which", lambda name: None)
        for step in ("install_packages", "meet_native_needs"):
            monkeypatch.setattr(bootstrap, step, lambda: None)
        assert bootstrap.main() == 0

    def test_without_pythons_venv_module_one_line_names_all_that_lacks(
        self, checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    ) -> None:
        """As on a bare Debian, for a user who is not root."""
        interpreter = checkout / "python3.11"
        interpreter.write_text(f'#!/bin/sh\ncase "$*" in *ensurepip*) exit 1;; esac\nexec {sys.executable} "$@"\n')
        interpreter.chmod(0o755)
        monkeypatch.setattr(bootstrap, "find_python", lambda: str(interpreter))
        libraries = (("libno-such.so.1", ("libatomic1",)), ("libc.so.6", ("libc6",)))
        monkeypatch.setattr(bootstrap, "NATIVE_LIBRARIES", libraries)
        monkeypatch.setattr(bootstrap.os, "geteuid", lambda: 1000)
        assert bootstrap.main() == 3
        package = f"python{sys.version_info.major}.{sys.version_info.minor}-venv"
        assert f"apt-get install -y --no-install-recommends {package} libatomic1\n" in capsys.readouterr().err
        assert not (checkout / ".venv").exists()


class TestNativeNeeds:
    """What `harness doctor` finds missing is installed where that needs no question."""

    LACKING = ({"name": "OpenGL", "ok": False, "needed": True, "detail": "no EGL", "mend": "…", "apt": ["libegl1"]},)

    def test_a_user_is_told_the_line(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(bootstrap, "unmet_needs", lambda: self.LACKING)
        monkeypatch.setattr(bootstrap.os, "geteuid", lambda: 1000)
        line = r"OpenGL cannot work yet; type as root\n.*apt-get install .*libegl1\n"
        with pytest.raises(bootstrap.SetupError, match=line):
            bootstrap.meet_native_needs()

    def test_root_installs_and_looks_again(self, monkeypatch: pytest.MonkeyPatch) -> None:
        answers, commands = [self.LACKING, ()], []
        monkeypatch.setattr(bootstrap, "unmet_needs", lambda: answers.pop(0))
        monkeypatch.setattr(bootstrap.os, "geteuid", lambda: 0)
        monkeypatch.setattr(bootstrap.shutil, "which", lambda name: f"/usr/bin/{name}")
        monkeypatch.setattr(bootstrap.subprocess, "call", lambda command, **_: commands.append(command) or 0)
        bootstrap.meet_native_needs()
        assert commands == [["apt-get", "install", "-y", "--no-install-recommends", "libegl1"]]
        assert answers == []

    def test_a_need_that_stays_is_told_with_its_mend(self, monkeypatch: pytest.MonkeyPatch) -> None:
        lacking = ({**self.LACKING[0], "apt": [], "mend": "unset THIS"},)
        monkeypatch.setattr(bootstrap, "unmet_needs", lambda: lacking)
        with pytest.raises(bootstrap.SetupError, match="OpenGL: no EGL\n    to mend: unset THIS"):
            bootstrap.meet_native_needs()


class TestPackages:
    """uv where it can, pip where only pip knows the way."""

    @pytest.mark.parametrize(("settings", "by_uv"), [
        ("", True), ("global.timeout='60'\n", True),
        ("global.index-url='…'\n", False), (":env:.no-index='1'\n", False), ("global.proxy='…'\n", False),
    ])
    def test_pip_does_the_work_where_its_configuration_matters(
        self, monkeypatch: pytest.MonkeyPatch, settings: str, by_uv: bool,
    ) -> None:
        monkeypatch.setattr(bootstrap.subprocess, "check_output", lambda *_, **__: settings.encode())
        monkeypatch.setattr(bootstrap.subprocess, "call", lambda *_, **__: 0)
        assert bootstrap.install_uv() is by_uv

    def test_pip_takes_over_where_uv_fails(self, monkeypatch: pytest.MonkeyPatch) -> None:
        commands: list[list[str]] = []

        def call(command: list[str], **_: object) -> int:
            commands.append(command)
            return 1 if command[0].endswith("/uv") else 0
        monkeypatch.setattr(bootstrap, "install_uv", lambda: True)
        monkeypatch.setattr(bootstrap.subprocess, "call", call)
        bootstrap.install_packages()
        uv, pip, project = commands
        assert uv[-3:] == pip[-3:] == ["--require-hashes", "-r", bootstrap.LOCK]
        assert {"--no-index", "--no-build-isolation", "--no-deps"} <= set(project)


def test_two_set_ups_of_one_folder_take_turns(checkout: Path) -> None:
    folder = os.open(checkout, os.O_RDONLY)
    try:
        with bootstrap.one_at_a_time(), pytest.raises(BlockingIOError):
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        os.close(folder)


def planned(*arguments: str) -> list[str]:
    """What `make ARGUMENTS` would run, asked as from a shell even when make itself runs the tests."""
    environment = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MAKELEVEL")}
    return subprocess.run(["make", "--dry-run", "--no-print-directory", *arguments], cwd=ROOT, check=True,
                          capture_output=True, text=True, env=environment).stdout.splitlines()


class TestMake:
    """The targets, and what continuous integration runs."""

    @pytest.mark.parametrize("target", ["report", "test", "bench", "doctor", "lint"])
    def test_every_target_sets_up_first(self, target: str) -> None:
        plan = planned(target)
        assert plan[0].endswith("-I harness/machine/bootstrap.py")
        assert all(line.startswith(".venv/bin/") for line in plan[1:])

    def test_the_report_takes_its_profile(self) -> None:
        assert planned("report", "PROFILE=full")[-1] == ".venv/bin/harness report --profile full"

    def test_continuous_integration_runs_only_what_the_readme_names(self) -> None:
        commands = [line for line in (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
                    if line and not line.startswith(("#", "set ", "cd "))]
        assert commands == ["make lint", "make test"]
        readme = (ROOT / "README.md").read_text(encoding="utf-8")
        assert all(command in readme for command in commands)
