"""Systems of equal mechanisms in one process: what has been found of one serves the others."""

from collections.abc import Hashable
from dataclasses import replace
from importlib import import_module

from fmd.core.limits.memory import MOST_SHARED
from fmd.core.recently_used import RecentlyUsed
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.digest import names_of
from fmd.dynamics.mechanism import Mechanism

# A key is all that a mechanism consists of, so what it names never changes.
_shared: RecentlyUsed[CompiledSystem] = RecentlyUsed(MOST_SHARED)
_structures: RecentlyUsed[CompiledSystem] = RecentlyUsed(MOST_SHARED)


def share_system(mechanism: Mechanism) -> CompiledSystem:
    """Return the system of a mechanism, which it shares with an equal one that was among the last to be marched.

    A system's addresses, couplings and frequencies follow from its mechanism alone, and each march has storage of its
    own, so sharing changes no number.
    """
    system = make_system(mechanism)
    structure = structure_of(system)

    def like_another() -> CompiledSystem:
        system.share_structure(_structures.get(structure, lambda: system))
        return system

    return _shared.get((structure, *system.compiled.numbers.tolist()), like_another)


def lift_system(system: CompiledSystem) -> CompiledSystem:
    """Return the system of a mechanism that is lifted: inertia of rigid bodies, damping of modes and gravity vary."""
    return system if system.mechanism.lifted else share_system(replace(system.mechanism, lifted=True))


def structure_of(system: CompiledSystem) -> Hashable:
    """Return what systems have in common that differ in numbers alone: springs, rests and dampers of joints."""
    compiled, mechanism = system.compiled, system.mechanism
    return compiled.digest, compiled.signals, names_of(mechanism), mechanism.horizon


def make_system(mechanism: Mechanism) -> CompiledSystem:
    """Make the system of a mechanism; that of one with contacts is of a module that only these load."""
    if not mechanism.contacts:
        return CompiledSystem(mechanism)
    touching: type[CompiledSystem] = import_module("fmd.dynamics.compiled_system.touching").TouchingSystem
    return touching(mechanism)
