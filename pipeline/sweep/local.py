"""Points on this machine: one process for each core, and a new one for one that dies."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING

from pipeline.sweep.record import Record, broken_off

if TYPE_CHECKING:
    from pipeline.scene.scene import Scene

_TRIES = 2
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class _Worker:
    """A process that computes the scenes it is sent, one by one."""

    def __init__(self) -> None:
        spawn = multiprocessing.get_context("spawn")  # a fork would take over locks and the threads of BLAS
        self.line, theirs = spawn.Pipe()
        self.process = spawn.Process(target=_serve, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()  # so that the line ends when the process does

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.line.close()


def on_this_machine(scenes: Mapping[str, Scene], workers: int) -> Iterator[tuple[str, Record]]:
    """Compute scenes in processes of one thread each; yield key and record of each as it is done.

    A scene whose process dies is tried once more. If this process dies, so do those.
    """
    waiting, tries = deque(scenes), Counter[str]()
    idle = [_Worker() for _ in range(min(workers, len(scenes)))]
    working: dict[Connection, tuple[_Worker, str]] = {}
    try:
        while waiting or working:
            while waiting and idle:
                worker, key = idle.pop(), waiting.popleft()
                if not worker.process.is_alive():  # it died after its last scene
                    worker.stop()
                    worker = _Worker()
                tries[key] += 1
                with suppress(OSError):  # it died just now: its line has ended, as is found below
                    worker.line.send((key, scenes[key]))
                working[worker.line] = worker, key
            for line in wait(list(working)):
                assert isinstance(line, Connection)
                worker, key = working.pop(line)
                try:
                    record: Record = line.recv()
                except (EOFError, OSError):
                    worker.stop()
                    worker = _Worker()
                    if tries[key] < _TRIES:
                        waiting.append(key)
                        idle.append(worker)
                        continue
                    record = broken_off(f"its process died, {_TRIES} times; short of memory?")
                idle.append(worker)
                yield key, record
    finally:
        for worker in [*idle, *(worker for worker, _ in working.values())]:
            worker.stop()


def _serve(line: Connection) -> None:
    """Answer each scene with its record, until the line ends."""
    os.environ |= dict.fromkeys(_THREADS, "1")  # before NumPy is loaded
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which stops its workers
    threading.Thread(target=_die_with_parent, daemon=True).start()
    while True:
        try:
            key, scene = line.recv()
        except EOFError:
            return
        from pipeline.sweep.work import compute

        line.send(compute(key, scene))


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
