"""Motions as one labelled data set, which ``motion.nc`` holds: the same variables for every scene, with units.

Vectors are in the ground's axes but where it says otherwise; their dimension is ``axis`` (x, y, z), that of quaternions
``quaternion`` (x, y, z, w: scalar part last). All variables have the dimensions ``run`` and ``time`` first.

========================== ========= =====================================================================
``J.position``, ``J.rate``           of a joint J with one coordinate; on a hinge, of the section there
``J.coordinates``, ``J.rates``       of a joint with several: displacements [m], then angles [rad]
``J.orientation``                    of a spherical or free joint: the child against its parent
``J.angular_velocity``               of such a joint, about the child's axes
``J.displacement``                   of a free joint, along the parent's axes; ``J.velocity`` is its rate
``B.modal_coordinates``              of a flexible body B; its dimension ``B.mode`` has the frequencies [Hz]
``B.origin``, ``B.orientation``      of the body's frame
``B.M.position``                     of each named marker M of the body; of a part in pieces under the part's name
``B.M.deflection``                   of each marker of a flexible body, in its axes, seen from the section at its joint
``C.force``, ``C.moment``            of a contact C on its body, the moment about the plane's position
``C.impulse``, ``C.friction_work``   of a contact since the start
``C.damping_work``                   of its damping since the start
``C.area``, ``C.peak_pressure``      of a contact's pressed points
``C.largest_force``, ``…_area``      largest of all steps since the output time before; ``…_pressure``, too
``C.slip``, ``C.mean_slip``          longest way that its points have slipped while pressed; mean by areas
``C.wear_volume``, ``C.wear_depth``  what each of its faces has lost by wear, if it wears; largest at points
``C.energy``                         of a contact: of the deflection that the modes leave out
``G.force``                          of gears in mesh G, along the line of action; below 0 of the other flanks
``G.transmission_error``             how far they are turned against one another beyond touch, along that line
``centre_of_mass``                   of all bodies
``momentum``, ``angular_momentum``   of all bodies, the latter about the ground's origin
``kinetic_energy``                   of all bodies
``potential_energy``                 of deformation, springs, force elements and weight
``tip.position``                     of the scene's tip
``tip.deflection``                   of the scene's tip
========================== ========= =====================================================================

A joint whose variable would have the name of another one gets ``joint.`` before its name. The attribute ``error`` is
the largest error over time of the first run, in the variable's unit, or the reason why it is not stated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.netcdf import NetcdfBlock, NetcdfVariable, empty_variable, write_netcdf
from fmd.core.rotations import quaternion_of_matrix
from fmd.dynamics.elements import GearTeeth
from fmd.recovery.motion import Motion

if TYPE_CHECKING:
    import xarray

_XYZ, _QUATERNION = ("axis",), ("quaternion",)


class Variable(NamedTuple):
    """A variable of the data set over one motion."""

    name: str
    values: Array  # (n_times, …): over the output times
    dims: tuple[str, ...]  # names of the dimensions after time
    units: str  # its unit
    long_name: str  # what it is, in words


OF_FORMULA = "SI"  # units of a variable that is a formula of the motion

Errors = Callable[[Variable], float | str]
"""Gives a variable's largest error over time in its unit, or why it is not stated."""


def motion_dataset(motions: Mapping[str, Motion], errors: Errors | None = None) -> xarray.Dataset:
    """Gather several motions of a scene with common output times in one labelled data set, units as attributes."""
    import xarray

    data, coordinates = _gather_motions(motions, errors)
    return xarray.Dataset(
        {own.name: (own.dims, own.values, own.attributes) for own in data},
        {own.name: (own.dims, own.values, own.attributes) for own in coordinates},
    )


def write_motions(motions: Mapping[str, Motion], path: Path, errors: Errors | None = None) -> None:
    """Write the data set of several motions to a NetCDF file piece by piece, without loading xarray."""
    first = next(iter(motions.values()))
    sample, coordinates = _gather_motions({label: motion.part(0, 1) for label, motion in motions.items()}, errors)
    coordinates = [replace(own, values=first.times) if own.name == "time" else own for own in coordinates]
    n_runs, n_times = len(motions), len(first.times)
    data = [
        empty_variable(own.name, own.dims, (n_runs, n_times, *own.values.shape[2:]), own.attributes) for own in sample
    ]
    write_netcdf(path, [*coordinates, *data], _blocks(motions))


def _blocks(motions: Mapping[str, Motion]) -> Iterator[NetcdfBlock]:
    for k, motion in enumerate(motions.values()):
        for first, part in motion.parts():
            for variable in motion_variables(part):
                yield NetcdfBlock(variable.name, k, first, variable.values)


def gather_runs(
    times: Array, runs: Mapping[str, Sequence[Variable]], errors: Errors | None = None
) -> tuple[list[NetcdfVariable], list[NetcdfVariable]]:
    """Stack the variables of several runs, the same of each, and return them and the coordinates of their dimensions.

    Output times are in s; ``errors`` gives the attribute ``error`` of a variable.
    """
    tables = [{variable.name: variable for variable in variables} for variables in runs.values()]
    data = [
        NetcdfVariable(
            name,
            ("run", "time", *variable.dims),
            np.stack([table[name].values for table in tables]),
            _attributes(variable, errors),
        )
        for name, variable in tables[0].items()
    ]
    return data, [
        NetcdfVariable("run", ("run",), np.array(list(runs))),
        NetcdfVariable("time", ("time",), times, {"units": "s", "long_name": "time"}),
        NetcdfVariable("axis", ("axis",), np.array(["x", "y", "z"])),
        NetcdfVariable("quaternion", ("quaternion",), np.array(["x", "y", "z", "w"])),
    ]


def _attributes(variable: Variable, errors: Errors | None) -> dict[str, str | float]:
    attributes: dict[str, str | float] = {"units": variable.units, "long_name": variable.long_name}
    if errors is not None:
        attributes["error"] = errors(variable)
    return attributes


def _gather_motions(
    motions: Mapping[str, Motion], errors: Errors | None
) -> tuple[list[NetcdfVariable], list[NetcdfVariable]]:
    """Gather the variables of several motions, stacked over the runs, and the coordinates of their dimensions."""
    first = next(iter(motions.values()))
    runs = {label: motion_variables(motion) for label, motion in motions.items()}
    data, coordinates = gather_runs(first.times, runs, errors)
    frequencies = [
        NetcdfVariable(
            f"{link.name}.mode",
            (f"{link.name}.mode",),
            link.omega / (2 * np.pi),
            {"units": "Hz", "long_name": f"frequencies of the modes of {link.name}"},
        )
        for link in first.mechanism.links
        if len(link.omega)
    ]
    return data, [*coordinates, *frequencies]


def motion_variables(motion: Motion) -> list[Variable]:
    """Compute all variables of a motion; no name comes twice."""
    variables = [*_whole_variables(motion), *_body_variables(motion), *_contact_variables(motion)]
    variables += gear_variables(motion)
    taken = {variable.name for variable in variables}
    for variable in joint_variables(motion):
        variables.append(variable._replace(name=f"joint.{variable.name}") if variable.name in taken else variable)
    return variables


def _whole_variables(motion: Motion) -> Iterator[Variable]:
    kinetic, potential = motion.energies
    whole = motion.kinematics
    yield Variable("tip.position", motion.tip_position, _XYZ, "m", f"position of {motion.tip} in space")
    if len(motion.tip_link.omega):
        text = f"deflection of {motion.tip}, seen from the section at its body's joint, in the body's axes"
        yield Variable("tip.deflection", motion.tip_deflection, _XYZ, "m", text)
    yield Variable("kinetic_energy", kinetic, (), "J", "kinetic energy")
    yield Variable("potential_energy", potential, (), "J", "energy of deformation, springs and weight")
    yield Variable("centre_of_mass", whole.centre_of_mass, _XYZ, "m", "centre of mass of all bodies")
    yield Variable("momentum", whole.momentum, _XYZ, "kg m/s", "momentum of all bodies")
    text = "angular momentum of all bodies about the ground's origin"
    yield Variable("angular_momentum", whole.angular_momentum, _XYZ, "kg m^2/s", text)


def _body_variables(motion: Motion) -> Iterator[Variable]:
    whole = motion.kinematics
    for k, (link, frame) in enumerate(zip(motion.mechanism.links, whole.frames, strict=True)):
        body = link.name
        if len(link.omega):
            dims, text = (f"{body}.mode",), f"modal coordinates of {body}"
            yield Variable(f"{body}.modal_coordinates", whole.modal_coordinates(k), dims, "kg^0.5 m", text)
        yield Variable(f"{body}.origin", frame.origin, _XYZ, "m", f"origin of the frame of {body} in space")
        text = f"quaternion of the frame of {body} in space"
        yield Variable(f"{body}.orientation", quaternion_of_matrix(frame.rotation), _QUATERNION, "1", text)
        for marker in link.markers:
            if marker.startswith("cut:"):
                continue
            name = f"{link.part or body}.{marker}"
            yield Variable(f"{name}.position", whole.marker_position(k, marker), _XYZ, "m", f"{name} in space")
            if len(link.omega):
                text = f"deflection of {name}, seen from the section at the joint of {link.part or body}, in its axes"
                yield Variable(f"{name}.deflection", whole.deflection(k, marker), _XYZ, "m", text)


def _contact_variables(motion: Motion) -> Iterator[Variable]:
    for name, own in motion.contacts.items():
        yield Variable(f"{name}.force", own.force, _XYZ, "N", f"force on the body by contact {name}")
        yield Variable(f"{name}.impulse", own.impulse, _XYZ, "N s", f"impulse of contact {name} since the start")
        text = f"moment of contact {name} on the body about the plane's position"
        yield Variable(f"{name}.moment", own.moment, _XYZ, "N m", text)
        yield Variable(f"{name}.area", own.area, (), "m^2", f"area that contact {name} presses")
        yield Variable(f"{name}.peak_pressure", own.peak_pressure, (), "Pa", f"largest pressure of contact {name}")
        for of, unit, tops in zip(("force", "area", "pressure"), ("N", "m^2", "Pa"), own.tops.T, strict=True):
            text = f"largest {of} of contact {name} at any step since the output time before"
            yield Variable(f"{name}.largest_{of}", tops, (), unit, text)
        yield Variable(f"{name}.slip", own.slip, (), "m", f"longest way that points of contact {name} have slipped")
        text = f"mean way, by areas, of the points of contact {name} that have slipped"
        yield Variable(f"{name}.mean_slip", own.mean_slip, (), "m", text)
        if own.wears:
            yield Variable(f"{name}.wear_volume", own.wear_volume, (), "m^3", f"volume that {name} wears off each face")
        if not np.isnan(own.wear_depth[-1]):
            text = f"largest depth that contact {name} has worn at points of its face"
            yield Variable(f"{name}.wear_depth", own.wear_depth, (), "m", text)
        yield Variable(f"{name}.energy", own.energy, (), "J", f"energy of deflection beside the modes, contact {name}")
        yield Variable(f"{name}.friction_work", own.friction_work, (), "J", f"friction's work in contact {name}")
        yield Variable(f"{name}.damping_work", own.damping_work, (), "J", f"damping's work in contact {name}")


def gear_variables(motion: Motion) -> Iterator[Variable]:
    """Variables of each two gears in mesh."""
    for own in motion.mechanism.elements:
        if isinstance(own, GearTeeth):
            force = motion.kinematics.wrenches(own)[:, 1, 3:] @ own.axis / -own.radii[1]
            text = f"force between the teeth of {own.name} along the line of action, below 0 on the other flanks"
            yield Variable(f"{own.name}.force", force, (), "N", text)
            text = f"turn of the gears of {own.name} against one another beyond touch, along the line of action"
            yield Variable(f"{own.name}.transmission_error", motion.kinematics.strain(own)[0][:, 0], (), "m", text)


def joint_variables(motion: Motion, only: str | None = None) -> Iterator[Variable]:
    """Variables of each joint that moves, or of one alone."""
    for k, link in enumerate(motion.mechanism.links):
        joint = link.joint_name
        if only not in (None, joint):
            continue
        if link.unit:
            position, rate = motion.kinematics.along_joint(k)
            yield Variable(f"{joint}.position", position, (), link.unit, f"position of joint {joint}")
            yield Variable(f"{joint}.rate", rate, (), f"{link.unit}/s", f"rate of joint {joint}")
        elif link.joint.turns_in_space:
            position, rate = motion.kinematics.joint_coordinates(k)
            text = f"quaternion of {link.name} against what joint {joint} hangs it on"
            yield Variable(f"{joint}.orientation", position[:, -4:], _QUATERNION, "1", text)
            text = f"angular velocity in joint {joint}, about the axes of {link.name}"
            yield Variable(f"{joint}.angular_velocity", rate[:, -3:], _XYZ, "rad/s", text)
        elif link.n_rates:
            position, rate = motion.kinematics.joint_coordinates(k)
            dims = (f"{joint}.coordinate",)
            units = ", ".join(["m"] * link.n_slides + ["rad"] * (link.n_rates - link.n_slides))
            text = f"displacements and angles of joint {joint}, in {units}"
            yield Variable(f"{joint}.coordinates", position, dims, "1", text)
            text = f"rates of the displacements and angles of joint {joint}, by the second"
            yield Variable(f"{joint}.rates", rate, dims, "1", text)
        if link.joint.is_free:
            yield Variable(f"{joint}.displacement", position[:, :3], _XYZ, "m", f"displacement in joint {joint}")
            yield Variable(f"{joint}.velocity", rate[:, :3], _XYZ, "m/s", f"velocity in joint {joint}")
