"""`harness doctor` finds what a machine lacks, survives drivers that crash, and names the line that mends it."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.machine import doctor
from harness.machine.doctor import Check
from harness.machine.llvm_beside import LLVM_VARIABLE

RunHarness = Callable[..., subprocess.CompletedProcess[str]]


def test_this_machine_has_all_that_is_needed(run_harness: RunHarness) -> None:
    """Else every comparison of this suite would be missing: a machine without GL or LLVM fails here and says why."""
    done = run_harness("doctor", "--json")
    answer = json.loads(done.stdout)
    assert [check for check in answer["checks"] if check["needed"] and not check["ok"]] == []
    assert done.returncode == 0
    assert answer["ok"] is True
    details = {check["name"]: check["detail"] for check in answer["checks"]}
    assert list(details) == ["python", "packages", "OpenGL", "devices", "LLVM", "Mitsuba", "cores", "memory", "cache"]
    assert details["devices"].startswith("0: ") and "used" in details["devices"]
    assert "mitsuba 3." in details["packages"]
    assert "renders 1 where 1 is right" in details["Mitsuba"]


def test_a_lack_is_exit_status_3_with_its_mend(run_harness: RunHarness, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = run_harness("doctor", HARNESS_CACHE=str(tmp_path / "file" / "cache"))
    assert done.returncode == 3
    [line] = [line for line in done.stdout.splitlines() if "MISSING" in line]
    assert "cache" in line
    assert "to mend: export HARNESS_CACHE=" in done.stdout


class TestOpenGL:
    """The context is tried in a process of its own."""

    def test_a_missing_egl_names_the_debian_packages(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        (tmp_path / "libEGL.so.1").write_text("not a library")
        monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
        check = doctor.check_gl()
        assert not check.ok
        assert check.mend == "apt-get install libegl1 libgl1-mesa-dri"
        assert check.apt == ("libegl1", "libgl1-mesa-dri")
        assert "libEGL.so.1" in check.detail

    def test_a_driver_that_crashes_is_reported(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(doctor, "_GL_PROBE", "import os, sys; sys.stderr.write('oops\\n'); os.abort()")
        check = doctor.check_gl()
        assert (check.ok, check.detail) == (False, "crashed with signal 6: oops")

    def test_a_driver_that_hangs_is_reported(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(doctor, "_GL_PROBE", "import time; time.sleep(600)")
        monkeypatch.setattr(doctor, "_PROBE_TIMEOUT", 0.2)
        assert doctor.check_gl().detail == "no answer within 0.2 s"

    def test_the_tracers_way_is_told(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(doctor, "_GL_PROBE", "print('[\"llvmpipe\", \"4.5\", true, \"compute shaders (faster)\"]')")
        assert doctor.check_gl().detail == "llvmpipe, 4.5; the tracer runs as compute shaders (faster)"

    def test_a_device_that_hangs_is_told_after_its_own_shorter_wait(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """0 answers, 1 hangs, there is no 2."""
        monkeypatch.setattr(doctor, "_GL_PROBE", (
            "import os, sys, time; number = int(os.environ['HARNESS_GL_DEVICE'])\n"
            "if number == 1: time.sleep(600)\n"
            "if number == 2: sys.exit('there is no EGL device 2')\n"
            "print('[\"llvmpipe\", \"4.5\", true]')"))
        monkeypatch.setattr(doctor, "_DEVICE_TIMEOUT", 2)
        monkeypatch.delenv("HARNESS_GL_DEVICE", raising=False)
        check = doctor.check_devices()
        assert (check.ok, check.detail) == (True, "0: llvmpipe (software), used; 1: no answer within 2 s")
        monkeypatch.setenv("HARNESS_GL_DEVICE", "1")
        check = doctor.check_devices()
        assert (check.ok, check.detail) == (False, "0: llvmpipe (software); 1: no answer within 2 s, used")
        assert check.mend == "export HARNESS_GL_DEVICE=0"

    def test_without_a_driver_no_device_is_well(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", str(tmp_path / "none.json"))
        check = doctor.check_devices()
        assert (check.ok, check.mend, check.needed) == (False, "as for OpenGL", False)


class TestMitsuba:
    """LLVM is judged by its version, Mitsuba by a picture."""

    def test_an_old_llvm_fails_both_with_a_message(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv(LLVM_VARIABLE, "libc.so.6")
        for check in (doctor.check_llvm(), doctor.check_mitsuba()):
            assert not check.ok
            assert check.detail.startswith(f"{LLVM_VARIABLE}=libc.so.6 is older than LLVM 16")
            assert check.mend == "point it at a newer one or unset it"

    def test_a_missing_libatomic_names_the_debian_package(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    ) -> None:
        (tmp_path / "libatomic.so.1").write_text("not a library")
        monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
        monkeypatch.delenv(LLVM_VARIABLE, raising=False)
        check = doctor.check_mitsuba()
        assert not check.ok
        assert check.mend == "run `apt-get install libatomic1`"
        assert check.apt == ("libatomic1",)

    def test_a_wrong_picture_fails(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(doctor, "_MITSUBA_PROBE", "print('[\"3.9.1\", 0.5]')")
        check = doctor.check_mitsuba()
        assert (check.ok, check.detail) == (False, "3.9.1, llvm_ad_rgb renders 0.5 where 1 is right")


class TestPackages:
    """Installed versions are compared with the project's own requirements."""

    def judge(self, monkeypatch: pytest.MonkeyPatch, *requirements: str) -> Check:
        class Metadata:
            def get_all(self, name: str, default: list[str]) -> list[str]:
                return list(requirements)
        monkeypatch.setattr(doctor, "_metadata", Metadata)
        return doctor.check_packages()

    def test_a_missing_one_is_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        check = self.judge(monkeypatch, "numpy", "no-such-package>=1")
        assert (check.ok, check.detail) == (False, "no-such-package>=1 is not installed")

    def test_one_outside_the_requirement_is_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        check = self.judge(monkeypatch, "numpy>=1000")
        assert not check.ok
        assert check.detail.startswith("numpy>=1000 is needed, ")

    def test_extras_and_other_machines_do_not_count(self, monkeypatch: pytest.MonkeyPatch) -> None:
        assert self.judge(monkeypatch, 'nothing; extra == "dev"', 'nothing; sys_platform == "beos"').ok


class TestMemory:
    """A container's limit counts."""

    @pytest.mark.parametrize(("text", "limit"), [("1073741824\n", 2**30), ("max\n", None), ("9" * 19, None)])
    def test_the_smaller_of_machine_and_control_group(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, text: str, limit: int | None,
    ) -> None:
        monkeypatch.setattr(doctor, "_MEMORY_LIMITS", ())
        machine = doctor.memory_limit()
        (tmp_path / "memory.max").write_text(text)
        monkeypatch.setattr(doctor, "_MEMORY_LIMITS", (str(tmp_path / "absent"), str(tmp_path / "memory.max")))
        assert doctor.memory_limit() == (limit or machine)

    def test_little_is_told_but_is_no_lack(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(doctor, "memory_limit", lambda: 2**30)
        check = doctor.check_memory()
        assert (check.ok, check.needed) == (False, False)
        assert check.detail == "1.0 GiB, 3 GiB or more recommended"
