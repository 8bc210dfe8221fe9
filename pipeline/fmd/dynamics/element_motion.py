"""Force elements over a motion: strains, forces on both places and elastic energies, by NumPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.rotations import BodyFrame, moved, rotation_matrix, rotation_rate, rotation_vector, turned
from fmd.dynamics.elements import SHORTEST, Attachment, Element, PointSpring, SixAxisSpring

_SMALL = 1e-12


class States(NamedTuple):
    """States from which places of bodies are found.

    Attributes
    ----------
    frames : mapping of str to BodyFrame
        Each body's frame.
    q, rates : mapping of str to ndarray, shapes (n_times, n_modes)
        Each body's modal coordinates and their rates.
    n_times : int
        Number of states.
    """

    frames: dict[str, BodyFrame]
    q: dict[str, Array]
    rates: dict[str, Array]
    n_times: int


class Strain(NamedTuple):
    """Strain of an element, its rate, and what turns its force into forces in space.

    Attributes
    ----------
    values, rates : ndarray, shape (n_times, n)
        Elongation of a spring [m]; displacement and rotation vector of a bushing [m, rad].
    way, swing : ndarray, shape (n_times, 3)
        From the first place to the second, in space, and its rate.
    axes : ndarray, shape (n_times, 3, 3)
        The first place's axes in space.
    """

    values: Array
    rates: Array
    way: Array
    swing: Array
    axes: Array


def place_motion(states: States, end: Attachment) -> BodyFrame:
    """Return the motion of a force element's place: position, axes, velocity and angular velocity in space."""
    if not end.body:
        still = np.zeros((states.n_times, 3))
        axes = np.broadcast_to(end.axes, (states.n_times, 3, 3))
        return BodyFrame(np.broadcast_to(end.marker.position, (states.n_times, 3)), axes, still, still)
    frame, q, rates, at = states.frames[end.body], states.q[end.body], states.rates[end.body], end.marker
    bent, moving = moved(at.translation, at.bow[:3], q, rates)
    angle, turning = moved(at.rotation, at.bow[3:], q, rates)
    arm = turned(frame.rotation, at.position + bent)
    velocity = frame.velocity + np.cross(frame.spin, arm) + turned(frame.rotation, moving)
    spin = frame.spin + turned(frame.rotation, rotation_rate(angle, turning))
    return BodyFrame(frame.origin + arm, frame.rotation @ rotation_matrix(angle) @ end.axes, velocity, spin)


def element_strain(states: States, element: Element) -> Strain:
    """Return the strain of a force element and its rate at each state."""
    first, second = (place_motion(states, end) for end in element.ends)
    way, swing = second.origin - first.origin, second.velocity - first.velocity
    if isinstance(element, PointSpring):
        length = np.sqrt((way**2).sum(axis=1, keepdims=True) + SHORTEST**2)
        rate = (way * swing).sum(axis=1, keepdims=True) / length
        return Strain(length - element.rest, rate, way, swing, first.rotation)
    into = first.rotation.swapaxes(1, 2)
    d = turned(into, way) - element.position
    theta = rotation_vector(into @ second.rotation)
    d_rate = turned(into, swing - np.cross(first.spin, way))
    theta_rate = np.linalg.solve(_rate_matrix(theta), turned(into, second.spin - first.spin)[:, :, None])[:, :, 0]
    values, rates = np.concatenate([d, theta], axis=1), np.concatenate([d_rate, theta_rate], axis=1)
    return Strain(values, rates, way, swing, first.rotation)


def element_wrenches(states: States, element: Element) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return force and moment in space on the first and on the second place, (n_times, 3) each."""
    strain = element_strain(states, element)
    if isinstance(element, PointSpring):
        size = element.law.forces(strain.values[:, 0], strain.rates[:, 0])[:, None]
        pull = size * strain.way / (strain.values + element.rest)
        return (pull, np.zeros_like(pull)), (-pull, np.zeros_like(pull))
    f = -(strain.values @ element.K + strain.rates @ element.C)
    force = turned(strain.axes, f[:, :3])
    across = np.linalg.solve(_rate_matrix(strain.values[:, 3:]).swapaxes(1, 2), f[:, 3:, None])
    moment = turned(strain.axes, np.asarray(across[:, :, 0]))
    return (-force, -moment - np.cross(strain.way, force)), (force, moment)


def element_energies(states: States, element: Element) -> Array:
    """Return the elastic energy of a force element at each state [J], shape (n_times,)."""
    values = element_strain(states, element).values
    if isinstance(element, PointSpring):
        return element.law.energies(values[:, 0])
    return np.asarray(0.5 * np.einsum("ti,ij,tj->t", values, element.K, values))


def element_matrices(states: States, element: Element) -> tuple[Array, Array, Array, Array]:
    """Return stiffness and damping of an element, and those that its end stops add, by unit rates of one state.

    Parameters
    ----------
    states : States
        One state with each rate at 1 in turn, and last with all at 0.

    Returns
    -------
    tuple of ndarray, shapes (n, n)
        Of the element as it is, and what its end stops add where they touch.
    """
    strain = element_strain(states, element)
    J = (strain.rates[:-1] - strain.rates[-1]).T  # (n_strains, n)
    if isinstance(element, SixAxisSpring):
        none = np.zeros((J.shape[1], J.shape[1]))
        return J.T @ element.K @ J, J.T @ element.C @ J, none, none
    law, at = element.law, strain.values[-1]
    along = J.T @ J
    K = max(float(law.curve.slopes(at)[0]), 0.0) * along
    tension, length = float(law.curve.values(at)[0]), float(at[0] + element.rest)
    if tension > 0.0 and length > _SMALL:
        swing = (strain.swing[:-1] - strain.swing[-1]).T
        K = K + tension / length * (swing.T @ swing - along)
    return K, law.resting_damping * along, law.stop_stiffness * along, law.stop_damping * along


def _rate_matrix(theta: Array) -> Array:
    """Matrices A(θ), (n, 3, 3), by which a rotation vector's rate gives the angular velocity."""
    return np.stack([rotation_rate(theta, np.broadcast_to(unit, theta.shape)) for unit in np.eye(3)], axis=2)
