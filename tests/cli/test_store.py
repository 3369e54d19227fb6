"""`harness store`: what is listed, statuses, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from harness.samples import store
from tests.cli.conftest import Harness, refusal


@pytest.fixture
def rendered(harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache with four batches of one render; its folder. However busy the machine is, they are of one size."""
    monkeypatch.setattr(store, "COMPACT_FROM", 0.0)
    assert harness("render", sky, "--spp", 8, "-o", "sky.exr").status == 0
    return sky.parent / "cache" / "batches"


def test_list_tells_a_series_a_line(harness: Harness, rendered: Path) -> None:
    heading, line, whole = harness("store", "list").out.splitlines()
    assert heading.split() == ["scene", "estimator", "samples", "size", "last", "use"]
    assert re.fullmatch(r"sky +mixture +8 +[\d.]+ kB +\d{4}-\d\d-\d\d \d\d:\d\d", line)
    assert whole.startswith(f"{rendered}: ") and "in 4 files of 1 series" in whole
    (one,) = harness("store", "list", "--json").json["series"]
    assert (one["scene"], one["estimator"], one["samples"], one["batches"]) == ("sky", "mixture", 8, 4)


def test_an_empty_one_is_told(harness: Harness) -> None:
    assert "0 B in 0 files of 0 series" in harness("store", "list").out
    assert harness("store", "verify").status == 0


def test_verify_is_1_where_a_batch_is_damaged_and_0_afterwards(harness: Harness, rendered: Path, sky: Path) -> None:
    assert harness("store", "verify").status == 0
    damaged = next(rendered.rglob("0-4-4.exr"))
    damaged.write_bytes(damaged.read_bytes()[:-1])
    done = harness("store", "verify", "--json")
    assert done.status == 1
    assert (done.json["read"], done.json["set_aside"]) == (4, [str(damaged)])
    assert harness("store", "verify").status == 0
    assert harness("render", sky, "--spp", 8, "-o", "sky.exr").status == 0
    assert damaged.exists(), "rendered again"


def test_prune_removes_what_it_is_told_to(harness: Harness, rendered: Path) -> None:
    assert harness("store", "prune", "--older", "1h", "--json").json["removed"] == 0
    done = harness("store", "prune", "--keep", "1.5kB", "--json").json
    assert 0 < done["bytes"] <= 1500 and done["removed"] > 0
    assert harness("store", "prune", "--keep", "0").status == 0
    assert not list(rendered.rglob("*.exr"))


def test_what_is_made_of_batches_is_listed_and_pruned(harness: Harness, rendered: Path) -> None:
    figure = rendered.parent / "figures" / "0123"
    figure.parent.mkdir()
    figure.write_bytes(b"x" * 2000)
    assert re.search(r"figures of a report +- +2 kB", harness("store", "list").out)
    harness("store", "prune", "--keep", "3kB")
    assert not figure.exists() and list(rendered.rglob("*.exr")), "batches took longer to draw"


@pytest.mark.parametrize(("arguments", "said"), [
    (("prune",), "say what is to go: --older 30d"),
    (("list", "--keep", "1GB"), "--older and --keep are for `harness store prune`"),
    (("prune", "--keep", "5 bits"), "--keep: expected a number and a unit, such as 500MB or 5GB; found '5 bits'"),
    (("prune", "--older", "-3d"), "--older: expected a number and a unit, such as 12h, 30d or 8w; found '-3d'"),
    (("shrink",), "'shrink'"),
])
def test_what_it_does_not_understand_is_refused(harness: Harness, arguments: tuple[str, ...], said: str) -> None:
    assert said in refusal(harness("store", *arguments))
