"""Designs as files: scenes with their numbers, the figures, and the front of two aims."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from fmd.core.files import number_texts, write_table, write_text
from fmd.fitting.changed_scene import write_changed_scene
from fmd.fitting.optimise import Optimum


def write_design(found: Optimum, folder: Path, given: str, overrides: Sequence[str], name: str = "design") -> list[str]:
    """Write a design as a scene and its figures as JSON into a folder, and return the files' names.

    Parameters
    ----------
    given : str
        The scene's name or path, as it was given.
    overrides : sequence of str
        Values that were used instead of the scene's own, ``key=value``.
    name : str
        Of the files, without suffix.

    Raises
    ------
    OSError
        The folder can't be written.
    """
    aim, *others = found.summary()["results"]
    comments = [f"The design of {given} with the {'least' if found.sign > 0 else 'largest'} {_value(aim)}"]
    comments += [f"{_value(row)} {row['must']} {row['limit']:.6g}" if row["must"] else _value(row) for row in others]
    write_changed_scene(found.space.run.scene, found.design.values, folder / f"{name}.toml", given, comments, overrides)
    write_text(folder / f"{name}.json", json.dumps(found.summary(), indent=1))
    return [f"{name}.toml", f"{name}.json"]


def write_front(found: Sequence[Optimum], folder: Path, given: str, overrides: Sequence[str], title: str) -> list[str]:
    """Write the designs of a front, a table and a chart of them into a folder, and return the files' names."""
    from fmd.render.front_chart import draw_front

    files = [
        name
        for number, each in enumerate(found, start=1)
        for name in write_design(each, folder, given, overrides, f"design-{number}")
    ]
    first = found[0].design
    names = [f"{parameter.key} [{parameter.unit}]".removesuffix(" []") for parameter in first.values]
    names += [f"{channel.name} [{channel.unit}]".removesuffix(" []") for channel in first.channels]
    rows = [[*each.design.values.values(), *(float(x) for x in each.design.results)] for each in found]
    write_table(folder / "front.csv", names, number_texts(rows))
    aims = (len(first.values), len(names) - 1)
    x, y = ([row[k] for row in rows] for k in aims)
    draw_front(x, y, folder / "front.png", title=title, labels=(names[aims[0]], names[aims[1]]))
    return [*files, "front.csv", "front.png"]


def _value(row: dict[str, object]) -> str:
    value = row["value"]
    return f"{row['name']} = {'infinite' if value is None else f'{value:.6g}'} {row['unit']}".rstrip()
