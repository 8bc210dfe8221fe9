"""Points on a Dask cluster: the scheduler hands them out, and again if a worker is lost."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.core.errors import InputError
from pipeline.sweep.record import Record, broken_off
from pipeline.sweep.work import compute

if TYPE_CHECKING:
    from pipeline.scene.scene import Scene

_SCHEDULER = "--scheduler"
_ANSWERS_WITHIN = 10  # s
_WORKS_WITHIN = 60  # s; a cluster may start its workers when there is work


def on_cluster(scenes: Mapping[str, Scene], address: str) -> Iterator[tuple[str, Record]]:
    """Send scenes to the workers of a scheduler; yield key and record of each as it is done.

    Workers need this package, of the same version. The scene goes with the work, its record comes back; a mesh that is
    read from a file must lie at the same place for them.

    Raises
    ------
    InputError
        Dask is missing, or there is no scheduler, or no worker, at the address; or the scheduler goes away.
    """
    try:
        from distributed import Client, as_completed
    except ModuleNotFoundError:
        raise InputError(_SCHEDULER, "", address, "needs Dask: install this package's extra 'cluster'") from None
    try:
        asyncio.run(_reach(address))  # first: a client that can't connect takes 20 s to give up closing
        client = Client(address, timeout=_ANSWERS_WITHIN, set_as_default=False)
    except (OSError, ValueError, ImportError) as error:
        said = f"no Dask scheduler answers there, e.g. tcp://host:8786: {error}"
        raise InputError(_SCHEDULER, "", address, said) from None
    with client:
        futures = {
            client.submit(compute, key, _placed(scene), key=key, pure=False): key for key, scene in scenes.items()
        }
        try:
            client.wait_for_workers(1, timeout=_WORKS_WITHIN)
        except TimeoutError:
            mend = f"has no workers; start some: dask worker {address}"
            raise InputError(_SCHEDULER, "", address, mend) from None
        for future in as_completed(futures, loop=client.loop):
            key, status = futures.pop(future), future.status
            if status == "finished":
                record: Record = future.result()
            elif status == "error":
                fault = future.exception()
                record = broken_off(f"{type(fault).__name__}: {fault}")
            else:
                mend = "the scheduler went away; what is done is kept, and the same command goes on from there"
                raise InputError(_SCHEDULER, "", address, mend)
            future.release()  # a result that is still held is computed again if the worker that has it is lost
            yield key, record


def _placed(scene: Scene) -> Scene:
    """A scene whose file, beside which those of its meshes are, is found from any folder."""
    placed = scene.model_copy()
    placed._file = str(Path(scene.file).resolve())
    return placed


async def _reach(address: str) -> None:
    from distributed.comm import connect

    await (await connect(address, timeout=_ANSWERS_WITHIN)).close()
