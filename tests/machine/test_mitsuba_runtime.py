"""LLVM is chosen and judged before drjit loads it: an old one would abort the process."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import pytest

from harness.errors import MachineError
from harness.machine import mitsuba_runtime
from harness.machine.llvm_beside import LLVM_VARIABLE, OLDEST_LLVM, library_beside, point_drjit_at_it
from harness.machine.mitsuba_runtime import find_llvm, import_mitsuba, use_reference_variant

# A library of every Linux machine that is not LLVM; without LLVMGetVersion it looks like LLVM 15 or older.
NOT_LLVM = "libc.so.6"


def import_in_process(**variables: str) -> subprocess.CompletedProcess[str]:
    """Load Mitsuba in a process of its own and print what a command would: its variant, or the error's one line."""
    program = """
from harness.errors import MachineError
from harness.machine.mitsuba_runtime import use_reference_variant
try:
    print(use_reference_variant().variant())
except MachineError as error:
    print(error)
"""
    return subprocess.run([sys.executable, "-c", program], env={**os.environ, **variables},
                          capture_output=True, text=True)


@pytest.fixture
def no_users_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(LLVM_VARIABLE, raising=False)


@pytest.mark.usefixtures("no_users_choice")
class TestFindLLVM:
    """The user's, else the wheel's, else the system's newest."""

    def test_takes_the_wheels(self) -> None:
        llvm = find_llvm()
        assert llvm.path.parent == Path(sys.prefix, "lib").resolve()
        assert llvm.version[0] >= OLDEST_LLVM
        assert llvm.origin == "wheel karellen-llvm-core"

    def test_the_users_path_wins(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        path = tmp_path / "libLLVM.so"
        path.symlink_to(find_llvm().path)
        monkeypatch.setenv(LLVM_VARIABLE, str(path))
        assert find_llvm().origin == LLVM_VARIABLE
        assert find_llvm().path == path

    @pytest.mark.parametrize(("path", "complaint"), [
        ("/no/such/libLLVM.so", "cannot be loaded"),
        (__file__, "cannot be loaded"),
        (NOT_LLVM, f"older than LLVM 16, drjit needs {OLDEST_LLVM}"),
    ])
    def test_an_unusable_path_of_the_user_is_never_silently_replaced(
        self, monkeypatch: pytest.MonkeyPatch, path: str, complaint: str,
    ) -> None:
        monkeypatch.setenv(LLVM_VARIABLE, path)
        with pytest.raises(MachineError, match=complaint) as caught:
            find_llvm()
        assert str(caught.value).startswith(f"{LLVM_VARIABLE}={path}")

    def test_llvm_16_is_too_old(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """It has LLVMGetVersion, and yet aborts at the first render with 'Cannot select: fminimum'."""
        monkeypatch.setattr(mitsuba_runtime, "llvm_version", lambda path: (16, 0, 6))
        monkeypatch.setenv(LLVM_VARIABLE, "/usr/lib/libLLVM-16.so")
        with pytest.raises(MachineError, match="is LLVM 16, drjit needs 17 or newer"):
            find_llvm()

    def test_without_the_wheel_the_newest_system_library_serves(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    ) -> None:
        versions = {"libLLVM-15.so.1": None, "libLLVM-16.so.1": (16, 0, 6), "libLLVM.so.19.1": (19, 1, 7),
                    "libLLVM-17.so.1": (17, 0, 6)}
        for name in versions:
            (tmp_path / name).touch()
        monkeypatch.setattr(mitsuba_runtime, "_wheel_libraries", lambda: iter(()))
        monkeypatch.setattr(mitsuba_runtime, "_SYSTEM_FOLDERS", (str(tmp_path),))
        monkeypatch.setattr(mitsuba_runtime, "llvm_version", lambda path: versions[path.name])
        assert find_llvm() == mitsuba_runtime.LLVM(tmp_path / "libLLVM.so.19.1", (19, 1, 7), "system")

    def test_llvm_15_alone_is_a_message(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        """What Mesa pulls in on Debian 12, and all that such a machine has without the wheel."""
        (tmp_path / "libLLVM-15.so.1").touch()
        monkeypatch.setattr(mitsuba_runtime, "_wheel_libraries", lambda: iter(()))
        monkeypatch.setattr(mitsuba_runtime, "_SYSTEM_FOLDERS", (str(tmp_path),))
        monkeypatch.setattr(mitsuba_runtime, "llvm_version", lambda path: None)
        with pytest.raises(MachineError, match=r"libLLVM-15\.so\.1 \(too old\); run `make setup`"):
            find_llvm()

    def test_none_at_all_is_a_message(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setattr(mitsuba_runtime, "_wheel_libraries", lambda: iter(()))
        monkeypatch.setattr(mitsuba_runtime, "_SYSTEM_FOLDERS", (str(tmp_path),))
        with pytest.raises(MachineError, match="found none; run `make setup`"):
            find_llvm()

    def test_a_missing_libatomic_is_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The wheel's LLVM links to it, and a bare Debian lacks it."""
        def fail(path: Path) -> None:
            raise OSError("libatomic.so.1: cannot open shared object file: No such file or directory")
        monkeypatch.setattr(mitsuba_runtime, "llvm_version", fail)
        with pytest.raises(MachineError, match="apt-get install libatomic1"):
            find_llvm()


class TestLibraryBeside:
    """What importing the harness sets for all who import drjit afterwards."""

    @staticmethod
    def environment(folder: Path, *libraries: str) -> str:
        (folder / "lib").mkdir()
        for name in libraries:
            (folder / "lib" / name).touch()
        return str(folder)

    @pytest.mark.parametrize(("libraries", "found"), [
        (["libLLVM.so.9.1", "libLLVM.so.17.0", "libLLVM.so.19.1", "libLLVM.so"], "libLLVM.so.19.1"),
        (["libLLVM.so.15.0", "libLLVM-16.so"], None), ([], None)])
    def test_is_the_newest_that_is_new_enough(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, libraries: list[str], found: str | None,
    ) -> None:
        monkeypatch.setattr(sys, "prefix", self.environment(tmp_path, *libraries))
        assert library_beside() == (found and str(tmp_path / "lib" / found))

    def test_is_none_without_the_folder(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sys, "prefix", str(tmp_path))
        assert library_beside() is None

    @pytest.mark.parametrize(("users", "imported", "expected"), [
        (None, False, "lib/libLLVM.so.19.1"), ("/mine.so", False, "/mine.so"), (None, True, None)])
    def test_is_set_unless_the_user_or_drjit_has_chosen(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, users: str | None, imported: bool, expected: str | None,
    ) -> None:
        monkeypatch.setattr(sys, "prefix", self.environment(tmp_path, "libLLVM.so.19.1"))
        monkeypatch.setattr(sys, "modules", {"drjit": os} if imported else {})
        monkeypatch.delenv(LLVM_VARIABLE, raising=False)
        if users:
            monkeypatch.setenv(LLVM_VARIABLE, users)
        point_drjit_at_it()
        assert os.environ.get(LLVM_VARIABLE) == (expected and str(tmp_path / expected))

    def test_is_not_taken_for_the_users_choice(self, monkeypatch: pytest.MonkeyPatch) -> None:
        found = library_beside()
        assert found is not None
        monkeypatch.setenv(LLVM_VARIABLE, found)
        assert find_llvm().origin == "wheel karellen-llvm-core"


class TestImportMitsuba:
    """In processes of their own: what drjit loads, it keeps."""

    def test_sets_no_variant_and_reads_scenes_without_one(self) -> None:
        program = '''
from harness.machine.mitsuba_runtime import import_mitsuba
mi = import_mitsuba()
assert mi is import_mitsuba()
assert mi.variant() is None
config = mi.parser.ParserConfig("llvm_ad_rgb")
state = mi.parser.parse_string(config, """<scene version="3.0.0"><shape type="sphere">
    <transform name="to_world"><scale value="2"/></transform></shape></scene>""")
mi.parser.transform_all(config, state)
assert [node.props["to_world"].matrix[0, 0] for node in state.nodes if "to_world" in node.props.keys()] == [2]
assert mi.variant() is None
'''
        subprocess.run([sys.executable, "-c", program], check=True)

    def test_loads_the_library_that_was_found(self) -> None:
        use_reference_variant()
        import drjit

        assert drjit.detail.llvm_version()[0] >= OLDEST_LLVM
        assert Path(os.environ[LLVM_VARIABLE]).exists()
        assert import_mitsuba().variant() == "llvm_ad_rgb"

    def test_an_old_llvm_is_a_message_and_not_an_abort(self) -> None:
        done = import_in_process(**{LLVM_VARIABLE: NOT_LLVM})
        assert done.returncode == 0
        assert done.stdout.startswith(f"{LLVM_VARIABLE}={NOT_LLVM} is older than LLVM 16")

    def test_a_drjit_imported_before_with_an_old_llvm_is_a_message(self, monkeypatch: pytest.MonkeyPatch) -> None:
        use_reference_variant()
        import drjit

        monkeypatch.setattr(drjit.detail, "llvm_version", lambda: (15, 0, 6))
        with pytest.raises(MachineError, match=r"drjit runs on LLVM 15.*import harness before drjit and mitsuba, or "
                           rf"start Python with {LLVM_VARIABLE}=/.*libLLVM\S* in its environment"):
            use_reference_variant()

    def test_imported_by_a_program_after_the_harness_has_the_harnesss_llvm(self) -> None:
        """drjit chooses when it is imported, by whomever; left alone it takes the system's newest, 15 on Debian 12."""
        program = """
import harness
import mitsuba
mitsuba.set_variant("scalar_rgb")
import drjit
from harness.machine.mitsuba_runtime import find_llvm, use_reference_variant
print(use_reference_variant().variant(), drjit.detail.llvm_version() == find_llvm().version)
"""
        environment = {name: value for name, value in os.environ.items() if name != LLVM_VARIABLE}
        done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        assert done.stdout == "llvm_ad_rgb True\n", done.stderr

    def test_an_unreadable_libatomic_is_a_message(self, tmp_path: Path) -> None:
        (tmp_path / "libatomic.so.1").write_text("not a library")
        done = import_in_process(LD_LIBRARY_PATH=str(tmp_path))
        assert done.returncode == 0
        assert done.stdout.rstrip().endswith("run `apt-get install libatomic1`")

    def test_a_missing_mitsuba_is_a_message(self, tmp_path: Path) -> None:
        (tmp_path / "mitsuba.py").write_text("raise ModuleNotFoundError(\"No module named 'mitsuba'\")")
        done = import_in_process(PYTHONPATH=str(tmp_path))
        assert done.stdout == "Mitsuba cannot be imported (No module named 'mitsuba'); run `make setup`\n"


def test_the_stand_in_for_an_old_llvm_has_no_version() -> None:
    """Else the tests above would prove nothing."""
    assert not hasattr(ctypes.CDLL(NOT_LLVM), "LLVMGetVersion")
