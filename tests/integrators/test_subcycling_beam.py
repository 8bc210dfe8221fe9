"""Sub-cycling on the beam of the scene: accuracy at equal fast step, order, conservation over 10⁶ steps, its limit."""

from collections.abc import Callable

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.errors import StabilityError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import Integrator, Trajectory
from fmd.integrators.subcycling import Subcycling
from fmd.recovery.motion import Motion
from tests.dynamics.hinged_body import angular_momentum, body_of, energies

Method = Callable[[float], CentralDifference | Subcycling]
Order = Callable[[Array, Array], float]

STEP = 1e-5  # the scene's
CONSERVING = pytest.mark.parametrize(
    "method", [CentralDifference, lambda h: Subcycling(h, 5), lambda h: Subcycling(h, 10)], ids=["plain", "5:1", "10:1"]
)
SPINS = pytest.mark.parametrize("spin", [20.0, 200.0])  # rad/s


def driven(method: Integrator, rotor: CompiledSystem, times: Array) -> Motion:
    rest = np.zeros(rotor.n)
    return Motion(rotor.mechanism, method.march(rotor, rest, rest, times), "beam.tip")


def largest(difference: Array) -> float:
    return float(np.abs(difference).max())


# Accuracy --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [2, 5, 10])
def test_at_equal_fast_step_the_tip_is_as_accurate_as_without_sub_cycling(
    rotor: CompiledSystem, exact: Motion, m: int
) -> None:
    # The angle alone takes the longer steps, and the deflection is seen from the section at the joint.
    plain, sub_cycled = (
        largest(driven(method, rotor, exact.times).tip_deflection - exact.tip_deflection)
        for method in (CentralDifference(STEP), Subcycling(STEP, m))
    )
    assert plain < 1e-3 * largest(exact.tip_deflection)
    assert sub_cycled <= 1.1 * plain


@pytest.mark.parametrize("quantity", ["tip_deflection", "modes", "joint", "tip_position"])
def test_the_measured_order_is_the_declared_one(
    rotor: CompiledSystem, exact: Motion, method: Method, order_of: Order, quantity: str
) -> None:
    # The first 0.15 s, with the whole torque pulse, whose ends are multiples of every major step.
    first = exact.times < 0.1501
    values: dict[str, Callable[[Motion], Array]] = {
        "tip_deflection": lambda motion: motion.tip_deflection,
        "modes": lambda motion: motion.modal("beam"),
        "joint": lambda motion: motion.joint_position("hub"),
        "tip_position": lambda motion: motion.tip_position,
    }
    want = values[quantity](exact)[first]
    steps = 5e-6 / 2.0 ** np.arange(3)
    motions = [driven(method(step), rotor, exact.times[first]) for step in steps]
    errors = [largest(values[quantity](motion) - want) for motion in motions]
    assert order_of(steps, np.array(errors)) == pytest.approx(method(1.0).order(rotor), abs=0.1)


@pytest.mark.parametrize("m", [2, 5, 10])
def test_modes_taken_as_uncoupled_move_as_with_all_their_couplings(
    rotor: CompiledSystem, exact: Motion, m: int
) -> None:
    # The beam's modes couple with each other through the spin by a part in 10⁶ of their mass; what is left out of that
    # within a cycle must be far below the error of the step itself.
    whole = CompiledSystem(rotor.mechanism)
    vars(whole)["couplings"] = rotor.couplings._replace(elastic=True, damped=True)
    assert rotor.frozen(m * STEP).single
    assert not whole.frozen(m * STEP).single
    short, full = (driven(Subcycling(STEP, m), some, exact.times).tip_deflection for some in (rotor, whole))
    assert largest(full - short) < 1e-3 * largest(short - exact.tip_deflection)


# Conservation ----------------------------------------------------------------------------------------------------


def spun(method: Integrator, rotor: CompiledSystem, spin: float, duration: float) -> Trajectory:
    """March with all modes excited, to 0.14 J in all: a tenth of the energy of the spin at 20 rad/s."""
    amplitudes = 0.5 * np.array([1.0, 0.3, 0.1, 0.03, 0.01])
    q0, v0 = np.r_[0.0, amplitudes / body_of(rotor).omega], np.r_[spin, np.zeros(rotor.n - 1)]
    return method.march(rotor, q0, v0, np.linspace(0.0, duration, 2001))


def energy(rotor: CompiledSystem, trajectory: Trajectory) -> Array:
    kinetic, strain = energies(rotor, trajectory)
    return kinetic + strain


def drift(values: Array) -> float:
    """Largest departure from the start, relative to it."""
    return largest(values / values[0] - 1)


@CONSERVING
@SPINS
def test_energy_and_angular_momentum_last_for_a_million_steps(
    coasting: CompiledSystem, method: Method, spin: float
) -> None:
    trajectory = spun(method(STEP), coasting, spin, 10.0)
    assert trajectory.end.step >= 1_000_000
    assert largest(trajectory.q[1000:, 1]) > 5e-4  # still vibrating
    assert drift(energy(coasting, trajectory)) < 1e-4
    assert drift(angular_momentum(coasting, trajectory)) < 1e-5


@CONSERVING
@SPINS
@pytest.mark.parametrize("conserved", [energy, angular_momentum])
def test_what_is_conserved_drifts_by_the_order_of_the_method_at_least(
    coasting: CompiledSystem, method: Method, order_of: Order, spin: float, conserved: Callable[..., Array]
) -> None:
    steps = 2e-5 / 2.0 ** np.arange(3)
    drifts = [drift(conserved(coasting, spun(method(step), coasting, spin, 2.0))) for step in steps]
    assert order_of(steps, np.array(drifts)) >= method(1.0).order(coasting) - 0.1


# The frame that sub-cycling can't do with ------------------------------------------------------------------------


def test_the_conforming_frame_has_no_coupling_and_the_free_frame_nearly_all(
    rotor: CompiledSystem, free_rotor: CompiledSystem
) -> None:
    # Free modes of a slender uniform beam of mass m have the value 2/√m at its ends. With n of them, frozen at one end,
    # H_k = −√m L and M_kl = δ_kl + 4, while J = mL²/3: coupling² = HᵀM⁻¹H/J = 3n/(1 + 4n).
    def coupling(some: CompiledSystem) -> float:
        M = some.linear_matrices[0]
        return float(np.linalg.norm(M[0, 1:]) / np.sqrt(M[0, 0]))

    assert coupling(rotor) < 1e-10
    assert coupling(free_rotor) == pytest.approx(np.sqrt(15 / 21), rel=0.01)


@pytest.mark.parametrize("m", [5, 10])
def test_in_the_free_frame_sub_cycling_is_weakly_unstable(
    rotor: CompiledSystem, free_rotor: CompiledSystem, m: int
) -> None:
    # At a twelfth of the plain limit, over 2 s: what grows is slow to do so, and has no other cause than the frame.
    step, times = 2 * STEP, np.linspace(0.0, 2.0, 401)
    assert step < 0.1 * min(
        Subcycling(step, m).largest_step(free_rotor), CentralDifference(step).largest_step(free_rotor)
    )
    plain, conforming = driven(CentralDifference(step), free_rotor, times), driven(Subcycling(step, m), rotor, times)
    usual = largest(plain.tip_deflection)
    assert largest(conforming.tip_deflection) == pytest.approx(usual, rel=0.1)
    try:
        worst = largest(driven(Subcycling(step, m), free_rotor, times).tip_deflection)
    except StabilityError:
        worst = np.inf
    assert worst > 10 * usual


def test_in_the_free_frame_growth_shows_within_the_scenes_half_second(
    rotor: CompiledSystem, free_rotor: CompiledSystem
) -> None:
    # After the pulse energy is conserved; in the conforming frame it is, at ten times the step as well.
    coast = np.linspace(0.11, 0.5, 391)
    growth = {}
    for name, some, method in (
        ("free, plain", free_rotor, CentralDifference(STEP)),
        ("free, 10:1", free_rotor, Subcycling(STEP, 10)),
        ("conforming, 10:1", rotor, Subcycling(STEP, 10)),
    ):
        kinetic, strain = driven(method, some, coast).energies
        growth[name] = largest((kinetic + strain) / (kinetic + strain)[0] - 1)
    assert growth["free, plain"] < 1e-5
    assert growth["conforming, 10:1"] < 1e-5
    assert growth["free, 10:1"] > 10 * growth["conforming, 10:1"]
