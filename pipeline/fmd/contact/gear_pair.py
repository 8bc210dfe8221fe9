"""Static mesh of two spur gears: how a load divides over pairs of teeth, and how far the gears turn by it.

Each pair touches on a line across the teeth, with an even load. Between the middles of both teeth it yields by what
finite elements tell, and, from there to the flanks, by the local approach of Hertz's line contact (Weber & Banaschek,
Formänderung und Profilrücknahme bei gerad- und schrägverzahnten Rädern, 1953; Johnson, Contact Mechanics, 5.5), whose
few tenths of a millimetre no element has to resolve. All is along the line of action.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator

from fmd.core.arrays import Array, read_only
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.involute import GearPair, Tooth
from fmd.core.limits.contact import GEAR_FORCES_SETTLE, GEAR_PASSES
from fmd.fem.strain import TENSOR


@dataclass(frozen=True)
class ToothFlexibility:
    """Displacements and stress of a gear, held at its bore, by forces on the flank of one tooth.

    Forces are lines of even load of 1 N in all, in the axes of the loaded tooth. They act at stations of equal steps of
    the roll angle, from where the involute begins to the tip; every second one is the end of an element.
    """

    tooth: Tooth  # its profile
    middle: Array  # (n_rows,): rows on the middle of a tooth, from its base to the tip [m]
    # (n_teeth, n_rows, 2, n_stations, 2): displacement of the rows of each tooth in its own axes, in the order of their
    # angles, the loaded one in the middle [m/N]
    moved: Array
    # (n_teeth, n_points, 6, n_stations, 2): stress at points of each tooth's fillet on the loaded side, in its own axes
    # [Pa/N]
    stress: Array
    E: float  # Young's modulus [Pa]
    nu: float  # Poisson's ratio

    def __post_init__(self) -> None:
        read_only(self.middle)
        read_only(self.moved)
        read_only(self.stress)

    @cached_property
    def row_at(self) -> PchipInterpolator:
        """Number of the row at a place on the middle of a tooth, with a fraction between rows."""
        return PchipInterpolator(self.middle, np.arange(len(self.middle)))


@dataclass(frozen=True)
class GearMeshAnswer:
    """Two gears in mesh over a pitch."""

    s: Array  # (n,): place of the last pair that came into contact, on the line of action [m]
    forces: Array  # (n, n_pairs): forces on this pair and on those before it, 0 where they have parted [N]
    # (n,): static transmission error: what the loaded gears turn against one another, along the line of action [m]
    error: Array
    # (2, n, n_pairs): largest principal stress in the fillets of the pinion's and the wheel's teeth of each pair [Pa]
    root_stress: Array
    pressure: Array  # (n, n_pairs): largest pressure between the flanks of each pair, of Hertz's line contact [Pa]
    path: Array  # (m,): places between the begin and the end of contact [m]
    single: Array  # (m,): stiffness of one pair there that carries the whole load [N/m]

    @property
    def stiffness(self) -> Array:
        """Stiffness of all pairs that touch, the load over the transmission error [N/m]."""
        return np.asarray(self.forces.sum(axis=1) / self.error)


def mesh_gears(
    pair: GearPair, flexibilities: Sequence[ToothFlexibility], width: float, load: float, points: int
) -> GearMeshAnswer:
    """Load two gears in mesh at ``points`` angles, in the middles of equal parts of a pitch.

    Flexibilities are of the pinion and the wheel, the width [m] is of both; the load is along the line of action [N].

    Raises
    ------
    AccuracyError
        The forces don't settle.
    """
    begin, end = pair.path
    pitch = pair.pinion.base_pitch
    n_pairs = int(np.ceil(pair.contact_ratio))
    s = begin + (np.arange(points) + 0.5) / points * pitch
    forces, error, stress = np.zeros((points, n_pairs)), np.zeros(points), np.zeros((2, points, n_pairs))
    radii = np.ones((points, n_pairs))
    for i in range(points):
        at = s[i] + np.arange(n_pairs) * pitch
        at = at[at <= end]
        contacts = [_Contact.of(pair, flexibilities, float(each)) for each in at]
        found, error[i] = _divide(contacts, flexibilities, pair, width, load)
        forces[i, : len(at)], radii[i, : len(at)] = found, [each.radius for each in contacts]
        stress[:, i, : len(at)] = _root_stress(contacts, flexibilities, found)
    pressure = np.sqrt(forces / width / (np.pi**2 * sum(_suppleness(each) for each in flexibilities) * radii))
    path = np.linspace(begin, end, points)
    alone = [[_Contact.of(pair, flexibilities, float(each))] for each in path]
    single = np.array([load / _divide(each, flexibilities, pair, width, load)[1] for each in alone])
    return GearMeshAnswer(s, forces, error, stress, pressure, path, single)


def press_gears(
    pair: GearPair, flexibilities: Sequence[ToothFlexibility], width: float, approaches: Array, places: Array
) -> Array:
    """Turn two gears against one another, and return the force between their teeth (n, m) along the line of action [N].

    Approaches (n,), ascending from 0, are beyond touch along that line [m], places (m,) of one of the pairs on it [m].
    Pairs touch off the path, too, where the gap of a tip to the other's flank is less than what the others yield. There
    they yield as at the path's end.

    Raises
    ------
    AccuracyError
        The forces don't settle.
    ValueError
        Teeth touch that are farther apart than those that flexibilities are known of.
    """
    found, (begin, end), pitch = np.zeros((len(approaches), len(places))), pair.path, pair.pinion.base_pitch
    for j, s in enumerate(places):
        at = s + pitch * np.arange(np.floor((begin - s) / pitch) - 1.0, np.ceil((end - s) / pitch) + 2.0)
        gaps = pair.gap(at)
        near = gaps < approaches[-1]
        contacts = [_Contact.of(pair, flexibilities, float(each)) for each in np.clip(at[near], begin, end)]
        if min(len(own.moved) for own in flexibilities) < (teeth := 2 * len(contacts) - 1):
            raise ValueError(
                f"{len(contacts)} pairs of teeth touch at once; mesh.teeth = {teeth} is needed for both gears"
            )
        found[:, j] = _press(contacts, flexibilities, width, approaches[:, None] - gaps[near]).sum(axis=1)
    return found


def _press(
    contacts: Sequence[_Contact], flexibilities: Sequence[ToothFlexibility], width: float, pressed: Array
) -> Array:
    """Return the forces of contacts by how far each is pressed, shapes (n, n_contacts) [N], [m]; none pulls."""
    bulk, own = _bulk(contacts, flexibilities), np.eye(len(contacts))
    touching, forces = pressed > 0.0, np.zeros(pressed.shape)
    for _ in range(GEAR_PASSES):
        local = np.stack(
            [_local(each, flexibilities, width, force) for each, force in zip(contacts, forces.T, strict=True)], axis=1
        )
        both = touching[:, :, None] & touching[:, None, :]
        flexibility = np.where(both, bulk + own * local[:, None, :], own)
        before, forces = forces, np.linalg.solve(flexibility, np.where(touching, pressed, 0.0)[:, :, None])[:, :, 0]
        pulls = touching & (forces < 0.0)
        forces = np.maximum(forces, 0.0)
        missed = ~touching & (pressed > forces @ bulk) & ~pulls.any(axis=1, keepdims=True)
        touching = (touching & ~pulls) | missed
        settled = np.abs(forces - before) <= GEAR_FORCES_SETTLE * forces.max(axis=1, keepdims=True)
        if settled.all() and not (pulls | missed).any():
            return forces
    raise AccuracyError(f"the forces on {len(contacts)} pairs of teeth don't settle")


@dataclass(frozen=True)
class _Contact:
    """Where a pair of teeth touches: for each gear the roll angle, the load's weights, and the depth of the middle."""

    loads: Sequence[Array]  # (n_stations, 2): unit force on each gear by its stations
    measures: Sequence[Array]  # (n_rows, 2): its counterpart on the middle of the tooth
    depths: Sequence[float]  # from the flank to the middle along the line of action [m]
    radius: float  # of curvature, of both flanks together [m]

    @classmethod
    def of(cls, pair: GearPair, flexibilities: Sequence[ToothFlexibility], s: float) -> _Contact:
        loads, measures, depths = list[Array](), list[Array](), list[float]()
        rolls = pair.rolls(s)
        for own, roll in zip(flexibilities, rolls, strict=True):
            tooth, n = own.tooth, own.moved.shape[3]
            station = (n - 1) * (roll - tooth.form_roll) / (tooth.tip_roll - tooth.form_roll)
            place, inward = tooth.flank(roll), -tooth.normal(roll)
            depth = -place[1] / inward[1]
            row = own.row_at(np.clip(place[0] + depth * inward[0], own.middle[0], own.middle[-1]))
            loads.append(_quadratic(n, station)[:, None] * inward)
            measures.append(_quadratic(len(own.middle), float(row))[:, None] * inward)
            depths.append(float(depth))
        curved = [tooth.base_radius * roll for tooth, roll in zip((pair.pinion, pair.wheel), rolls, strict=True)]
        return cls(loads, measures, depths, curved[0] * curved[1] / (curved[0] + curved[1]))


def _quadratic(count: int, place: float) -> Array:
    """Return the weights of ``count`` points at a place between them, by polynomials over each three of an element."""
    first = 2 * min(max(int(place // 2), 0), (count - 3) // 2)
    x, weights = place - first - 1.0, np.zeros(count)
    weights[first : first + 3] = 0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)
    return weights


def _divide(
    contacts: Sequence[_Contact], flexibilities: Sequence[ToothFlexibility], pair: GearPair, width: float, load: float
) -> tuple[Array, float]:
    """Divide a load over contacts so that all yield alike; return their forces, 0 of those that part, and the yield."""
    bulk, forces = _bulk(contacts, flexibilities), np.full(len(contacts), load / len(contacts))
    touching = np.arange(len(contacts))
    for _ in range(GEAR_PASSES):
        local = [_local(contacts[k], flexibilities, width, forces[k]) for k in touching.tolist()]
        given = np.linalg.solve(bulk[np.ix_(touching, touching)] + np.diag(local), np.ones(len(touching)))
        yielded = load / given.sum()
        before, forces = forces, np.zeros(len(contacts))
        forces[touching] = yielded * given
        if given.min() <= 0.0:
            touching = np.delete(touching, given.argmin())
            forces[:] = load / len(touching)
        elif np.abs(forces - before).max() < GEAR_FORCES_SETTLE * load:
            return forces, float(yielded)
    raise AccuracyError(f"the load's shares of {len(contacts)} pairs of teeth don't settle, at {pair.distance:.6g} m")


def _bulk(contacts: Sequence[_Contact], flexibilities: Sequence[ToothFlexibility]) -> Array:
    """Return how far the middles of the teeth of each pair yield for forces on each, symmetric [m/N]."""
    total = np.zeros((len(contacts), len(contacts)))
    for g, (own, sense) in enumerate(zip(flexibilities, (1, -1), strict=True)):  # the pair before is ahead
        for k, measured in enumerate(contacts):
            for j, loaded in enumerate(contacts):
                tooth = own.moved.shape[0] // 2 + sense * (k - j)
                total[k, j] += np.einsum("ra,rasb,sb->", measured.measures[g], own.moved[tooth], loaded.loads[g])
    return 0.5 * (total + total.T)


def _local(contact: _Contact, flexibilities: Sequence[ToothFlexibility], width: float, force: Array) -> Array:
    """Return the approach of both flanks to the middles of their teeth over each of some forces [m/N]."""
    supple = [_suppleness(own) for own in flexibilities]
    half_width = np.sqrt(4.0 * np.maximum(force, np.finfo(float).tiny) / width * contact.radius * sum(supple))
    pairs = zip(supple, flexibilities, contact.depths, strict=True)
    yields = [c * (2.0 * np.log(2.0 * h / half_width) - own.nu / (1.0 - own.nu)) for c, own, h in pairs]
    return np.asarray(sum(yields) / width)


def _suppleness(own: ToothFlexibility) -> float:
    """Return ``(1 − ν²)/(π E)`` [1/Pa]."""
    return (1.0 - own.nu**2) / (np.pi * own.E)


def _root_stress(contacts: Sequence[_Contact], flexibilities: Sequence[ToothFlexibility], forces: Array) -> Array:
    """Return the largest principal stress in the fillets of each gear's teeth in contact, shape (2, n_contacts)."""
    found = np.zeros((2, len(contacts)))
    for g, (own, sense) in enumerate(zip(flexibilities, (1, -1), strict=True)):
        for k in range(len(contacts)):
            tensor = np.zeros(own.stress.shape[1:3])
            for j, (loaded, force) in enumerate(zip(contacts, forces, strict=True)):
                tooth = own.stress.shape[0] // 2 + sense * (k - j)
                tensor += force * np.einsum("ncsb,sb->nc", own.stress[tooth], loaded.loads[g])
            full = tensor[:, TENSOR]
            found[g, k] = np.linalg.eigvalsh(full)[:, -1].max()
    return found
