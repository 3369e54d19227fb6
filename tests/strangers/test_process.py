"""The child process: what it draws, what it may not take, and how it is lost."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from harness.errors import ShaderError
from harness.gpu.frames import Frames, Moment
from harness.shader.contract import Law
from harness.strangers.process import KEPT, Limits, Process
from harness.strangers.single import draw_singles, loop
from tests.support.handmade import MEAN, SUM, gratin, shadertoy

SIZE = (16, 12)
LAW = Law("sum", count="alpha")
# A frame that takes minutes.
ENDLESS = gratin("void main() { float x = 0.0; while (x < 9.0) { "
                 f"{'x = sin(x + gl_FragCoord.x);' * 200} }} outBuffer0 = vec4(x); }}")


def test_draws_what_frames_draw(process: Process) -> None:
    contract = shadertoy(MEAN)
    process.open(contract, SIZE)
    here = Frames(contract, SIZE)
    for source in (process, here):
        source.clear()
        source.frame(Moment.of(0, 0))
        source.frame(Moment.of(1, 1))
    assert np.array_equal(process.read("Buffer A"), here.read("Buffer A"))
    assert np.array_equal(process.loop(5), loop(here, 5))
    alone, ours = process.singles(Law("mean"), range(3, 9), keep=True), draw_singles(here, Law("mean"), range(3, 9))
    assert np.array_equal(alone.sum, ours.sum)
    assert alone.stack is not None and alone.stack.shape == (6, 12, 16, 3)
    assert np.allclose(alone.stack.sum(axis=0), ours.sum)


def test_counts_what_is_not_finite(process: Process) -> None:
    half = SUM.replace("outBuffer0 = old +", "outBuffer0 = p.x < 8u ? vec4(sqrt(-1.0 - rnd())) : old +")
    process.open(gratin(half), SIZE)
    found = process.singles(LAW, range(1, 5))
    assert found.rejected == 4 * 8 * 12
    assert np.isfinite(found.mean).all() and not found.mean[:, :8].any()


def test_leaves_what_it_is_given(process: Process) -> None:
    process.open(gratin("void main() { outBuffer0 = 2.0 * texelFetch(pingpong0, ivec2(gl_FragCoord.xy), 0); }"), SIZE)
    past = np.random.default_rng(1).random((12, 16, 4)).astype(np.float32)
    process.write("pingpong", past)
    process.frame(Moment.of(0, 0))
    assert np.array_equal(process.read("pingpong"), 2.0 * past)


def test_a_frame_that_takes_too_long_ends_it_and_the_next_shader_has_a_new_one() -> None:
    with Process(Limits(first=1.0, least=1.0, threads=1)) as process:
        process.open(ENDLESS, SIZE)
        with pytest.raises(ShaderError, match=r"^body\.frag: a frame takes longer than 1 s and was ended"):
            process.frame(Moment.of(0, 0))
        process.limits = Limits()
        assert process.open(gratin(SUM), SIZE).singles(LAW, [1]).rejected == 0


def test_a_child_that_is_killed_is_told_and_replaced() -> None:
    with Process() as process:
        process.open(gratin(SUM), SIZE)
        os.kill(process.pid, signal.SIGKILL)
        with pytest.raises(ShaderError, match="crashes the driver"):
            process.frame(Moment.of(0, 0))
        process.open(gratin(SUM), SIZE).frame(Moment.of(0, 0))


def test_an_order_that_a_dead_child_left_unread_keeps_nobody_from_closing() -> None:
    process = Process()
    process.open(gratin(SUM), SIZE)
    child = process._child
    assert child is not None and child.stdin is not None
    child.stdin.write(b"{}")
    os.kill(process.pid, signal.SIGKILL)
    child.wait()
    process.close()
    assert child.stdin.closed


def test_has_nothing_of_ours_but_what_the_driver_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SECRET_TOKEN", "x")
    with Process() as process:
        process.open(gratin(SUM), SIZE)
        told = Path(f"/proc/{process.pid}/environ").read_bytes().split(b"\0")
        names = {entry.partition(b"=")[0].decode() for entry in told if entry}
        folder = Path(f"/proc/{process.pid}/cwd").resolve()
        limits = Path(f"/proc/{process.pid}/limits").read_text(encoding="ascii")
        assert os.getpgid(process.pid) == process.pid
    assert names - {"PYTHONPATH", "HOME", "TMPDIR", "LANG"} == {name for name in names if name.startswith(KEPT)}
    assert folder.name.startswith("harness-stranger-") and not folder.exists()
    for limit in ("Max address space", "Max data size"):
        assert limit in limits
    assert "Max core file size        0 " in limits
    assert "unlimited" not in next(line for line in limits.splitlines() if line.startswith("Max file size"))


def test_takes_no_more_memory_than_it_may() -> None:
    with Process(Limits(memory=1 << 26)) as process, pytest.raises(ShaderError, match=r"memory|crashes"):
        process.open(gratin(SUM), (4096, 4096))


def test_is_gone_afterwards() -> None:
    with Process() as process:
        process.open(gratin(SUM), SIZE)
        number = process.pid
    assert not Path(f"/proc/{number}").exists()
