"""Interruption of long searches by whoever waits for them, such as a time limit, without handing it down to each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


def _nothing() -> None:
    pass


_check: ContextVar[Callable[[], None]] = ContextVar("check", default=_nothing)


def check_for_interruption() -> None:
    """Raise what the innermost `interrupted_by` raises, if it does; searches call this in each of their iterations."""
    _check.get()()


@contextmanager
def interrupted_by(check: Callable[[], None]) -> Iterator[None]:
    """Have searches within call ``check`` now and then, which raises an error to end them."""
    token = _check.set(check)
    try:
        yield
    finally:
        _check.reset(token)
