"""Links and lumped masses on a body: points that carry mass, moved by one linear map from independent unknowns.

The points of a body are the nodes of its mesh and, behind them, those of its links and masses. They move as
``u = T y``: a rigid link (RBE2) has six unknowns in place of those of its nodes, an average one (RBE3) follows its
nodes and has none. Stiffness and mass are matrices of the points, and ``Tᵀ K T``, ``Tᵀ (m ⊗ 1₃) T`` those of y. Rotary
inertia is that of points on rigid arms, exact for every length of the arms.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import RIGID_RESIDUAL, TIE_WHOLE
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms, join_arms, second_of_mean, second_of_rigid
from fmd.fem.constraints import Constraints, rows_of
from fmd.fem.idle_motions import without_idle_motions
from fmd.fem.markers import Marker
from fmd.fem.model import FEModel
from fmd.fem.rigid_pieces import CarriedPoints, carried_points, rigid_unknowns
from fmd.fem.sheet_ties import moved_already
from fmd.fem.ties import Tie


@dataclass(frozen=True)
class LinkedFace:
    """A reference point that moves a face rigidly, or follows it in the mean."""

    marker: Marker  # the face; rigid or averaged
    at: Array  # (3,): the reference point [m]
    # (n,): further points of a rigid link, which it moves but doesn't turn, as nodes of a shell
    pinned: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    onto: Marker | None = None  # a face that the reference of a rigid link follows in the mean, as a bar's end does

    @property
    def followed(self) -> Marker | None:
        """The face whose mean motion the reference has, if it has no motion of its own."""
        return self.onto if self.marker.rigid else self.marker


@dataclass(frozen=True)
class LumpedMass:
    """A rigid body on the reference point of a link."""

    link: str
    mass: float  # [kg]
    centre: Array  # (3,): centre of mass [m]
    inertia: Array  # (3, 3): inertia tensor about the centre of mass [kg m²]


@dataclass(frozen=True)
class Relation:
    """A sum of displacements of nodes and of displacements and rotations of references."""

    label: str  # what it is, for messages
    nodes: Mapping[int, Array]  # (3,): coefficients of each node's displacement
    links: Mapping[str, Array]  # (6,): coefficients of each reference's displacement and rotation
    stiffness: float = 0.0  # of a spring that resists the sum [N/m, or N m/rad]
    of_link: bool = False  # the first of its terms is of a reference, which follows the others


@dataclass(frozen=True)
class LinkedModel(FEModel):
    """A finite element model with links and masses, whose points are more than those of its mesh."""

    positions: Array  # (n_points, 3): positions of all points [m], those of the mesh's nodes first
    # (7,): numbers of the points that show the motion of each link: its reference, and six on arms around it
    references: Mapping[str, IntArray]
    # Further places that move with links: the link's name, and the position [m].
    places: Mapping[str, tuple[str, Array]] = field(default_factory=dict)
    # Ties of edges of which a part is on nothing that it could follow, and the share that is tied.
    part_ties: Mapping[str, float] = field(default_factory=dict)

    strained = False

    @property
    def x(self) -> Array:
        """Positions of all points, shape (n_points, 3) [m]."""
        return self.positions

    def marker(self, name: str) -> Marker:
        """Return the marker at the reference point of a link, or at a place that moves with one."""
        link, at = (name, None) if name in self.references else self.places[name]
        points = self.references[link]
        marker = arms_marker(points, self.positions[points])
        if at is None or (at == marker.position).all():
            return marker
        move = np.kron(marker.translation_weights, np.eye(3)).reshape(3, -1)
        offset = np.cross(marker.rotation_weights.reshape(3, -1), at - marker.position, axis=0)
        return replace(marker, position=at, translation_weights=(move + offset).reshape(3, -1, 3))


def arms_marker(points: IntArray, x: Array) -> Marker:
    """Return the marker at the first of seven points x (7, 3), which turns as the other six, ±a along three axes."""
    arms = x[1:] - x[0]
    square = float((arms**2).sum()) / 6
    rotation = np.zeros((3, 7, 3))
    rotation[:, 1:] = np.einsum("acb,pc->apb", EPSILON, arms) / (4 * square)  # Σ r × (θ × r) = 4 a² θ
    return Marker(x[0], points, np.eye(7)[0], rotation)


def inertia_points(mass: float, inertia: Array, length: float) -> tuple[Array, Array]:
    """Return places (7, 3) about the centre of mass and masses (7,) of points with a body's inertia.

    The second moment ``W = ½ tr(J) 1 − J`` is that of pairs of points along its principal axes, ``w_k = 2 μ_k a²``, by
    the tensor J about the centre of mass [kg m²]. Their mass is taken off the point in the middle. Where the inertia
    gives an arm no length it is ``length`` [m]; without inertia all other masses are 0.
    """
    total = 0.5 * float(np.trace(inertia))
    if mass > 0 and total > 0:
        length = float(np.sqrt(total / mass))  # no mass is left in the middle
    return rigid_body_points(mass, inertia, length)


def rigid_body_points(mass: float, inertia: Array, length: float) -> tuple[Array, Array]:
    """Return `inertia_points` on arms of a given length; the mass in the middle may be below zero."""
    w, e = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    places = np.concatenate([np.zeros((1, 3)), length * e.T, -length * e.T])
    around = w / (2 * length**2)
    return places, np.concatenate([[mass - 2 * around.sum()], around, around])


@dataclass(frozen=True)
class Linked:
    """All that is linked to a solid."""

    links: Mapping[str, LinkedFace] = field(default_factory=dict)  # by name; rigid ones have no node in common
    masses: Sequence[LumpedMass] = ()
    node_masses: Array | None = None  # (n_nodes,): lumped masses on the solid's own nodes [kg]
    equations: Sequence[Relation] = ()  # sums that are zero
    springs: Sequence[Relation] = ()  # sums that springs resist
    # Further places to show: the link that moves each, and its position [m].
    places: Mapping[str, tuple[str, Array]] = field(default_factory=dict)
    ties: Sequence[Tie] = ()  # faces that follow others; a node of two follows the first


def link_points(fe: FEModel, linked: Linked) -> LinkedModel:
    """Add links and lumped masses to the model of a solid.

    Raises
    ------
    ValueError
        Two rigid links share nodes, equations contradict them, or a mass isn't held by what it hangs on.
    """
    n, links, names = len(fe.x), linked.links, {name: k for k, name in enumerate(linked.links)}
    own_T = fe.point_map
    constraints = Constraints(own_T.shape[1], len(links))
    for tie in linked.ties:
        free = ~constraints.are_given(tie.unknowns)
        if not free.any():
            raise ValueError(moved_already(tie.label))
        constraints.give(tie.unknowns[free], tie.others, tie.weights[np.flatnonzero(free)])
    groups, weights, shown_at, carried = [], [np.zeros(0)], dict[str, tuple[str, int]](), list[list[CarriedPoints]]()
    for k, (name, link) in enumerate(links.items()):
        marker, grid = link.marker, constraints.grid(k)
        carried.append([])
        for nodes in (marker.nodes, link.pinned) if marker.rigid else ():
            if len(nodes):
                unknowns, values = rigid_unknowns(own_T, fe.x, nodes, link.at)
                constraints.give(unknowns, grid, values)
                carried[k].append(carried_points(own_T, unknowns, values, _second_of(link, fe.x)))
        if (followed := link.followed) is not None:
            mean = sp.csr_array(mean_motion(followed, link.at)) @ own_T[rows_of(followed.nodes)]
            unknowns = np.unique(mean.indices)
            constraints.give(grid, unknowns, mean[:, unknowns])
        arms = fe.x[marker.nodes] - marker.position
        length = float(np.linalg.norm(arms, axis=1).max(initial=0.0)) or float(np.ptp(fe.x, axis=0).max())
        on_it = [mass for mass in linked.masses if mass.link == name]
        points = [inertia_points(mass.mass, mass.inertia, length) for mass in on_it]
        shown, none = inertia_points(0.0, np.zeros((3, 3)), length)
        shown_places = [link.at]
        shown_at[name] = name, 0
        for place, (of, at) in linked.places.items():
            if of == name and place not in shown_at:
                same = [i for i, known in enumerate(shown_places) if (known == at).all()]
                shown_at[place] = name, same[0] if same else len(shown_places)
                shown_places += [] if same else [at]
        places = [mass.centre + at for mass, (at, _) in zip(on_it, points, strict=True)]
        groups.append(np.concatenate([*(at + shown for at in shown_places), *places]))
        weights += [*(none for _ in shown_places), *(each for _, each in points)]
    for equation in linked.equations:
        _apply(equation, constraints, names, own_T)
    T, independent = constraints.transformation()
    shown_rows = [
        sp.csr_array(rigid_motions(x - link.at).reshape(-1, 6)) @ T[constraints.grid(k)]
        for k, (link, x) in enumerate(zip(links.values(), groups, strict=True))
    ]
    x = np.concatenate([fe.x, *groups])
    starts = np.cumsum([n, *(len(own) for own in groups)])
    points_T = sp.csr_array(sp.vstack([own_T @ T[: constraints.n_unknowns], *shown_rows]))
    lumped = np.concatenate([np.zeros(n), *weights])
    if linked.node_masses is not None:
        lumped[: len(linked.node_masses)] += linked.node_masses
    m = sp.csr_array(fe.m, copy=True)
    m.resize((len(x), len(x)))
    m = sp.csr_array(m + sp.diags_array(lumped))
    stretch = _stretches(linked.springs, dict(zip(links, starts[:-1], strict=True)), x)
    K = sp.csr_array(fe.K, copy=True)
    K.resize((3 * len(x), 3 * len(x)))
    K = sp.csr_array(K + stretch.T @ stretch)
    first = constraints.n_unknowns
    of_link = [list(links)[(unknown - first) // 6] for unknown in independent[independent >= first]]
    points_T, n_linked = without_idle_motions(points_T, stretch, m, n, of_link) if of_link else (points_T, 0)
    return LinkedModel(
        fe.discretisation,
        fe.material,
        K,
        m,
        x,
        {place: starts[names[link]] + 7 * number + np.arange(7) for place, (link, number) in shown_at.items()},
        T=points_T,
        link_unknowns=n_linked,
        arms=join_arms(_own_arms(fe.arms, x, links, carried), _arms(x, list(links.values()), starts, carried)),
        directors=_own_arms(fe.directors, x, links, carried),
        part_ties={tie.label: tie.share for tie in linked.ties if tie.share < TIE_WHOLE},
    )


def _apply(equation: Relation, constraints: Constraints, links: Mapping[str, int], own_T: sp.csr_array) -> None:
    """Give one of the unknowns of an equation by the others: of its first term, or the first that isn't given yet."""
    rows = sp.csr_array(own_T[rows_of(np.array(list(equation.nodes), dtype=np.int64))])
    values = np.repeat(np.concatenate([np.zeros(0), *equation.nodes.values()]), np.diff(rows.indptr)) * rows.data
    grids = [constraints.grid(links[name]) for name in equation.links]
    all_terms = np.concatenate([rows.indices, *grids]), np.concatenate([values, *equation.links.values()])
    unknowns, first, place = np.unique(all_terms[0], return_index=True, return_inverse=True)
    order = np.argsort(first)  # that of the deck, whose first term is meant to follow the others
    unknowns, coefficients = unknowns[order], np.bincount(place, all_terms[1])[order]
    unknowns, coefficients = unknowns[coefficients != 0], coefficients[coefficients != 0]
    free = np.flatnonzero(~constraints.are_given(unknowns))
    if equation.of_link:
        free = free[np.argsort(unknowns[free] < constraints.n_unknowns, kind="stable")]
    if not free.size:
        raise ValueError(f"{equation.label}: all of its displacements are moved by links or other equations")
    others = np.delete(np.arange(len(unknowns)), free[0])
    row = -coefficients[others] / coefficients[free[0]]
    constraints.give(unknowns[free[:1]], unknowns[others], row[None])


def _stretches(springs: Sequence[Relation], starts: Mapping[str, int], x: Array) -> sp.csr_array:
    """Return rows (n_springs, 3 n_points) whose squared products with displacements are twice the springs' energies."""
    rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    for k, spring in enumerate(springs):
        terms = [(np.array([node]), of_node) for node, of_node in spring.nodes.items()]
        for name, of_link in spring.links.items():
            shown = starts[name] + np.arange(7)
            turn = arms_marker(shown, x[shown]).rotation_weights
            terms += [(shown[:1], of_link[:3]), (shown, np.tensordot(of_link[3:], turn, axes=1).ravel())]
        for points, each in terms:
            columns.append(rows_of(points))
            values.append(np.sqrt(spring.stiffness) * each)
            rows.append(np.full(len(columns[-1]), k))
    place = np.concatenate(rows), np.concatenate(columns)
    return sp.csr_array((np.concatenate(values), place), shape=(len(springs), 3 * len(x)))


def mean_motion(marker: Marker, at: Array) -> Array:
    """Return displacement and rotation of a point that follows a face in the mean, shape (6, 3 n)."""
    turn = marker.rotation_weights.reshape(3, -1)
    move = np.kron(marker.translation_weights, np.eye(3))
    return np.concatenate([move + np.cross(turn, at - marker.position, axis=0), turn])


def _second_of(link: LinkedFace, x: Array) -> Callable[[Array], Array]:
    """Return the function of arms r (k, 3) from a link's reference [m] that gives their ``second`` of `Arms`."""
    if (followed := link.followed) is None:
        return second_of_rigid
    places = x[followed.nodes] - followed.position
    return lambda r: second_of_mean(link.at + r - followed.position, places, followed.rotation_weights)


def _arms(
    x: Array, links: Sequence[LinkedFace], starts: IntArray, carried: Sequence[Sequence[CarriedPoints]]
) -> Arms | None:
    """Return the arms of all links: their points, from ``starts`` on, and what the rigid ones carry."""
    if not links:
        return None
    points, number, second, turns = [], [], [], []
    for k, (link, moved) in enumerate(zip(links, carried, strict=True)):
        own = np.arange(starts[k], starts[k + 1])
        second += [*(each.second for each in moved), _second_of(link, x)(x[own] - link.at)]
        points += [*(places for each in moved for places in (each.points, each.beside)), own]
        number.append(np.full(len(own) + sum(len(each.second) for each in moved), k))
        shown = starts[k] + np.arange(7)
        rotation = arms_marker(shown, x[shown]).rotation_weights.reshape(3, -1)
        place = (np.repeat(np.arange(3), 21), np.tile(rows_of(shown), 3))
        turns.append(sp.csr_array((rotation.ravel(), place), shape=(3, 3 * len(x))))
    return Arms(np.concatenate(points), np.concatenate(number), sp.csr_array(sp.vstack(turns)), np.concatenate(second))


def _own_arms(
    own: Arms | None, x: Array, links: Mapping[str, LinkedFace], carried: Sequence[Sequence[CarriedPoints]]
) -> Arms | None:
    """Return the arms of a shell's or a beam's own nodes without those that turn with a rigid link."""
    if own is None:
        return None
    turned = np.zeros(len(x), dtype=bool)
    for link, each in ((link, each) for link, own in zip(links.values(), carried, strict=True) for each in own):
        off = x[each.points] - link.at - each.arms
        turned[each.points] = np.abs(off).max(axis=1, initial=0.0) < RIGID_RESIDUAL * np.ptp(x)
    free = ~turned[own.points]
    turn = sp.csr_array(own.turn, copy=True)
    turn.resize((turn.shape[0], 3 * len(x)))
    return Arms(own.points[free], own.link[free], turn, own.second[free])
