"""Accelerations of bodies made of mass points by d'Alembert's principle: plain NumPy, slow, and sharing no code.

Places are products of rotation matrices, velocities complex steps of them, and accelerations at constant rates
differences of order 8. Forces do their work on what moves (Kane & Levinson, Dynamics, McGraw-Hill, 1985).
"""

import numpy as np

from fmd.core.arrays import Array
from fmd.scene.joints.constant_velocity import CONSTANT_VELOCITY
from fmd.scene.joints.cylindrical import CYLINDRICAL
from fmd.scene.joints.free import FREE
from fmd.scene.joints.planar import PLANAR
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.screw import SCREW
from fmd.scene.joints.spherical import SPHERICAL
from fmd.scene.joints.universal import UNIVERSAL
from tests.dynamics.compiler.mechanisms import PointMechanism, Points

STEP = 1e-30  # of complex differences
WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)


def tilde(a: Array) -> Array:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rotation(w: Array) -> Array:
    """Rotation matrix of a rotation vector by Rodrigues' formula, analytic in its entries."""
    squared, W = w @ w, tilde(w)
    if abs(squared) < 1e-6:  # by series, to 1e-21
        sine, cosine = 1 - squared / 6 * (1 - squared / 20), 0.5 - squared / 24 * (1 - squared / 30)
    else:
        angle = np.sqrt(squared)
        sine, cosine = np.sin(angle) / angle, (1 - np.cos(angle)) / squared
    return np.asarray(np.eye(3) + sine * W + cosine * (W @ W))


def accelerations(made: PointMechanism, t: float, q: Array, v: Array) -> Array:
    """Solve ``Σ m Jᵀ (J a + bias − g) = Q`` over all points."""
    return np.linalg.solve(*mass_and_force(made, t, q, v))


def mass_and_force(made: PointMechanism, t: float, q: Array, v: Array) -> tuple[Array, Array]:
    """Inertia ``Σ m Jᵀ J`` and force ``Q + Σ m Jᵀ (g − bias)`` of all points."""
    mechanism = made.mechanism
    J = np.stack([velocities(made, t, q, unit, flow=0.0)[0] for unit in np.eye(mechanism.n)], axis=-1)
    m = np.concatenate([body.m for body in made.points])
    M = np.einsum("i,iaj,iak->jk", m, J, J)
    lack = mechanism.gravity - bias(made, t, q, v)
    M, force = M.copy(), np.einsum("i,iaj,ia->j", m, J, lack) + forces(made, t, q, v)
    for k, (body, link) in enumerate(zip(made.points, mechanism.links, strict=True)):
        if link.integrals.whole:
            continue
        modes = mechanism.modes_of(k)
        mass, slowed = second_order_mass(body, q[modes + mechanism.n_positions - mechanism.n], v[modes])
        M[np.ix_(modes, modes)] += mass
        force[modes] -= slowed
    return M, force


def second_order_mass(body: Points, z: Array, dz: Array) -> tuple[Array, Array]:
    """Inertia and force at constant rates of points that move by ``Φ z + R w``, less those that move by ``Φ z``.

    R w is the rigid motion of the undeformed body that has the momenta of its points of second order, quadratic in z.
    """
    x, m = body.x, body.m
    R = np.concatenate([np.broadcast_to(np.eye(3), (len(x), 3, 3)), -np.array([tilde(at) for at in x])], axis=2)
    momenta = np.einsum("i,iak,iajl->kjl", m, R, body.Gamma)
    moves = np.linalg.solve(np.einsum("i,iak,ial->kl", m, R, R), momenta.reshape(6, -1)).reshape(momenta.shape)
    moved = np.einsum("iak,kjl->iajl", R, moves)
    slopes = body.Phi + moved @ z
    M = np.einsum("i,iaj,iak->jk", m, slopes, slopes) - np.einsum("i,iaj,iak->jk", m, body.Phi, body.Phi)
    return M, np.einsum("i,iaj,ia->j", m, slopes, moved @ dz @ dz)


def frames(made: PointMechanism, t: complex, q: Array) -> list[tuple[Array, Array, Array]]:
    """Origin, rotation and modal coordinates of each body; analytic in t and q."""
    mechanism = made.mechanism
    out: list[tuple[Array, Array, Array]] = []
    for k, link in enumerate(mechanism.links):
        origin, R, inner = np.zeros(3), np.eye(3), np.zeros(0)
        if link.parent >= 0:
            origin, R, inner = out[link.parent]
        at = link.place
        bent, turned = marker_motion(at.translation, at.rotation, at.displacement2, inner)
        origin, R = origin + R @ (at.position + bent), R @ rotation(turned) @ link.place_axes
        axis = link.axis / np.linalg.norm(link.axis)
        s = q[mechanism.layout.position[k] : mechanism.layout.position[k] + link.n_positions]
        if link.motion is not None:
            value, rate, _ = link.motion.value(np.real(t))
            s = np.array([value + 1j * np.imag(t) * rate])
        if link.joint == REVOLUTE:
            R = R @ rotation(s[0] * axis)
        elif link.joint == PRISMATIC:
            origin = origin + R @ (s[0] * axis)
        elif link.joint == UNIVERSAL:
            other = link.other_axis / np.linalg.norm(link.other_axis)
            R = R @ rotation(s[0] * axis) @ rotation(s[1] * other)
        elif link.joint == CYLINDRICAL:
            origin, R = origin + R @ (s[0] * axis), R @ rotation(s[1] * axis)
        elif link.joint == SCREW:
            origin, R = origin + R @ (s[0] * link.lead * axis), R @ rotation(s[0] * axis)
        elif link.joint == CONSTANT_VELOCITY:
            u = across(axis)
            half = rotation(0.5 * s[0] * u)
            R = R @ half @ rotation(s[1] * np.cross(axis, u)) @ half
        elif link.joint == PLANAR:
            u = across(axis)
            origin = origin + R @ (s[0] * u + s[1] * np.cross(axis, u))
            R = R @ rotation(s[2] * axis)
        elif link.joint in (SPHERICAL, FREE):
            origin = origin + R @ s[:3] if link.joint == FREE else origin
            u, w = s[-4:-1], s[-1]
            R = R @ ((w * w - u @ u) * np.eye(3) + 2 * np.outer(u, u) + 2 * w * tilde(u))
        out.append((origin, R, q[mechanism.modes_of(k) + mechanism.n_positions - mechanism.n]))
    return out


def across(axis: Array) -> Array:
    """Unit vector across an axis: that of x, y and z which is most across it, without its part along the axis."""
    most = np.eye(3)[np.abs(axis).argmin()]
    u = most - (most @ axis) * axis
    return np.asarray(u / np.linalg.norm(u))


def marker_motion(shapes: Array, rotations: Array, displacement2: Array, z: Array) -> tuple[Array, Array]:
    """Displacement and rotation vector of a marker."""
    second = 0.5 * (displacement2 @ z) @ z if displacement2.size else np.zeros(6)
    first = [values @ z if values.size else np.zeros(3) for values in (shapes, rotations)]
    return first[0] + second[:3], first[1] + second[3:]


def rate_of_positions(made: PointMechanism, q: Array, v: Array) -> Array:
    """q̇ for rates v: a quaternion's is ½ e ∘ (ω, 0)."""
    mechanism, dq = made.mechanism, np.zeros(len(q))
    for k, link in enumerate(mechanism.links):
        p, r = mechanism.layout.position[k], mechanism.layout.rate[k]
        if link.joint in (SPHERICAL, FREE):
            skip = 3 if link.joint == FREE else 0
            dq[p : p + skip] = v[r : r + skip]
            e, w = q[p + skip : p + skip + 4], v[r + skip : r + skip + 3]
            dq[p + skip : p + skip + 3] = 0.5 * (e[3] * w + np.cross(e[:3], w))
            dq[p + skip + 3] = -0.5 * e[:3] @ w
        else:
            dq[p : p + link.n_positions] = v[r : r + link.n_rates]
        modes = mechanism.modes_of(k)
        dq[modes + mechanism.n_positions - mechanism.n] = v[modes]
    return dq


def velocities(made: PointMechanism, t: float, q: Array, v: Array, flow: float = 1.0) -> tuple[Array, Array]:
    """Velocities of all points and angular velocities of all bodies for rates v; without prescribed ones for flow 0."""
    moved = frames(made, t + 1j * STEP * flow, q + 1j * STEP * rate_of_positions(made, q, v))
    points = [o + body.moved(z) @ R.T for (o, R, z), body in zip(moved, made.points, strict=True)]
    return np.concatenate(points).imag / STEP, np.array([spin(R) for _, R, _ in moved])


def spin(R: Array) -> Array:
    W = R.imag @ R.real.T / STEP
    return np.array([W[2, 1], W[0, 2], W[1, 0]])


def bias(made: PointMechanism, t: float, q: Array, v: Array, step: float = 0.01) -> Array:
    """Accelerations of all points at constant rates."""
    total = np.zeros_like(velocities(made, t, q, v)[0])
    for k, weight in enumerate(WEIGHTS, start=1):
        for side in (1, -1):
            h = side * k * step
            total += side * weight / step * velocities(made, t + h, advance(made, q, v, h), v)[0]
    return total


def advance(made: PointMechanism, q: Array, v: Array, h: float) -> Array:
    """Positions after a time h at constant rates, with which a quaternion goes round a circle."""
    dq, mechanism = rate_of_positions(made, q, v), made.mechanism
    moved = q + h * dq
    for k, link in enumerate(mechanism.links):
        if link.joint in (SPHERICAL, FREE):
            last, spin_last = mechanism.layout.position[k] + link.n_positions, mechanism.layout.rate[k] + link.n_rates
            e, half = slice(last - 4, last), 0.5 * h * np.linalg.norm(v[spin_last - 3 : spin_last])
            moved[e] = np.cos(half) * q[e] + np.sinc(half / np.pi) * h * dq[e]
    return np.asarray(moved)


def forces(made: PointMechanism, t: float, q: Array, v: Array) -> Array:
    """Generalised forces of modes, springs, dampers, drives and point loads."""
    mechanism, Q = made.mechanism, np.zeros(made.mechanism.n)
    shift = mechanism.n_positions - mechanism.n
    for k, link in enumerate(mechanism.links):
        modes, i = mechanism.modes_of(k), mechanism.layout.rate[k]
        Q[modes] -= link.omega**2 * q[modes + shift]
        Q[modes] -= 2 * link.damping * link.omega * v[modes] if len(link.damping) else 0.0
        if link.n_rates == 1:
            grip = link.joint_rotation if len(link.joint_rotation) else np.zeros(len(modes))
            z, displacement2 = (
                q[modes + shift],
                link.joint_displacement2 if link.joint_displacement2.size else np.zeros((len(modes),) * 2),
            )
            s = q[mechanism.layout.position[k]] + grip @ z + 0.5 * z @ displacement2 @ z
            grip = grip + displacement2 @ z
            ds = v[i] + grip @ v[modes]
            along = link.load.value(t)[0] - link.spring * (s - link.rest) - link.damper * ds
            Q[i] += along
            Q[modes] += grip * along
        for j, law in enumerate(link.laws):
            x = q[mechanism.layout.position[k] + j]
            Q[i + j] -= sum(a * x**p for p, a in enumerate(law.curve.polynomial)) + law.damping * v[i + j]
    for load in mechanism.loads:
        for j, unit in enumerate(np.eye(mechanism.n)):
            Q[j] += power(made, load, t, q, unit)
    return Q


def power(made: PointMechanism, load: object, t: float, q: Array, v: Array) -> float:
    """Power of a point load for rates v."""
    k = [link.name for link in made.mechanism.links].index(load.body)
    moved = frames(made, t, q + 1j * STEP * rate_of_positions(made, q, v))
    origin, R, z = moved[k]
    bent, turned = marker_motion(load.marker.translation, load.marker.rotation, load.marker.displacement2, z)
    point, section = origin + R @ (load.marker.position + bent), R @ rotation(turned)
    force = load.size.value(t)[0] * load.direction / np.linalg.norm(load.direction)
    force = section.real @ force if load.following else force
    return float(force @ (spin(section) if load.torque else point.imag / STEP))
