"""Drawing in another process, while this one computes."""

from __future__ import annotations

import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from fmd.core.encoding import decode, encode
from fmd.core.errors import InputError
from fmd.core.processes import describe_end, start_child
from fmd.render.rendering_check import MEND, TIMEOUT, describe_failure


class DrawingProcess:
    """Makes the calls that it is given one after the other in a process of its own, which ends with the context."""

    def __init__(self, scene_file: str) -> None:
        self._scene_file = scene_file
        self._process: subprocess.Popen[str] | None = None
        self._is_ready = False
        self._calls: list[Path] = []
        self._n_calls = 0

    def __enter__(self) -> DrawingProcess:
        self._folder = tempfile.TemporaryDirectory(prefix="fmd-")
        self._errors: IO[str] = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
        self._errors.close()
        self._folder.cleanup()

    @property
    def folder(self) -> Path:
        """Temporary folder for calls and pictures."""
        return Path(self._folder.name)

    def start(self) -> None:
        """Start the process, unless it runs; it loads its libraries and draws something for a start."""
        if self._process is None:
            pipes: dict[str, Any] = {
                "stdin": subprocess.PIPE,
                "stdout": subprocess.PIPE,
                "stderr": self._errors.fileno(),
            }
            self._process = start_child("fmd.render.drawing_server:serve", **pipes)

    def require_ready(self) -> None:
        """Wait until the process has drawn something.

        Raises
        ------
        InputError
            This machine can't draw; the message names the remedy.
        """
        if self._process is not None and not self._is_ready:
            timer = threading.Timer(TIMEOUT, self._process.kill)
            timer.start()
            try:
                self._is_ready = self._answer() == "ready"
            finally:
                timer.cancel()

    def __call__(self, function: str, *arguments: Any, **settings: Any) -> None:
        """Take the call of a function of `fmd.render`, named as for `draw_here`."""
        self.start()
        self.require_ready()
        assert self._process is not None
        assert self._process.stdin is not None
        self._n_calls += 1
        path = self.folder / f"{self._n_calls}.call"
        path.write_bytes(encode((function, arguments, settings)))
        try:
            self._process.stdin.write(f"{path}\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise self._ended() from None
        self._calls.append(path)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Hold the process up, so that it takes no time from what is timed here."""
        stops = self._process is not None and self._process.poll() is None and hasattr(signal, "SIGSTOP")
        if not stops:  # as on Windows
            self.finish()
            yield
            return
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def finish(self) -> None:
        """Wait until all calls have been made.

        Raises
        ------
        Exception
            The error of a call that failed.
        InputError
            The process has died.
        """
        while self._calls:
            answer, path = self._answer(), self._calls.pop(0)
            if answer != "done":
                kind, said = decode(path.read_bytes())
                raise {"OSError": OSError, "ValueError": ValueError}.get(kind, RuntimeError)(said)
            path.unlink()

    def _answer(self) -> str:
        assert self._process is not None
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise self._ended()
        return line.strip()

    def _ended(self) -> InputError:
        """Make the error of a process that has ended by itself."""
        assert self._process is not None
        status = self._process.wait()
        self._errors.seek(0)
        reason = f"{describe_failure(describe_end(status, self._errors.read()))}; {MEND} (or run with --no-pictures)"
        return InputError(self._scene_file, "output", None, f"this machine can't draw: {reason}")
