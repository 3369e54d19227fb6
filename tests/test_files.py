"""Where files live, and writes that leave all or nothing behind."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from harness import files
from harness.errors import HarnessError, StoreError
from harness.files import cache_dir, create_files, data_dir, require_writable, write_atomically

TryToWrite = Callable[[Path], object]

ROOT = Path(__file__).resolve().parents[1]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


class TestWriteAtomically:
    """All of the new file, or the old one untouched."""

    def test_replaces_the_old_file_when_the_block_ends_well(self, tmp_path: Path) -> None:
        target = tmp_path / "image.exr"
        target.write_text("old")
        with write_atomically(target) as partial:
            partial.write_text("new")
            assert target.read_text() == "old"
        assert target.read_text() == "new"
        assert names(tmp_path) == ["image.exr"]

    def test_offers_a_path_of_the_same_suffix_in_the_same_folder(self, tmp_path: Path) -> None:
        """Writers choose the format by the suffix, and os.replace is atomic only within a file system."""
        with write_atomically(tmp_path / "image.exr") as partial:
            partial.touch()
            assert (partial.parent, partial.suffix) == (tmp_path, ".exr")

    @pytest.mark.parametrize("interruption", [KeyboardInterrupt, ValueError])
    def test_leaves_the_old_file_and_no_remains_when_the_block_is_interrupted(
        self, tmp_path: Path, interruption: type[BaseException],
    ) -> None:
        target = tmp_path / "image.exr"
        target.write_text("old")
        with pytest.raises(interruption), write_atomically(target) as partial:
            partial.write_text("half of the n")
            raise interruption
        assert target.read_text() == "old"
        assert names(tmp_path) == ["image.exr"]

    def test_makes_missing_folders(self, tmp_path: Path) -> None:
        with write_atomically(tmp_path / "a" / "b" / "image.exr") as partial:
            partial.touch()
        assert (tmp_path / "a" / "b" / "image.exr").is_file()

    def test_new_files_have_the_permissions_that_the_user_asks_of_new_files(self, tmp_path: Path) -> None:
        before = os.umask(0o027)
        try:
            with write_atomically(tmp_path / "image.exr") as partial:
                partial.touch()
        finally:
            os.umask(before)
        assert stat.S_IMODE((tmp_path / "image.exr").stat().st_mode) == 0o640

    def test_writes_through_a_link(self, tmp_path: Path) -> None:
        (tmp_path / "real").mkdir()
        (tmp_path / "link.exr").symlink_to(tmp_path / "real" / "image.exr")
        with write_atomically(tmp_path / "link.exr") as partial:
            partial.write_text("new")
        assert (tmp_path / "link.exr").is_symlink()
        assert (tmp_path / "real" / "image.exr").read_text() == "new"

    def test_a_full_disk_is_one_line_that_names_the_file(self, tmp_path: Path) -> None:
        with pytest.raises(StoreError, match=r"image\.exr: cannot be written \(No space left"), \
                write_atomically(tmp_path / "image.exr"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def test_an_error_of_reading_another_file_passes_through(self, tmp_path: Path) -> None:
        with pytest.raises(FileNotFoundError), write_atomically(tmp_path / "image.exr"):
            (tmp_path / "no such input").read_text()


@pytest.mark.parametrize("try_to_write", [require_writable, lambda path: write_atomically(path).__enter__()],
                         ids=["require_writable", "write_atomically"])
class TestUnwritable:
    """Places that cannot be written are refused in one line before the work."""

    def test_a_folder(self, tmp_path: Path, try_to_write: TryToWrite) -> None:
        with pytest.raises(StoreError, match="it is a folder"):
            try_to_write(tmp_path)

    def test_a_device_which_replacing_would_destroy(self, try_to_write: TryToWrite) -> None:
        with pytest.raises(StoreError, match="not a regular file"):
            try_to_write(Path("/dev/null"))

    def test_a_path_below_a_file(self, tmp_path: Path, try_to_write: TryToWrite) -> None:
        (tmp_path / "file").touch()
        with pytest.raises(StoreError, match=r"image\.exr: cannot be written") as caught:
            try_to_write(tmp_path / "file" / "image.exr")
        assert len(str(caught.value).splitlines()) == 1


    def test_a_folder_that_may_not_be_searched(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, try_to_write: TryToWrite,
    ) -> None:
        """Simulated, since nothing is forbidden to root."""
        def forbid(self: Path, **_: object) -> None:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
        monkeypatch.setattr(Path, "exists", forbid)
        monkeypatch.setattr(Path, "unlink", forbid)
        with pytest.raises(StoreError, match=r"image\.exr: cannot be written \(Permission denied\)"):
            try_to_write(tmp_path / "image.exr")


@pytest.mark.parametrize("name", ["require_writable", "write_atomically"])
def test_a_folder_that_may_not_be_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str,
) -> None:
    """Simulated, since nothing is forbidden to root."""
    def forbid(self: Path, **_: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
    monkeypatch.setattr(Path, "touch", forbid)
    monkeypatch.setattr(Path, "unlink", forbid)
    with pytest.raises(StoreError, match=r"image\.exr: cannot be written \(Permission denied\)"):
        if name == "require_writable":
            require_writable(tmp_path / "image.exr")
        else:
            with write_atomically(tmp_path / "image.exr") as partial:
                partial.touch()


def test_require_writable_leaves_nothing_behind(tmp_path: Path) -> None:
    require_writable(tmp_path / "image.exr")
    assert names(tmp_path) == []


class TestCreateFiles:
    """New files beside those of others."""

    def test_all_are_written_with_their_folders(self, tmp_path: Path) -> None:
        create_files({tmp_path / "a" / "one": b"1", tmp_path / "two": b"2"})
        assert (tmp_path / "a" / "one").read_bytes() == b"1" and (tmp_path / "two").read_bytes() == b"2"

    @pytest.mark.parametrize("kind", ["file", "folder", "dangling link"])
    def test_where_one_is_taken_none_is_written(self, tmp_path: Path, kind: str) -> None:
        taken = tmp_path / "two"
        {"file": lambda: taken.write_bytes(b"old"), "folder": taken.mkdir,
         "dangling link": lambda: taken.symlink_to("nowhere")}[kind]()
        with pytest.raises(HarnessError, match=r"two: is there already and is left as it is; choose another name"):
            create_files({tmp_path / "one": b"1", taken: b"2"})
        assert names(tmp_path) == ["two"]

    def test_what_was_written_goes_where_a_later_one_cannot_be(self, tmp_path: Path) -> None:
        (tmp_path / "file").touch()
        with pytest.raises(StoreError, match="is not a folder"):
            create_files({tmp_path / "one": b"1", tmp_path / "file" / "two": b"2"})
        assert names(tmp_path) == ["file"]


class TestCacheDir:
    """$HARNESS_CACHE, else the checkout, else the user's cache folder."""

    def test_the_users_choice_wins(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
        assert cache_dir() == tmp_path

    def test_a_checkout_keeps_its_own(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.delenv("HARNESS_CACHE")
        assert cache_dir() == ROOT / "reports" / "out" / "cache"

    def test_an_installed_package_follows_the_xdg_specification(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    ) -> None:
        monkeypatch.delenv("HARNESS_CACHE")
        monkeypatch.setattr(files, "in_checkout", lambda: False)
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        assert cache_dir() == tmp_path / "glsl-validation-harness"
        monkeypatch.setenv("XDG_CACHE_HOME", "")  # empty means unset
        assert cache_dir() == Path.home() / ".cache" / "glsl-validation-harness"


class TestDataDir:
    """Shaders and scenes are found in a checkout and in an installed wheel."""

    def test_finds_the_folders_of_the_checkout(self) -> None:
        assert data_dir("glsl") == ROOT / "glsl"
        assert data_dir("mitsuba_scenes") == ROOT / "mitsuba_scenes"

    def test_an_incomplete_installation_is_one_line(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(files, "in_checkout", lambda: False)
        with pytest.raises(HarnessError, match="install glsl-validation-harness again"):
            data_dir("glsl")

    def test_an_installed_wheel_works_from_any_directory(self, tmp_path: Path) -> None:
        """Every shader and scene is in the wheel, and nothing that was generated."""
        subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path / "wheel")],
                       cwd=ROOT, check=True, capture_output=True)
        [wheel] = (tmp_path / "wheel").iterdir()
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(tmp_path / "site")
        program = "from harness.files import *; print(data_dir('glsl'), data_dir('mitsuba_scenes'))"
        found = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True, capture_output=True,
                               text=True, env={**os.environ, "PYTHONPATH": str(tmp_path / "site")}).stdout.split()
        data = tmp_path / "site" / "harness" / "_data"
        assert found == [str(data / "glsl"), str(data / "mitsuba_scenes")]
        for folder in ("glsl", "mitsuba_scenes"):
            here = {path.relative_to(ROOT) for path in (ROOT / folder).rglob("*") if path.is_file()}
            assert {path.relative_to(data) for path in (data / folder).rglob("*") if path.is_file()} == here
        for path in (path for kind in ("css", "html", "toml") for path in (ROOT / "harness").rglob(f"*.{kind}")):
            assert (tmp_path / "site" / path.relative_to(ROOT)).read_bytes() == path.read_bytes(), "read at run time"
        assert not (data / "reports" / "out").exists()
