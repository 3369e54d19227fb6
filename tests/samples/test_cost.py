"""What samples cost: the clock that counts, sums within a device, and nothing across devices."""

from __future__ import annotations

import math

from harness.samples import cost
from harness.samples.cost import Cost, Watch, total

CPU = Cost(2.0, 3.0, None, "cpu: a", "cpu")
GPU = Cost(2.0, 0.1, 1.5, "a card", "gpu")


def test_the_clock_that_counts_is_the_devices() -> None:
    assert (CPU.seconds, GPU.seconds) == (3.0, 1.5)
    assert math.isnan(Cost(2.0, 0.1, None, "a card", "gpu").seconds), "never another clock in its place"


def test_costs_on_one_device_add_up() -> None:
    assert total([CPU, CPU]) == Cost(4.0, 6.0, None, "cpu: a", "cpu")
    assert Cost(4.0, 0.2, 3.0, "a card", "gpu") == GPU + GPU


def test_costs_on_two_devices_are_unknown() -> None:
    for found in (CPU + GPU, CPU + Cost(2.0, 3.0, None, "cpu: b", "cpu"), CPU + Cost.unknown(),
                  Cost.unknown() + CPU, Cost.unknown() + Cost.unknown(), total([]), total([CPU, GPU, CPU])):
        assert found.device == "" and math.isnan(found.seconds)


def test_a_watch_reads_the_clocks_since_it_was_made() -> None:
    spent = Watch().cost(cost.cpu())
    assert spent.device.startswith("cpu: ") and len(spent.device) > len("cpu: ")
    assert spent.wall >= 0 and spent.seconds == spent.cpu >= 0
