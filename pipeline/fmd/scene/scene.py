"""The scene: a TOML file's tables, read and checked as a whole.

Quantities are SI floats once read. Every fault in the file is one ``InputError``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_origin

from pydantic import PrivateAttr, ValidationError, ValidationInfo, model_validator

from fmd.core.errors import InputError
from fmd.core.html import facts, scaled
from fmd.core.joint_kinds import JOINT_CONSTANTS
from fmd.core.units import PositiveFrequency, Share
from fmd.scene.cross_checks import CrossCheck
from fmd.scene.joints.any_joint import Joint
from fmd.scene.reading import Fault, FaultError, SceneTable, kinds_as_meant, list_faults, raise_faults
from fmd.scene.runs import AutoRun
from fmd.scene.scene_files import read_unchanged
from fmd.scene.scene_tables import SceneTables
from fmd.scene.simulation import Simulation
from fmd.scene.tolerances import split_tolerances
from fmd.scene.toml_files import parse_value

# Tables of tables by name.
_NAMED = tuple(name for name, field in SceneTables.model_fields.items() if get_origin(field.annotation) is dict)


class PublishedResults(SceneTable):
    """Published results to compare with.

    Example:

        [reference]
        source = "Table 1"
        frequencies = ["131.2 Hz", "349.3 Hz", "653.9 Hz"]
    """

    source: str  # Publication, and where in it they stand.
    frequencies: tuple[PositiveFrequency, ...]  # Natural frequencies of the first flexible body, the lowest first [Hz].


class Scene(SceneTables):
    """Bodies and joints, what drives them, how they are integrated over time, and the results that are written.

    Example:

        title = "Pendulum"

        [body.rod]
        shape = "rod"
        mass = "2 kg"
        length = "1 m"
        marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }

        [joint.hinge]
        type = "revolute"
        parent = "ground"
        child = "rod.hinge"
        axis = [0, 0, 1]

        [simulation]
        duration = "2 s"
        output_step = "10 ms"
        tip = "rod.end"
        gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]

        [[simulation.run]]
        integrator = "auto"

        [[output]]
        type = "chart"
        file = "angle.png"
        quantity = "joint_position"
        joint = "hinge"
        unit = "deg"
    """

    title: str  # Title of charts and reports.
    source: str = ""  # Publication that the scene is taken from.
    # Largest relative error of every quantity in the error budget. With it, a run chooses meshes, modes, integrator and
    # step itself until the budget states that error or less.
    accuracy: Share | None = None
    reference: PublishedResults | None = None  # Published results to compare with.
    _file: str = PrivateAttr("")
    _tolerances: dict[str, float] = PrivateAttr(default_factory=dict)

    @property
    def file(self) -> str:
        """Path of the file that the scene was read from; empty if it was made in Python."""
        return self._file

    @property
    def tolerances(self) -> Mapping[str, float]:
        """Half-widths of numbers' 95 % intervals, relative to these, by dotted keys; ``"0.4 kg ± 2 %"`` has 0.02."""
        return self._tolerances

    @property
    def name(self) -> str:
        """Name of the scene's file without folder and suffix; ``"scene"`` if it was made in Python."""
        return Path(self._file).stem or "scene"

    @property
    def moves(self) -> bool:
        """True if the scene has a simulation, false if it has meshes and modes alone."""
        return self.simulation_table is not None

    @property
    def repeats(self) -> bool:
        """True if the scene starts on a motion that repeats."""
        return self.simulation_table is not None and self.simulation_table.start == "periodic"

    @property
    def simulation(self) -> Simulation:
        """The integration over time, of a scene that has one; with contacts ``"auto"`` is what it stands for.

        Raises
        ------
        InputError
            The scene has no simulation.
        """
        if self.simulation_table is None:
            raise InputError(
                self.file,
                "simulation",
                None,
                "is missing: without it a scene has mesh and modes alone (`fmd mesh`, `fmd modes`), no motion",
            )
        if not self.refines_contacts:
            return self.simulation_table
        meant = AutoRun.in_contact(of_elements=bool(self.touching_faces))
        return self.simulation_table.model_copy(update={"run": (meant,), "step": "auto"})

    @classmethod
    def _list_faults(cls, error: ValidationError, values: Mapping[str, Any], context: Mapping[str, Any]) -> list[Fault]:
        faults = list_faults(error)
        meant = kinds_as_meant(error, values)
        if meant is None:
            return [*faults, *_find_unknown_names(values, faults, context)]
        try:
            cls.model_validate(meant, context=context)
        except ValidationError as beside:
            known = {fault.path for fault in faults}
            faults += [fault for fault in cls._list_faults(beside, meant, context) if fault.path not in known]
        return faults

    def __repr__(self) -> str:
        return f"Scene({self.title!r}, bodies: {', '.join(self.body)})"

    def _repr_html_(self) -> str:
        return scene_table(self)

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> Scene:
        check = CrossCheck(self)
        left_out = (info.context or {}).get("left_out")
        if left_out is not None:  # the rest would only tell what follows from the faults of these
            raise_faults(check.find_unknown_names(left_out))
            return self
        if not self.body:
            raise FaultError("must have at least 1 item", "body")
        raise_faults(check.find_faults())
        return self


def load_scene(
    source: str | Path | Mapping[str, Any], overrides: Sequence[str] = (), without: Collection[str] = ()
) -> Scene:
    """Read a scene and check it.

    Parameters
    ----------
    source : str, Path or mapping
        A ready scene's name, e.g. ``"beam"``, the path of a TOML file, or the tables of such a file; their quantities
        may be numbers in SI units, too, and their files are relative to the working directory.
    overrides : sequence of str
        Values to use instead of the file's: ``"body.beam.length=300mm"``, ``"simulation.run.1.substeps=7"``.
        The items of a list count from 0. What isn't a TOML value is taken as a string.
    without : collection of str
        Tables of the first level to leave out unread, e.g. ``["output"]``.

    Returns
    -------
    Scene
        The scene, checked; quantities in SI units.

    Raises
    ------
    InputError
        The file can't be read, or something in it is wrong; the message names all that is, with lines, and what would
        work.
    """
    return SceneReader(source, without).load(overrides)


class SceneReader:
    """Reads a scene with other values again and again; tables that are as they were the time before are taken from it.

    Where only springs, rests and dampers of joints have other values than that time, those joints alone are read. The
    arguments are those of `load_scene`.
    """

    def __init__(self, source: str | Path | Mapping[str, Any], without: Collection[str] = ()) -> None:
        self._source, self._without = source, without
        self._read = read_unchanged(source)
        self._known: dict[tuple[str, ...], tuple[Any, Any]] = {}  # each table, as it was read and checked
        self._last: tuple[Sequence[str], Scene] | None = None  # values of the last scene, and it

    def load(self, overrides: Sequence[str]) -> Scene:
        """Read the scene with some values, as `load_scene` does."""
        last, self._last = self._last, None  # none while this one may fail
        scene = (last and self._change_joints(*last, overrides)) or self._load(overrides)
        self._last = overrides, scene
        return scene

    def _change_joints(self, given: Sequence[str], scene: Scene, overrides: Sequence[str]) -> Scene | None:
        """Return a scene with other springs, rests and dampers of joints; none where more differs, or is wrong.

        Checks between tables ask of these no more than whether they are 0.
        """
        if len(given) != len(overrides):
            return None
        joints, keys = {}, [_split_key(text) for text in overrides]
        for key, before, now in zip(keys, given, overrides, strict=True):
            if now == before:
                continue
            alone = sum(other[: len(key)] == key[: len(other)] for other in keys) == 1  # no other sets what it is in
            plain = key == _split_key(before) and ".".join(key) not in scene.tolerances
            if not (alone and plain) or (joint := self._change_joint(key, now.partition("=")[2])) is None:
                return None
            joints[key[1]] = joint
        return scene.model_copy(update={"joint": scene.joint | joints})

    def _change_joint(self, key: Sequence[str], text: str) -> Joint | None:
        """Return the joint of a key like ``joint.hinge.spring`` with another value; none as `_change_joints`."""
        path, last, given = tuple(key[:2]), key[-1], parse_value(text.strip())
        table, joint = self._known.get(path, ({}, None))
        if len(key) != 3 or path[0] != "joint" or last not in JOINT_CONSTANTS or last not in table:
            return None
        if split_tolerances({"": [given]})[1:] != ({}, []):
            return None
        changed, context = table | {last: given}, {"folder": self._read.folder, "units": bool(self._read.file)}
        with suppress(ValidationError):  # which the whole scene tells, with all that is wrong beside it
            own: Joint = type(joint).model_validate(changed, context=context)
            if bool(getattr(own, last)) == bool(getattr(joint, last)):
                self._known[path] = changed, own
                return own
        return None

    def _load(self, overrides: Sequence[str]) -> Scene:
        read = self._read.with_values(overrides)
        chosen = {key: table for key, table in read.data.items() if key not in self._without}
        tables, tolerances, faults = split_tolerances(chosen)
        if faults:
            raise read.make_error(faults)
        context = {"folder": read.folder, "units": bool(read.file)}
        given = _tables_by_path(tables)
        known = {path: own for path, (before, own) in self._known.items() if _are_same(given.get(path), before)}
        try:
            scene = Scene.model_validate(_with_known(tables, known), context=context)
        except ValidationError as error:
            if known:
                return SceneReader(self._source, self._without).load(overrides)  # whose faults are those of the file
            raise read.make_error(Scene._list_faults(error, tables, context)) from None
        self._known = {path: (table, _table_at(scene, path)) for path, table in given.items()}
        scene._file, scene._tolerances = read.file, tolerances
        return scene


def _split_key(text: str) -> list[str]:
    """Return the parts of the dotted key that a text like ``simulation.step=1us`` gives a value."""
    return text.partition("=")[0].strip().split(".")


def _tables_by_path(tables: Mapping[str, Any]) -> dict[tuple[str, ...], Any]:
    """Return each table that is checked by itself, by its path."""
    found: dict[tuple[str, ...], Any] = {
        (kind, name): table
        for kind in _NAMED
        if isinstance(tables.get(kind), dict)
        for name, table in tables[kind].items()
    }
    if "simulation" in tables:
        found["simulation",] = tables["simulation"]
    if "output" in tables:  # which may name the scene's only flexible body
        found["output",] = [tables["output"], tables.get("body")]
    return found


def _are_same(one: Any, other: Any) -> bool:
    """Tell whether what was read is the same; 1, 1.0 and true are equal, and so are 0.0 and -0.0, but not the same."""
    if one is other or type(one) is not type(other):
        return one is other
    if isinstance(one, dict):
        return [*one] == [*other] and all(map(_are_same, one.values(), other.values()))
    if isinstance(one, list):
        return len(one) == len(other) and all(map(_are_same, one, other))
    if isinstance(one, float):
        return bool(one.hex() == other.hex())
    return isinstance(one, str | int) and one == other


def _table_at(scene: Scene, path: tuple[str, ...]) -> Any:
    if path == ("simulation",):
        return scene.simulation_table
    table = getattr(scene, path[0])
    return table[path[1]] if len(path) > 1 else table


def _with_known(tables: Mapping[str, Any], known: Mapping[tuple[str, ...], Any]) -> dict[str, Any]:
    """Return a scene's tables with those that are known in place of what they are read from."""
    found = dict(tables)
    for (kind, *names), table in known.items():
        found[kind] = {**found[kind], names[0]: table} if names else table
    return found


def list_tables() -> dict[str, type[SceneTable]]:
    """List the classes of all tables of a scene by their names."""
    found: dict[str, type[SceneTable]] = {}
    new = SceneTable.__subclasses__()
    while new:
        table = new.pop()
        new += table.__subclasses__()
        if table.__module__.startswith("fmd."):
            found[table.__name__] = table
    return found


def _find_unknown_names(tables: Mapping[str, Any], faults: Sequence[Fault], context: Mapping[str, Any]) -> list[Fault]:
    """Find the names that nothing has among those tables that are right by themselves, if others aren't."""
    wrong = {fault.path[:2] for fault in faults}
    keys = [field.alias or name for name, field in Scene.model_fields.items()]
    meant = {key for path in wrong if len(path) == 1 for key in get_close_matches(str(path[0]), keys, n=1)}
    if () in wrong or meant & {*_NAMED, "output"}:  # the names in such a table aren't known
        return []
    rest: dict[str, Any] = {"title": ""}
    for table in _NAMED:
        rest[table] = {name: value for name, value in tables.get(table, {}).items() if (table, name) not in wrong}
    outputs = [k for k in range(len(tables.get("output", ()))) if ("output", k) not in wrong]
    rest["output"] = [tables["output"][k] for k in outputs]
    if "simulation" in tables and not any(path[0] == "simulation" for path in wrong):
        rest["simulation"] = tables["simulation"]
    try:
        Scene.model_validate(rest, context={**context, "left_out": [str(path[1]) for path in wrong if len(path) > 1]})
    except ValidationError as error:
        return [
            fault._replace(path=("output", outputs[int(fault.path[1])], *fault.path[2:]))
            if fault.path[0] == "output"
            else fault
            for fault in list_faults(error)
        ]
    return []


def scene_table(scene: Scene) -> str:
    """Write a scene's bodies, joints, drives, runs and outputs as a table of HTML."""
    rows = [
        ("bodies", _list_kinds(scene.body, "shape")),
        ("joints", "; ".join(f"{name}: {j.type}, {j.parent} → {j.child}" for name, j in scene.joint.items())),
        ("drives", _list_kinds(scene.drive, "type")),
        ("controllers", _list_kinds(scene.controller, "type")),
        (
            "springs",
            ", ".join(
                f"{name}: {' – '.join(e.between)}" for name, e in (scene.spring | scene.bushing | scene.bearing).items()
            ),
        ),
        ("outputs", ", ".join(output.file for output in scene.output)),
    ]
    if scene.moves:
        simulation = scene.simulation
        spans = f"{scaled(simulation.duration, 's')}, output every {scaled(simulation.output_step, 's')}"
        rows[4:4] = [("simulation", spans), ("runs", ", ".join(run.label() for run in simulation.run))]
    return facts([(name, text) for name, text in rows if text], f"{scene.title} ({scene.file or 'made in Python'})")


def _list_kinds(table: Mapping[str, Any], key: str) -> str:
    return ", ".join(f"{name}: {getattr(value, key)}" for name, value in table.items())
