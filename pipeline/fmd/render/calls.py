"""Calls of drawing functions by name, so that another process can make them and nothing heavy is loaded here."""

from importlib import import_module
from typing import Any, Protocol


class Drawer(Protocol):
    """Takes calls of the functions of `fmd.render`, to be made at once or later, here or elsewhere."""

    def __call__(self, function: str, *arguments: Any, **settings: Any) -> None:
        """Take the call of a function, named by module and name, e.g. ``"pictures.draw_mode"``."""


def draw_here(function: str, *arguments: Any, **settings: Any) -> None:
    """Call a function of `fmd.render` at once in this process."""
    module, _, name = function.partition(".")
    getattr(import_module(f"fmd.render.{module}"), name)(*arguments, **settings)
