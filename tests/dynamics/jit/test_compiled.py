"""Compiling leaves the collector of garbage as it was."""

import gc
from collections.abc import Iterator

import numba
import pytest
from numba.core import event

from pipeline.dynamics.jit import compiled


class Watch(event.Listener):
    """Notes whether garbage is collected while something compiles."""

    def __init__(self) -> None:
        self.seen: list[bool] = []

    def on_start(self, event: event.Event) -> None:
        self.seen.append(gc.isenabled())

    def on_end(self, event: event.Event) -> None:
        self.seen.append(gc.isenabled())


@pytest.fixture
def watch() -> Iterator[Watch]:
    with event.install_listener("numba:compile", Watch()) as listener:
        yield listener


def outer(x: float) -> float:
    return inner(x) + 1.0


inner = numba.njit(lambda x: 2.0 * x)


@pytest.mark.parametrize("on", [True, False])
def test_nothing_is_collected_while_kernels_compile(watch: Watch, on: bool) -> None:
    assert compiled.kernel
    if not on:
        gc.disable()
    try:
        assert numba.njit(outer)(1.0 if on else 1) == 3.0
        assert watch.seen[:3] == [False, False, False]  # the kernel, the one that it needs, and that one's end
        assert gc.isenabled() == on
    finally:
        gc.enable()


def test_a_kernel_that_cannot_be_compiled_leaves_it_on() -> None:
    with pytest.raises(numba.TypingError):
        numba.njit(lambda x: x.nothing)(1.0)
    assert gc.isenabled()
