"""Beams, rigid bodies and joints in space: geometrically exact, without frame, modes or reduction.

Nodes have a place and a rotation. An element between two nodes has the twist of the screw motion from one to the other
for its strain (Sonneville, Cardona & Brüls, Comput Methods Appl Mech Engrg 268, 2014), so that it neither locks nor
knows of rigid motions. Masses are lumped, joints are equations with multipliers, and generalised-α on rotations
(Brüls & Cardona, J Comput Nonlinear Dyn 5, 2010) marches the whole. All errors fall with the square of element and
step, so that two meshes are extrapolated. Nothing is shared with the product.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import bmat, csc_matrix
from scipy.sparse.linalg import splu

from fmd.core.arrays import Array, IntArray

DAMPED = 0.8  # spectral radius of generalised-α at high frequencies
CORRECTIONS, ANEW = 40, 4  # of a step, and after how many its matrix is made anew
SOLVED, TOO_FAR = 1e-11, 10.0  # corrections [m, rad]
SMALL_ANGLE = 1e-3  # below which series take the place of quotients
BERNOULLI = ((1, 0.5), (2, 1 / 12), (4, -1 / 720), (6, 1 / 30240), (8, -1 / 1209600), (10, 1 / 47900160))
E = np.eye(3)


def hat(w: Array) -> Array:
    """Return the matrices (…, 3, 3) of cross products with vectors (…, 3)."""
    found = np.zeros((*w.shape, 3))
    found[..., 2, 1], found[..., 0, 2], found[..., 1, 0] = w[..., 0], w[..., 1], w[..., 2]
    return found - np.swapaxes(found, -1, -2)


def turn_by(w: Array) -> Array:
    """Return the rotations (…, 3, 3) by rotation vectors (…, 3)."""
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    W, small = hat(w), angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1 - angle**2 / 6, np.sin(safe) / safe)
    second = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    return np.asarray(E + first * W + second * (W @ W))


def rotation_vector(R: Array) -> Array:
    """Return the rotation vectors (…, 3) of rotations (…, 3, 3) below a half turn."""
    odd = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1) / 2
    sine = np.linalg.norm(odd, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    small = sine < SMALL_ANGLE
    return odd * np.where(small, 1 + sine**2 / 6, angle / np.where(small, 1.0, sine))[..., None]


def strains_of(x: Array, R: Array, ends: IntArray) -> tuple[Array, Array]:
    """Return the screws (n, 6) from each element's first node to its second, and their slopes by both (n, 6, 12).

    A screw is its translation [m] and rotation [rad], in axes that move with the element; the slopes are by places in
    space and rotations in the nodes' own axes.
    """
    first, second = R[ends[:, 0]], R[ends[:, 1]]
    theta = rotation_vector(first.swapaxes(1, 2) @ second)
    p = np.einsum("nji,nj->ni", first, x[ends[:, 1]] - x[ends[:, 0]])
    angle, W = np.linalg.norm(theta, axis=1)[:, None, None], hat(theta)
    small = angle < SMALL_ANGLE
    half = np.where(small, 1.0, angle) / 2
    factor = np.where(small, 1 / 12 + angle**2 / 720, (1 - half / np.tan(half)) / (4 * half**2))
    u = ((E - W / 2 + factor * (W @ W)) @ p[:, :, None])[:, :, 0]
    ad = np.zeros((len(ends), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = W
    ad[:, :3, 3:] = hat(u)
    square, power = ad @ ad, np.broadcast_to(np.eye(6), ad.shape)
    even, odd = np.broadcast_to(np.eye(6), ad.shape).copy(), 0.5 * ad
    for k, factor_k in BERNOULLI[1:]:
        power = square if k == 2 else power @ square
        even += factor_k * power
    slopes = np.zeros((len(ends), 6, 12))
    slopes[:, :, :6], slopes[:, :, 6:] = -(even - odd), even + odd
    slopes[:, :, 0:3] = slopes[:, :, 0:3] @ first.swapaxes(1, 2)
    slopes[:, :, 6:9] = slopes[:, :, 6:9] @ second.swapaxes(1, 2)
    return np.concatenate([u, theta], axis=1), slopes


@dataclass
class Joint:
    """A joint between points of two nodes; what it leaves free has a coordinate, an angle or a way along its axis."""

    parent: int
    child: int
    at_parent: Array  # (3,): the joint's place from the parent's node, in its axes [m]
    at_child: Array
    kind: str = "fixed"  # or "revolute", "prismatic", "spherical", "driven"
    axis: Array = field(default_factory=lambda: E[0])
    angle: Callable[[float], float] = lambda t: 0.0  # of a driven joint [rad]
    load: Callable[[float], float] = lambda t: 0.0  # along its coordinate [N m] or [N]
    spring: float = 0.0
    damper: float = 0.0

    def __post_init__(self) -> None:
        self.axis = self.axis / np.linalg.norm(self.axis)
        across = np.linalg.svd(self.axis[None])[2][1:]
        self.pairs = [(E[0], E[1]), (E[1], E[2]), (E[2], E[0])]  # of directions that stay at right angles
        if self.kind == "revolute":
            self.pairs = [(b, self.axis) for b in across]
        elif self.kind == "spherical":
            self.pairs = []
        self.along = across if self.kind == "prismatic" else E
        self.across = np.stack([across[0], np.cross(self.axis, across[0])])
        self.turned = 0.0  # the coordinate at the last step, so that angles go on beyond a half turn
        self.has_load = self.kind in ("revolute", "prismatic")  # something acts along the free coordinate

    def equations(self, x: Array, R: Array, t: float) -> tuple[Array, Array]:
        """Return what has to vanish (m,) and its slopes by both nodes, parent's first, (m, 12)."""
        Rp, Rc = R[self.parent], R[self.child]
        apart = Rp.T @ (x[self.child] + Rc @ self.at_child - x[self.parent])
        Q = Rp.T @ Rc
        place = np.concatenate([-Rp.T, hat(apart), Rp.T, -Q @ hat(self.at_child)], axis=1)
        found, slopes = [self.along @ (apart - self.at_parent)], [self.along @ place]
        back = turn_by(-self.axis * self.angle(t)) if self.kind == "driven" else E
        for b, given in self.pairs:
            f = back @ given
            found.append(np.array([b @ Q @ f]))
            slopes.append(np.concatenate([np.zeros(3), -np.cross(Q @ f, b), np.zeros(3), np.cross(f, Q.T @ b)])[None])
        return np.concatenate(found), np.concatenate(slopes)

    def coordinate(self, x: Array, R: Array) -> tuple[float, Array]:
        """Return the free coordinate, and its slopes by both nodes (12,)."""
        Rp, Rc = R[self.parent], R[self.child]
        if self.kind == "prismatic":
            apart = Rp.T @ (x[self.child] + Rc @ self.at_child - x[self.parent])
            slope = np.concatenate([-Rp.T, hat(apart), Rp.T, -Rp.T @ Rc @ hat(self.at_child)], axis=1)
            return float(self.axis @ (apart - self.at_parent)), self.axis @ slope
        b, c = self.across
        moved = Rp.T @ Rc @ b
        angle = float(np.arctan2(c @ moved, b @ moved))
        angle += 2 * np.pi * round((self.turned - angle) / (2 * np.pi))
        return angle, np.concatenate([np.zeros(3), -self.axis, np.zeros(3), self.axis])


@dataclass
class Bodies:
    """Nodes, elements and joints; node 0 is the ground."""

    x: Array  # (n, 3): places at the start [m]
    mass: Array  # (n,)
    inertia: Array  # (n, 3, 3): of each node about itself, in its axes [kg m²]
    ends: IntArray  # (n_elements, 2): nodes of each element
    stiffness: Array  # (n_elements, 6): against stretch, shears, twist and bendings [N], [N m²]
    joints: list[Joint]
    # Node, place in its axes, force in space or, if it follows, in the node's axes [N].
    pushes: list[tuple[int, Array, Callable[[float], Array], bool]]
    gravity: Array
    v: Array  # (n, 6): velocities in space and rates in the nodes' axes at the start
    fixed: tuple[int, ...] = (0,)  # nodes that don't move
    R: Array | None = None  # (n, 3, 3): rotations at the start; none of all nodes by default

    def __post_init__(self) -> None:
        n = len(self.x)
        self.R = np.tile(E, (n, 1, 1)) if self.R is None else self.R
        self.undeformed = strains_of(self.x, self.R, self.ends)[0]
        self.lengths = np.linalg.norm(self.undeformed[:, :3], axis=1)
        self.free = np.setdiff1d(np.arange(6 * n), (6 * np.array(self.fixed)[:, None] + np.arange(6)).ravel())
        self.dofs = (6 * self.ends[:, :, None] + np.arange(6)).reshape(-1, 12)
        self.joint_dofs = [
            np.r_[6 * each.parent : 6 * each.parent + 6, 6 * each.child : 6 * each.child + 6] for each in self.joints
        ]
        self.rows = np.repeat(self.dofs, 12, axis=1).ravel()
        self.columns = np.tile(self.dofs, (1, 12)).ravel()

    def wrenches(self, x: Array, R: Array) -> tuple[Array, Array]:
        """Return force and moment in each element (n, 6), in its axes, and the slopes of its screw (n, 6, 12)."""
        screw, slopes = strains_of(x, R, self.ends)
        return self.stiffness * (screw - self.undeformed) / self.lengths[:, None], slopes

    def loads(self, x: Array, R: Array, v: Array, t: float) -> Array:
        """Return forces that act from without, on all nodes (n, 6): pushes, weight and those of joints' coordinates."""
        f = np.zeros((len(x), 6))
        f[:, :3] = self.mass[:, None] * self.gravity
        for node, place, push, follows in self.pushes:
            force = R[node] @ push(t) if follows else push(t)
            f[node, :3] += force
            f[node, 3:] += np.cross(place, R[node].T @ force)
        for joint, dofs in zip(self.joints, self.joint_dofs, strict=True):
            if joint.has_load:
                at, slope = joint.coordinate(x, R)
                size = joint.load(t) - joint.spring * at - joint.damper * (slope @ v.ravel()[dofs])
                f.ravel()[dofs] += size * slope
        return f

    def residual(self, x: Array, R: Array, v: Array, a: Array, t: float) -> tuple[Array, Array]:
        """Return inertia and forces that don't balance, without joints (6 n,), and the slopes of screws."""
        inner, slopes = self.wrenches(x, R)
        r = -self.loads(x, R, v, t)
        r[:, :3] += self.mass[:, None] * a[:, :3]
        w = v[:, 3:, None]
        spin = self.inertia @ a[:, 3:, None] + hat(v[:, 3:]) @ (self.inertia @ w)
        r[:, 3:] += spin[:, :, 0]
        flat = r.ravel()
        flat += np.bincount(self.dofs.ravel(), (inner[:, None, :] @ slopes).ravel(), len(flat))
        return flat, slopes

    def constraints(self, x: Array, R: Array, t: float) -> tuple[Array, csc_matrix]:
        """Return what the joints' equations leave (m,), and their slopes (m, 6 n)."""
        left, rows, columns, values, m = [np.zeros(0)], [], [], [], 0
        for joint, dofs in zip(self.joints, self.joint_dofs, strict=True):
            own, slopes = joint.equations(x, R, t)
            left.append(own)
            rows.append(np.repeat(np.arange(m, m + len(own)), 12))
            columns.append(np.tile(dofs, len(own)))
            values.append(slopes.ravel())
            m += len(own)
        if not m:
            return np.zeros(0), csc_matrix((0, 6 * len(x)))
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return np.concatenate(left), csc_matrix(entries, (m, 6 * len(x)))

    def mass_matrix(self) -> csc_matrix:
        """Return the mass matrix of all nodes (6 n, 6 n), which is constant in their axes."""
        n = len(self.x)
        blocks = np.zeros((n, 6, 6))
        blocks[:, :3, :3], blocks[:, 3:, 3:] = self.mass[:, None, None] * E, self.inertia
        dofs = np.arange(6 * n).reshape(n, 6)
        return csc_matrix((blocks.ravel(), (np.repeat(dofs, 6, axis=1).ravel(), np.tile(dofs, (1, 6)).ravel())))

    def stiffness_matrix(self, slopes: Array) -> csc_matrix:
        """Return the stiffness of the material (6 n, 6 n), without what forces add."""
        K = slopes.swapaxes(1, 2) @ ((self.stiffness / self.lengths[:, None])[:, :, None] * slopes)
        n = 6 * len(self.x)
        return csc_matrix((K.ravel(), (self.rows, self.columns)), (n, n))

    def moved(self, x: Array, R: Array, by: Array) -> tuple[Array, Array]:
        """Return places and rotations after increments (n, 6)."""
        return x + by[:, :3], R @ turn_by(by[:, 3:])

    def start(self, h: float) -> Array:
        """Return the accelerations at the start (n, 6), with which the joints' equations go on to hold."""
        x, R, v, free = self.x, self.R, self.v, self.free
        before, now, after = (self.constraints(*self.moved(x, R, k * h * v), k * h)[0] for k in (-1, 0, 1))
        G = self.constraints(x, R, 0.0)[1][:, free]
        r = self.residual(x, R, v, np.zeros_like(v), 0.0)[0][free]
        both = _bordered(self.mass_matrix()[free][:, free], G)
        found = splu(both).solve(np.concatenate([-r, -(after - 2 * now + before) / h**2]))
        a = np.zeros(6 * len(x))
        a[free] = found[: len(free)]
        return a.reshape(-1, 6)

    def march(
        self, h: float, n_steps: int, every: int, look: Callable[[Array, Array, Array, Array, float], None]
    ) -> None:
        """Integrate by generalised-α and show places, rotations, rates and accelerations every few steps."""
        free, rho = self.free, DAMPED
        am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        gamma, beta = 0.5 + af - am, 0.25 * (1 + af - am) ** 2
        of_v, of_a = gamma / (h * beta), (1 - am) / (h * h * beta * (1 - af))
        x, R, v = self.x, self.R, self.v
        a = self.start(1e-4 * h * n_steps)
        mean, M = a.copy(), self.mass_matrix()
        forces = np.zeros(self.constraints(x, R, 0.0)[1].shape[0])
        look(x, R, v, a, 0.0)
        for k in range(n_steps):
            t = (k + 1) * h
            by0, v0, a0 = h * v + h * h / 2 * mean, v + h * mean, (mean - af * a) / (1 - af)
            by = by0
            for correction in range(CORRECTIONS):
                xn, Rn = self.moved(x, R, by)
                vn, an = v0 + of_v * (by - by0), a0 + of_a * (by - by0)
                r, slopes = self.residual(xn, Rn, vn, an, t)
                left, G = self.constraints(xn, Rn, t)
                G = G[:, free]
                r = r[free] + G.T @ forces
                if correction % ANEW == 0:
                    scale = of_a * M.diagonal().mean()
                    S = (of_a * M + self.stiffness_matrix(slopes))[free][:, free]
                    solver = splu(_bordered(S, scale * G))
                change = solver.solve(-np.concatenate([r, scale * left]))
                by = by.copy()
                by.ravel()[free] += change[: len(free)]
                forces = forces + scale * change[len(free) :]
                largest = np.abs(change[: len(free)]).max()
                if largest < SOLVED:
                    break
                if not largest < TOO_FAR:
                    raise RuntimeError(f"the step to t = {t:g} s was not found")
            else:
                raise RuntimeError(f"the step to t = {t:g} s was not found")
            x, R = self.moved(x, R, by)
            v, new = v0 + of_v * (by - by0), a0 + of_a * (by - by0)
            mean = ((1 - af) * new + af * a - am * mean) / (1 - am)
            a = new
            for joint in self.joints:
                if joint.has_load:
                    joint.turned = joint.coordinate(x, R)[0]
            if (k + 1) % every == 0:
                look(x, R, v, a, t)


def _bordered(S: csc_matrix, G: csc_matrix) -> csc_matrix:
    """Return the matrix of equations with multipliers."""
    return csc_matrix(bmat([[S, G.T], [G, None]])) if G.shape[0] else csc_matrix(S)
