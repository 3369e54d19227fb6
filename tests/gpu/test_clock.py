"""On hardware the clock that counts is the device's: timer queries about each draw (here stand-ins)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import moderngl
import pytest

from harness.gpu import context, pingpong, renderer
from harness.gpu.context import device
from harness.gpu.device import Device
from harness.scene import load_scene
from harness.scene.strategies import STRATEGIES
from harness.work.batches import render_estimate

SKY = Path(__file__).parents[2] / "mitsuba_scenes" / "furnace_convex.xml"
# Of one draw, in nanoseconds as GL counts; far more than any draw here takes.
ELAPSED = 3_000_000_000
CARD = {"GL_RENDERER": "A Card 4000/PCIe", "GL_VERSION": "4.6.0", "GL_VENDOR": "A Card Corporation"}


class Query:
    """A timer query; `made` are all of them."""

    made: ClassVar[list[Query]] = []

    def __init__(self) -> None:
        self.made.append(self)
        self.state = "new"

    def __enter__(self) -> Query:
        self.state = "running"
        return self

    def __exit__(self, *error: object) -> None:
        self.state = "done"

    @property
    def elapsed(self) -> int:
        assert self.state == "done"
        return ELAPSED


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Iterator[Device]:
    """The profile of a card, with this driver's limits; each draw between the ends of a query."""
    profile = dataclasses.replace(Device.of(CARD), least_rows=device().least_rows)
    for module in (pingpong, renderer):
        monkeypatch.setattr(module, "device", lambda: profile)

    def query(self: moderngl.Context, *, time: bool = False) -> Query:
        assert time
        return Query()

    drawn = context.Program.draw

    def draw(self: context.Program) -> None:
        assert Query.made[-1].state == "running"
        drawn(self)

    monkeypatch.setattr(moderngl.Context, "query", query)
    monkeypatch.setattr(context.Program, "draw", draw)
    monkeypatch.setattr(pingpong, "STUCK_SECONDS", 1e9)  # three seconds a draw would be an endless loop
    monkeypatch.setattr(Query, "made", [])
    yield profile


def test_is_by_the_name_of_the_device() -> None:
    assert Device.of(CARD).clock == "gpu"
    assert Device.of({**CARD, "GL_RENDERER": "llvmpipe (LLVM 15.0.6, 256 bits)"}).clock == "cpu"


def test_is_read_about_every_draw_of_a_batch(card: Device) -> None:
    tracer = renderer.TracerRenderer(load_scene(SKY, width=8, height=6), STRATEGIES[0])
    first = tracer.render_batch(0, 0, 200)  # two passes at the least
    draws = len(Query.made)
    again = tracer.render_batch(1, 0, 200)
    tracer.release()
    assert draws >= 2 and len(Query.made) > draws
    assert (first.cost.clock, first.cost.device) == ("gpu", card.name)
    assert first.cost.seconds == first.cost.gpu == pytest.approx(3.0 * draws)
    assert again.cost.seconds == pytest.approx(3.0 * (len(Query.made) - draws)), "of this batch alone"
    assert first.cost.wall < first.cost.seconds and first.cost.cpu < first.cost.seconds


def test_counts_in_all_that_is_made_of_batches(card: Device) -> None:
    """Seconds of the card add up over batches, and what the process spent beside them is not among them."""
    tracer = renderer.TracerRenderer(load_scene(SKY, width=8, height=6), STRATEGIES[0])
    cost = render_estimate(tracer, 64).cost
    tracer.release()
    assert (cost.clock, cost.device, cost.seconds) == ("gpu", card.name, pytest.approx(3.0 * len(Query.made)))


def test_finds_an_endless_loop_by_the_cards_seconds(card: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long the process waited beside it."""
    from harness.errors import ShaderError

    monkeypatch.setattr(pingpong, "STUCK_SECONDS", 2.0)
    tracer = renderer.TracerRenderer(load_scene(SKY, width=8, height=6), STRATEGIES[0])
    with pytest.raises(ShaderError, match="as with a loop without end"):
        tracer.render_batch(0, 0, 200)
    tracer.release()
