"""Mechanisms whose contacts have published or exact solutions: a bouncing bar, and a block with a soft foot."""

import numpy as np

from fmd.contact.touching_body import ContactPlane, ContactPoints, TouchingBody
from fmd.core.arrays import Array
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.reduction.inertia import InertiaIntegrals
from fmd.scene.joints.free import FREE
from fmd.scene.joints.prismatic import PRISMATIC

E, RHO, LENGTH = 900.0, 1.0, 10.0


def bouncing_bar(n: int) -> Mechanism:
    """The bar of Doyen, Ern & Piperno (SIAM J Sci Comput 33, 2011) by its n lowest axial modes; it falls along -x."""
    k = np.arange(1, n + 1)
    omega, end = k * np.pi * np.sqrt(E / RHO) / LENGTH, np.full(n, np.sqrt(2.0 / (RHO * LENGTH)))
    residual = LENGTH / (3 * E) - np.sum(end**2 / omega**2)  # of the free bar by inertia relief, less the modes'
    G, shapes = np.zeros((3, 3, 1 + n, 1 + n)), np.zeros((1, 3, n))
    G[0, 0, 1:, 1:], G[0, 0, 0, 0], shapes[0, 0] = np.eye(n), RHO * LENGTH**3 / 12, end
    foot = ContactPoints(
        x=np.array([[-LENGTH / 2, 0.0, 0.0]]),
        areas={"foot": np.ones(1)},
        shapes=shapes,
        G=(residual * np.eye(3)).reshape(1, 3, 1, 3),
        faces={"foot": np.arange(1)},
    )
    plane = ContactPlane("floor", np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.0, "foot")
    integrals = InertiaIntegrals(G, np.zeros((3, 1 + n)), RHO * LENGTH)
    link = Link("bar", integrals, PRISMATIC, axis=np.array([1.0, 0.0, 0.0]), omega=omega)
    contacts = [TouchingBody("bar", foot, (plane,))]
    return Mechanism([link], gravity=np.array([-10.0, 0.0, 0.0]), contacts=contacts)


def soft_footed_block(
    size: tuple[float, float], mass: float, gravity: Array, friction: float, k: float, n: int = 8, damping: float = 0.0
) -> tuple[Mechanism, float]:
    """A rigid block, size along x and z, on a floor across z; and how far it sinks under its weight at rest."""
    a, b = size
    x = np.linspace(-a / 2, a / 2, n)
    C = np.exp(-np.abs(x[:, None] - x) / (a / 8)) / k
    foot = ContactPoints(
        x=np.stack([x, np.zeros(n), np.full(n, -b / 2)], axis=1),
        areas={"foot": np.full(n, a / n)},
        shapes=np.zeros((n, 3, 0)),
        G=np.einsum("ij,ab->iajb", C, np.eye(3)),
        faces={"foot": np.arange(n)},
    )
    plane = ContactPlane("floor", np.zeros(3), np.array([0.0, 0.0, 1.0]), friction, "foot", damping=damping)
    inertia = mass / 12 * np.array([b**2 + a**2, a**2 + b**2, 2 * a**2])
    link = Link("block", rigid_integrals(mass, np.zeros(3), np.diag(inertia)), FREE)
    mechanism = Mechanism([link], gravity=gravity, contacts=[TouchingBody("block", foot, (plane,))])
    return mechanism, float(mass * -gravity[2] / np.linalg.inv(C).sum())
