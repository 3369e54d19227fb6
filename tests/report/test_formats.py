"""Numbers are printed as finely as their intervals deserve, with true minus signs, and never as nan."""

from __future__ import annotations

import math

import pytest

from harness.report import formats


def plain(text: str) -> str:
    """No-break spaces as spaces, to be readable here."""
    return text.replace(formats.NBSP, " ")


@pytest.mark.parametrize(("value", "low", "high", "text"), [
    (0.0003, -0.0002, 0.0008, "+0.030 % ± 0.050 %"),
    (-0.0123, -0.0143, -0.0103, "−1.230 % ± 0.200 %"),
    (0.571, 0.541, 0.601, "+57 % ± 3 %"),
    (0.0000001, -0.0001, 0.0001, "0.000 % ± 0.010 %"),
    (-0.0000001, -0.0001, 0.0001, "0.000 % ± 0.010 %"),
    (0.03, 0.01, 0.09, "+3.0 % [+1.0, +9.0] %"),
    (0.0, 0.0, 0.0, "0.000 % ± 0.000 %"),
    (0.0003, math.nan, math.nan, "+0.030 %"),
    (math.nan, math.nan, math.nan, "–"),
])
def test_percent_interval(value: float, low: float, high: float, text: str) -> None:
    assert plain(formats.percent_interval(value, low, high)) == text


@pytest.mark.parametrize(("value", "low", "high", "text"), [
    (5.13, 4.4, 5.9, "5.1 × [4.4, 5.9]"),
    (20.912, 20.77, 21.13, "20.9 × [20.8, 21.1]"),
    (21.0, 15.2, 30.1, "21 × [15, 30]"),
    (0.0512, 0.0501, 0.0523, "0.051 × [0.050, 0.052]"),
    (20.912, 20.9119, 20.9121, "20.9 × [20.9, 20.9]"),
    (8.4, 2.0, 40.0, "8.4 × [2.0, 40.0]"),
    (5.0, 5.0, 5.0, "5.00 × [5.00, 5.00]"),
    (1234.0, 1100.0, 1400.0, "1,200 × [1,100, 1,400]"),
    (7.0, 0.0, math.inf, "7.00 ×"),
    (math.inf, math.inf, math.inf, "–"),
    (math.nan, math.nan, math.nan, "–"),
])
def test_ratio(value: float, low: float, high: float, text: str) -> None:
    assert plain(formats.ratio(value, low, high)) == text


@pytest.mark.parametrize(("seconds", "text"), [
    (0.0000123, "12.3 µs"), (0.45e-3, "450 µs"), (0.012, "12.0 ms"), (3.2, "3.20 s"), (119.0, "119 s"),
    (750.0, "12.5 min"), (7560.0, "2.10 h"), (math.nan, "–")])
def test_duration_is_in_the_unit_a_reader_thinks_in(seconds: float, text: str) -> None:
    assert plain(formats.duration(seconds)) == text


@pytest.mark.parametrize(("value", "text"), [
    (0.0, "0"), (0.04692, "0.0469"), (123456.0, "123,000"), (1.2e-7, "1.20×10⁻⁷"), (9.999, "10.0"), (-2.0, "−2.00"),
    (math.inf, "–")])
def test_significant(value: float, text: str) -> None:
    assert formats.significant(value) == text


def test_words_of_others_become_sentences() -> None:
    assert formats.sentence("filter 'gaussian' replaced") == "Filter 'gaussian' replaced."
    assert formats.sentence("Done.") == "Done."
    assert plain(formats.typographic("red -0.0358 % ± 0.1 %, a-b, 2-3")) == "red −0.0358 % ± 0.1 %, a-b, 2-3"


def test_lists_and_counts_read_well() -> None:
    assert [formats.words(names) for names in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == ["", "a", "a and b",
                                                                                            "a, b and c"]
    assert [plain(formats.span(numbers, "replica")) for numbers in ([1], [8, 8], [8, 64])] == [
        "1 replica", "8 replicas", "8 to 64 replicas"]
