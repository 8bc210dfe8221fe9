"""A rod with a slider that nothing drives: one slow angle, one fast place on a spring."""

import pytest

from fmd import Pipeline, load_scene
from fmd.dynamics.compiled_system.system import CompiledSystem


@pytest.fixture(scope="session")
def coasting() -> CompiledSystem:
    return Pipeline(load_scene("rod-slider", ["drive.motor.torque=0 N m"])).system
