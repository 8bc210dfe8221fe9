"""Errors that a user can meet, and how the command line ends with each."""

from __future__ import annotations


class InputError(Exception):
    """A scene, a file or an option is wrong; the command line ends with exit status 2.

    Parameters
    ----------
    file : str
        The file (or command-line option) at fault.
    key : str
        Dotted path of the value in it, e.g. ``body.beam.length``; may be empty.
    value : object
        The offending value; ``None`` if there is none.
    mend : str
        Fault and mend: what is wrong and what would work.
    """

    def __init__(self, file: str, key: str, value: object, mend: str) -> None:
        self.file, self.key, self.value, self.mend = file, key, value, mend
        place = f"{file}: {key}" if key else file
        given = "" if value is None else f" = {value!r}"
        super().__init__(f"{place}{given}: {mend}")


class AccuracyError(Exception):
    """A computed number failed its check and can't be trusted; the command line ends with exit status 3."""


class InertiaError(AccuracyError):
    """A motion has lost its inertia, so that the mass matrix isn't positive definite."""


class StabilityError(AccuracyError):
    """A time step is beyond the stability limit or passes a force unseen, or a march diverged.

    Parameters
    ----------
    message : str
        What happened.
    time : float
        Time at which a march ended [s].
    positions : object
        Its positions there, an array; None if they aren't known.
    """

    def __init__(self, message: str, time: float = 0.0, positions: object = None) -> None:
        super().__init__(message)
        self.time, self.positions = time, positions
