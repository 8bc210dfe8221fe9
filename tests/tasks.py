"""What a pipeline tells its monitor, for tests of what was begun and what wasn't."""

from collections.abc import Iterator
from contextlib import contextmanager

from fmd.core.progress import Advance
from fmd.scene.scene import Scene


class Tasks:
    """A monitor that remembers the names of all tasks: of stages, and of each run while it is integrated."""

    def __init__(self) -> None:
        self.names: list[str] = []

    @contextmanager
    def __call__(self, name: str) -> Iterator[Advance]:
        self.names.append(name)
        yield lambda done: None

    def began_a_run(self, scene: Scene) -> bool:
        """Return true if a run of the scene was integrated; its label is the name of that task."""
        assert "loads" in self.names  # it has been listened to
        return any(run.integrator in name for run in scene.simulation.run for name in self.names)
