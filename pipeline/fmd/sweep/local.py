"""Points on this machine: one process for each core, and a new one in place of one that dies.

A pool of loky or of ``concurrent.futures`` breaks as a whole when one of its processes dies, and doesn't say which
scene that process had; Dask's local cluster does, but takes seconds to start and fifteen more packages.
"""

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

from fmd.core.limits.patience import POINT_TRIES
from fmd.sweep.record import Record, Wanted, interrupted_record

if TYPE_CHECKING:
    from fmd.scene.scene import Scene

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class _Worker:
    """A process that computes the scenes sent to it, one by one."""

    def __init__(self) -> None:
        spawn = multiprocessing.get_context("spawn")  # a fork would take over locks and the threads of BLAS
        self.connection, theirs = spawn.Pipe()
        self.process = spawn.Process(target=_serve, args=(theirs,), daemon=True)
        os.environ["PYTHONSAFEPATH"] = "1"  # it imports nothing from the working folder
        self.process.start()
        theirs.close()  # so that this end reads the end of the file when the process dies

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.connection.close()


def compute_locally(scenes: Mapping[str, Scene], workers: int, wanted: Wanted) -> Iterator[tuple[str, Record]]:
    """Compute scenes in processes of one thread each; yield key and record of each as it is done.

    A scene whose process dies is tried once more. If this process dies, its workers die too.
    """
    waiting, tries = deque(scenes), Counter[str]()
    idle = [_Worker() for _ in range(min(workers, len(scenes)))]
    busy: dict[Connection, tuple[_Worker, str]] = {}
    try:
        while waiting or busy:
            while waiting and idle:
                worker, key = idle.pop(), waiting.popleft()
                if not worker.process.is_alive():  # it died after its last scene
                    worker.stop()
                    worker = _Worker()
                tries[key] += 1
                with suppress(OSError):  # it died just now, which recv below notices
                    worker.connection.send((key, scenes[key], wanted))
                busy[worker.connection] = worker, key
            for connection in wait(list(busy)):
                assert isinstance(connection, Connection)
                worker, key = busy.pop(connection)
                try:
                    record: Record = connection.recv()
                except (EOFError, OSError):
                    worker.stop()
                    worker = _Worker()
                    if tries[key] < POINT_TRIES:
                        waiting.append(key)
                        idle.append(worker)
                        continue
                    record = interrupted_record(f"its process died, {POINT_TRIES} times; short of memory?")
                idle.append(worker)
                yield key, record
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.stop()


def _serve(connection: Connection) -> None:
    """Answer each scene with its record, until the connection is closed."""
    os.environ |= dict.fromkeys(_THREADS, "1")  # before NumPy is loaded
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which stops its workers
    threading.Thread(target=_die_with_parent, daemon=True).start()
    while True:
        try:
            key, scene, wanted = connection.recv()
        except EOFError:
            return
        from fmd.sweep.work import compute_point

        connection.send(compute_point(key, scene, wanted))


def _die_with_parent() -> None:
    """Wait for the parent's end, and end this process at once, whatever it computes."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
