"""Points on a Dask cluster: the scheduler hands them out, and once more if a worker is lost."""

import asyncio
from collections.abc import Iterator, Mapping
from pathlib import Path

from fmd.core.errors import InputError
from fmd.core.limits.patience import ANSWERS_WITHIN, WORKS_WITHIN
from fmd.scene.scene import Scene
from fmd.sweep.record import Record, Wanted, interrupted_record
from fmd.sweep.work import compute_point

_SCHEDULER = "--scheduler"


def compute_on_cluster(scenes: Mapping[str, Scene], address: str, wanted: Wanted) -> Iterator[tuple[str, Record]]:
    """Compute scenes on the workers of a Dask scheduler; yield key and record of each as it is done.

    Workers need this package, of the same version. A mesh that is read from a file must lie at the same place for them.

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
        asyncio.run(_connect(address))  # first: a client that can't connect takes 20 s to give up closing
        client = Client(address, timeout=ANSWERS_WITHIN, set_as_default=False)
    except (OSError, ValueError, ImportError) as error:
        mend = f"no Dask scheduler answers there, e.g. tcp://host:8786: {error}"
        raise InputError(_SCHEDULER, "", address, mend) from None
    with client:
        futures = {
            client.submit(compute_point, key, _with_absolute_file(scene), wanted, key=key, pure=False): key
            for key, scene in scenes.items()
        }
        try:
            client.wait_for_workers(1, timeout=WORKS_WITHIN)
        except TimeoutError:
            mend = f"has no workers; start some: dask worker {address}"
            raise InputError(_SCHEDULER, "", address, mend) from None
        for future in as_completed(futures, loop=client.loop):
            key, status = futures.pop(future), future.status
            if status == "finished":
                record: Record = future.result()
            elif status == "error":
                fault = future.exception()
                record = interrupted_record(f"{type(fault).__name__}: {fault}")
            else:
                mend = "the scheduler went away; what is done is kept, and the same command goes on from there"
                raise InputError(_SCHEDULER, "", address, mend)
            future.release()  # a result that is still held is computed again if the worker that has it is lost
            yield key, record


def _with_absolute_file(scene: Scene) -> Scene:
    """Copy a scene with the absolute path of its file, so that workers in other folders can read its meshes."""
    copy = scene.model_copy()
    copy._file = str(Path(scene.file).resolve())
    return copy


async def _connect(address: str) -> None:
    """Open and close a connection to a scheduler; raises ``OSError`` or ``ValueError`` if none answers."""
    from distributed.comm import connect

    await (await connect(address, timeout=ANSWERS_WITHIN)).close()
