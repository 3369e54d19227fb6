"""Samples a frame: where a text says their number, and what stacks with several numbers say."""

from __future__ import annotations

import numpy as np
import pytest

from harness.shader.hosts.written import sample_counts, written_samples
from harness.strangers.counts import COUNTS, read_counts, varied
from harness.strangers.law import radiance_pass
from tests.support.handmade import shadertoy

RNG = np.random.default_rng(11)
FRAMES, SIZE = 48, (6, 8)


def stack(count: int, *, curve: bool = False, shared: bool = False, summed: bool = False) -> np.ndarray:
    """Frames of so many samples each, exponentially distributed: their mean, or what somebody does to it."""
    draws = RNG.exponential(size=(FRAMES, *SIZE, 1 if shared else count)).mean(-1)
    draws = draws / (1 + draws) if curve else draws * count if summed else draws
    return np.repeat(draws[..., None], 3, axis=-1)


@pytest.mark.parametrize(("text", "count"), [
    ("#define SAMPLES 4\n", 4), ("const int spp = 16;", 16), ("uniform int samples_per_pass = 8;", 8),
    ("#define RAYS_PER_PIXEL 2\n", 2), ("const int SAMPLE_PER_PIXEL=1;", 1), ("#define SAMPLES_PER_FRAME   12\n", 12),
    ("int samples = 4;", 1), ("#define SAMPLES 4\n#define SPP 2\n", 1), ("#define MAX_DEPTH 4\n", 1),
])
def test_the_number_is_found_where_a_text_says_it_once(text: str, count: int) -> None:
    assert written_samples(text) == count
    for start, end, number in sample_counts(text):
        assert text[start:end] == str(number)


def test_only_the_number_changes() -> None:
    contract = shadertoy("const int SAMPLES = 3;\nvoid mainImage(out vec4 c, in vec2 p) { c = vec4(SAMPLES); }")
    trials = varied(contract)
    assert [trial.samples for trial in trials] == sorted({*COUNTS, 3})
    own = radiance_pass(contract).source.text
    for trial in trials:
        assert radiance_pass(trial.contract).source.text == own.replace("SAMPLES = 3", f"SAMPLES = {trial.samples}")
        assert trial.where.startswith("BufferA.glsl:")
    assert varied(shadertoy("void mainImage(out vec4 c, in vec2 p) { c = vec4(1.0); }")) == []


def test_right_frames_have_one_mean_and_the_noise_of_their_samples() -> None:
    read = read_counts(COUNTS, [stack(count) for count in COUNTS])
    assert read.linear and not read.summed
    assert 40 < read.worth < 100
    assert read.told.startswith(f"{read.means[0]:.4g} with 1, ")


def test_a_curve_shows_in_the_means() -> None:
    assert not read_counts(COUNTS, [stack(count, curve=True) for count in COUNTS]).linear


def test_a_sum_is_told_from_a_curve() -> None:
    read = read_counts(COUNTS, [stack(count, summed=True) for count in COUNTS])
    assert read.linear and read.summed
    assert 40 < read.worth < 100


def test_shared_numbers_are_worth_one_sample() -> None:
    assert read_counts(COUNTS, [stack(count, shared=True) for count in COUNTS]).worth < 2


def test_without_noise_nothing_is_said_of_it() -> None:
    flat = np.ones((FRAMES, *SIZE, 3))
    read = read_counts((1, 4), [flat, flat])
    assert read.linear and np.isnan(read.worth)
