"""What is made once is read back, and made again where it was lost or damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.errors import StoreError
from harness.samples.memo import ASIDE, remembered, remembered_bytes, seconds_to_make


class TestFolders:
    """Results of several files: the last one written says that all are there."""

    @staticmethod
    def recall(folder: Path, told: list[str]) -> tuple[str, bool]:
        def load(folder: Path) -> str:
            text = (folder / "last").read_text(encoding="utf-8")
            if text == "damaged":
                raise StoreError(f"{folder}: damaged; remove it")
            return text

        def save(result: str, folder: Path) -> None:
            folder.mkdir(exist_ok=True)
            (folder / "last").write_text(result, encoding="utf-8")

        return remembered(folder, "last", load=load, make=lambda: "new", save=save, warn=told.append, loss="made again")

    def test_made_once(self, tmp_path: Path) -> None:
        told: list[str] = []
        assert self.recall(tmp_path / "a", told) == ("new", True)
        took = seconds_to_make(tmp_path / "a")
        assert self.recall(tmp_path / "a", told) == ("new", False)
        assert told == []
        assert took is not None and took == seconds_to_make(tmp_path / "a")

    def test_of_what_was_made_elsewhere_no_time_is_known(self, tmp_path: Path) -> None:
        assert seconds_to_make(tmp_path) is None

    def test_a_folder_without_its_last_file_is_nothing(self, tmp_path: Path) -> None:
        (tmp_path / "a").mkdir()
        assert self.recall(tmp_path / "a", []) == ("new", True)

    def test_damage_is_told_in_one_line(self, tmp_path: Path) -> None:
        told: list[str] = []
        self.recall(tmp_path / "a", told)
        (tmp_path / "a" / "last").write_text("damaged", encoding="utf-8")
        assert self.recall(tmp_path / "a", told) == ("new", True)
        assert told == [f"{tmp_path / 'a'}: damaged; made again"]


class TestBytes:
    """Small files by their key."""

    @pytest.fixture(autouse=True)
    def cache(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
        return tmp_path / "cache" / "figures"

    def test_made_once_a_key(self) -> None:
        made = [remembered_bytes("figures", key, lambda content=content: content)  # type: ignore[misc]
                for key, content in (({"a": 1}, b"one"), ({"a": 1}, b"two"), ({"a": 2}, b"two"))]
        assert made == [b"one", b"one", b"two"]

    @pytest.mark.parametrize("damage", [b"", b"short", b"x" * 40])
    def test_damaged_ones_are_set_aside_and_made_again(self, cache: Path, damage: bytes) -> None:
        remembered_bytes("figures", "key", lambda: b"one")
        file, = cache.iterdir()
        file.write_bytes(damage)
        assert remembered_bytes("figures", "key", lambda: b"two") == b"two"
        assert remembered_bytes("figures", "key", lambda: b"three") == b"two"
        assert file.with_name(file.name + ASIDE).read_bytes() == damage

    def test_a_cache_that_cannot_be_written_costs_only_time(self, tmp_path: Path) -> None:
        (tmp_path / "cache").touch()
        assert remembered_bytes("figures", "key", lambda: b"one") == b"one"
