"""The study of elements and meshes: extrapolated frequencies, files."""

import csv
from pathlib import Path

import numpy as np
import pytest

from benchmarks.modes import STUDIES, ConvergedFrequencies, ModeStudyRow, extrapolate, write_study
from fmd import Pipeline, load_scene

pytestmark = pytest.mark.slow

ROWS = [
    ModeStudyRow("beam", "hex20", "coarse", 900, 0.1, 2e-3),
    ModeStudyRow("beam", "hex20", "fine", 9000, 0.9, 1e-5),
    ModeStudyRow("beam", "tet10", "fine", 9000, 0.5, 5e-4),
]


def test_a_study_of_modes_is_written_with_its_reference_and_a_chart(tmp_path: Path) -> None:
    write_study(ROWS, {"beam": ConvergedFrequencies(np.array([131.0]), 1e-6, 60123)}, tmp_path)
    assert (tmp_path / "modes-beam.png").stat().st_size > 10_000
    _, reference, *table = (tmp_path / "modes.csv").read_text().splitlines()
    assert reference == "# beam: 131.0000 Hz, the limit by up to 60123 unknowns, good to 1e-06"
    assert [float(row["error"]) for row in csv.DictReader(table)] == [2e-3, 1e-5, 5e-4]


def test_frequencies_are_extrapolated_by_the_order_that_they_show() -> None:
    h = np.array([1.0, 2 / 3, 0.5])[:, None]
    limits, orders = np.array([131.0, 349.3, 655.2]), np.array([2.0, 2.9, 4.0])
    assert extrapolate(limits + 0.7 * h**orders) == pytest.approx(limits, rel=1e-12)


@pytest.mark.parametrize(
    ("scene", "meshes", "error"),
    [
        ("beam", ("16 × 2 × 1", "20 mm"), 2e-3),
        pytest.param("propeller", ("4 × 2 × 1 × 1 × 4 × 9", "4 × 2 × 1 × 2 × 4 × 9"), 2e-2, marks=pytest.mark.long),
    ],
)
def test_hexahedra_and_tetrahedra_show_the_same_modes(scene: str, meshes: tuple[str, str], error: float) -> None:
    """A mode along z among the beam's, or a pair that is missed, would be off by a tenth."""
    study = next(study for study in STUDIES if study.scene == scene)
    meshes_of = {(element, mesh): overrides for element, mesh, overrides in study.meshes}
    runs = [meshes_of[kind] for kind in zip(("hex20", "tet10"), meshes, strict=True)]
    hexahedra, tetrahedra = (study.frequencies(Pipeline(load_scene(scene, mesh))) for mesh in runs)
    assert len(hexahedra) == {"beam": 5, "propeller": 6}[scene]
    assert tetrahedra == pytest.approx(hexahedra, rel=error)
