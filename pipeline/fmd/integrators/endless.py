"""Count of the steps that a march by an adaptive method has before it, so that one without end is refused soon."""

from fmd.core.data_classes import dataclass
from fmd.core.errors import StabilityError


@dataclass
class StepsLeft:
    """Number of steps that a march still has before it, by the mean of its last ones."""

    name: str
    end: float  # time at which the march ends [s]
    most: float  # steps that are taken for an end that never comes
    over: int  # steps over which the mean is taken: steps that are short for a while, as after a start, are fewer
    steps: int = 0  # steps done where the present mean begins
    time: float = 0.0  # time reached where the present mean begins [s]

    def require_end(self, steps: int, time: float) -> None:
        """Count the steps done up to a time [s].

        Raises
        ------
        StabilityError
            The steps that are left are more than a machine takes in a day.
        """
        if steps - self.steps < self.over:
            return
        mean = (time - self.time) / (steps - self.steps)
        if self.end - time > self.most * mean:
            left = f"{(self.end - time) / mean:.1e}" if mean > 0.0 else "any number"
            raise StabilityError(
                f"{self.name} takes steps of {mean:.1e} s at t = {time:.4g} s, and so {left} more of them, which never "
                "come to an end",
                time,
            )
        self.steps, self.time = steps, time
