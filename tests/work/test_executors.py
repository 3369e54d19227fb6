"""Executors: the same results wherever the work is done, and errors that come home."""

from __future__ import annotations

import os

import pytest

from harness.errors import HarnessError, SceneError
from harness.work.executors import EXECUTORS, executor
from harness.work.executors.processes import ONE_THREAD, Processes


def square(number: int) -> int:
    return number * number


def picky(number: int) -> int:
    if number == 3:
        raise SceneError("three.xml:3: no such scene file")
    return number


def process(number: int) -> tuple[int, str | None]:
    """The process, and what its libraries were told of threads."""
    return os.getpid(), os.environ.get("OPENBLAS_NUM_THREADS")


def mark() -> None:
    os.environ["HARNESS_TEST_MARK"] = "prepared"


def marked(number: int) -> str | None:
    return os.environ.get("HARNESS_TEST_MARK")


@pytest.mark.parametrize("name", EXECUTORS)
def test_results_come_in_the_order_of_the_work(name: str) -> None:
    with executor(name, 2) as workers:
        assert list(workers.map(square, range(20))) == [number**2 for number in range(20)]


@pytest.mark.parametrize("name", EXECUTORS)
def test_an_error_comes_where_its_result_would(name: str) -> None:
    with executor(name, 2) as workers:
        results = workers.map(picky, range(5))
        assert [next(results) for _ in range(3)] == [0, 1, 2]
        with pytest.raises(SceneError, match=r"three\.xml:3: no such scene file"):
            next(results)


@pytest.mark.parametrize("name", EXECUTORS)
def test_a_worker_prepares_itself_first(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HARNESS_TEST_MARK", "not yet")
    with executor(name, 1, mark) as workers:
        assert list(workers.map(marked, range(2))) == ["prepared"] * 2


def test_processes_are_others_and_have_one_thread_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what was set in this one for them is gone afterwards."""
    for name in ONE_THREAD:
        monkeypatch.delenv(name, raising=False)
    with Processes(2) as workers:
        found = list(workers.map(process, range(4)))
    assert os.getpid() not in {number for number, _ in found}
    assert {threads for _, threads in found} == {"1"}
    assert not set(ONE_THREAD) & set(os.environ)


def test_what_the_user_set_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    with Processes(1) as workers:
        (_, threads), = workers.map(process, range(1))
    assert threads == "3"
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"


def test_an_unknown_one_is_refused() -> None:
    with pytest.raises(HarnessError, match="unknown executor 'slurms'; choose from serial, processes"):
        executor("slurms")
