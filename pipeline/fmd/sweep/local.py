"""Points on this machine: one process for each core, and a new one in place of one that dies.

A process gets some points at a time, for points of one structure share much of their work.

A pool of loky or of ``concurrent.futures`` breaks as a whole when one of its processes dies, and doesn't say which
scene that process had; Dask's local cluster does, but takes seconds to start and fifteen more packages.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from multiprocessing.forkserver import ensure_running
from typing import TYPE_CHECKING, Any

from fmd.core.errors import InputError
from fmd.core.limits.memory import ALLOCATIONS, POINTS_AT_ONCE
from fmd.core.limits.patience import POINT_TRIES, ROUNDS_OF_POINTS
from fmd.sweep.record import Record, Wanted, interrupted_record

if TYPE_CHECKING:
    from fmd.scene.scene import Scene

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def prepare_workers() -> None:
    """Begin to load what workers need, in a process of which they will be copies, while this one reads the scenes.

    It has one thread: a copy of this process would have locks and threads of BLAS. Where processes can't be copied,
    each worker loads for itself.
    """
    if _processes().get_start_method() == "forkserver":
        given = {name: os.environ.get(name) for name in _THREADS}
        os.environ |= dict.fromkeys(_THREADS, "1")
        ensure_running()
        for name, value in given.items():
            del os.environ[name]
            os.environ |= {} if value is None else {name: value}


@cache
def _processes() -> BaseContext:
    """Return how processes start; they import nothing from the working folder."""
    os.environ["PYTHONSAFEPATH"] = "1"
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(["fmd.sweep.work"])
    return server


class _Worker:
    """A process that says when it is ready, computes the scenes sent to it, and sends back each as it is done.

    Raises ``InputError`` if none can be started.
    """

    def __init__(self) -> None:
        self.ready = False
        prepare_workers()
        processes: Any = _processes()
        self.connection, theirs = processes.Pipe()
        self.process = processes.Process(target=_serve, args=(theirs,), daemon=True)
        try:
            self.process.start()
        except (EOFError, ConnectionError):  # the process that it is a copy of ended, as it loaded, say
            raise InputError("--workers", "", None, "processes can't be started; is memory short?") from None
        theirs.close()  # so that this end reads the end of the file when the process dies

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.connection.close()


def compute_locally(scenes: Mapping[str, Scene], workers: int, wanted: Wanted) -> Iterator[tuple[str, Record]]:
    """Compute scenes in processes of one thread each; yield key and record of each as it is done.

    A scene whose process dies is tried once more, and whatever was sent with it one by one. If this process dies, its
    workers die too.

    Raises
    ------
    InputError
        Processes die one after the other before they are ready, whatever they were to compute.
    """
    tries, unready = Counter[str](), 0  # times that each scene was alone, and processes in a row that weren't ready
    at_once = min(POINTS_AT_ONCE, -(-len(scenes) // (ROUNDS_OF_POINTS * workers)))
    waiting = deque([*scenes][first : first + at_once] for first in range(0, len(scenes), at_once))
    idle = [_Worker() for _ in range(min(workers, len(scenes)))]
    most = max(len(idle), POINT_TRIES)
    busy: dict[Connection, tuple[_Worker, list[str]]] = {}
    try:
        while waiting or busy:
            while waiting and idle:
                worker, keys = idle.pop(), waiting.popleft()
                if not worker.process.is_alive():  # it died after its last scene
                    worker.stop()
                    worker = _Worker()
                with suppress(OSError):  # it died just now, which recv below notices
                    worker.connection.send(({key: scenes[key] for key in keys}, wanted))
                busy[worker.connection] = worker, keys
            for connection in wait(list(busy)):
                assert isinstance(connection, Connection)
                worker, keys = busy[connection]
                try:
                    answer = connection.recv()
                    if answer is None:
                        worker.ready, unready = True, 0
                        continue
                    key, record = answer
                except (EOFError, OSError):
                    del busy[connection]
                    worker.stop()
                    if not worker.ready:
                        unready += 1
                        _require_start(unready, most, worker.process.exitcode)
                    elif len(keys) == 1:
                        tries.update(keys)
                    idle.append(_Worker())
                    if tries[keys[0]] < POINT_TRIES:
                        waiting.extend([key] for key in keys)
                        continue
                    key = keys[0]
                    record = interrupted_record(f"its process died, {POINT_TRIES} times; short of memory?")
                else:
                    keys.remove(key)
                    if not keys:
                        del busy[connection]
                        idle.append(worker)
                yield key, record
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.stop()


def _require_start(unready: int, most: int, status: int | None) -> None:
    """Raise ``InputError`` if as many processes in a row as were started first ended before they were ready."""
    if unready >= most:
        mend = f"{unready} processes in a row ended with status {status} before they could compute a point"
        raise InputError("--workers", "", None, f"{mend}; what is done is kept. Fewer need less memory")


def _serve(connection: Connection) -> None:
    """Answer scenes with the record of each, until the connection is closed."""
    os.environ |= dict.fromkeys(_THREADS, "1")  # before NumPy is loaded, if it isn't yet
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which stops its workers
    threading.Thread(target=_die_with_parent, daemon=True).start()
    from fmd.sweep.work import compute_points

    gc.set_threshold(ALLOCATIONS)
    connection.send(None)
    while True:
        try:
            scenes, wanted = connection.recv()
        except EOFError:
            return
        for key, record in compute_points(scenes, wanted):
            connection.send((key, record))


def _die_with_parent() -> None:
    """Wait for the parent's end, and end this process at once, whatever it computes."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
