"""Tables in CSV files: what is read, in which units, and one clear message for each fault."""

from pathlib import Path

import pytest

from fmd.core.errors import InputError
from fmd.scene.scene import Scene, load_scene
from fmd.scene.source_files import collect_inputs
from tests.scene.scenes import refused

ROD = """
title = "Rod"
body.rod = { shape = "rod", mass = "2 kg", length = "1 m", marker = { a = { at = ["0 m", "0 m", "0 m"] } } }
joint.hinge = { type = "revolute", parent = "ground", child = "rod.a", axis = [0, 0, 1] }
"""
SIMULATION = """
[simulation]
duration = "1 s"
output_step = "0.1 s"
tip = "rod.a"
run = [{ integrator = "auto" }]
"""
TABLE = '{ file = "motion.csv", time = "t", column = "q1", unit = "deg" }'
GOOD = "t,q1,q2\n0,10,1\n0.5,20,2\n1,30.5,3\n"


def load(folder: Path, content: str | bytes, table: str = TABLE) -> Scene:
    path = folder / "motion.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    drive = f'drive.swing = {{ type = "motion", joint = "hinge", angle = {table} }}\n'
    (folder / "mine.toml").write_text(ROD + drive + SIMULATION)
    return load_scene(folder / "mine.toml")


@pytest.mark.parametrize(
    ("content", "table"),
    [
        (GOOD, TABLE),
        ("\ufefft;q1\n0;10\n0,5;20\n1;30,5\n", TABLE),
        ("# from a logger\nt\tq1\n\n0\t10\n0.5\t20\n1\t3.05e1\n", TABLE),
        ("0 10\n0.5 20\n1 30.5\n", TABLE.replace('"t"', "1").replace('"q1"', "2")),
        ('t, "q1"\n0, 10\n0.5, 20\n1, 30.5', TABLE.replace('"q1"', "2")),
        (
            "time [ms],q1\n0,10\n500,20\n1000,30.5\n",
            TABLE.replace('time = "t"', 'time = "time [ms]", time_unit = "ms"'),
        ),
    ],
)
def test_columns_are_read_with_any_divider_header_and_unit(tmp_path: Path, content: str, table: str):
    angle = load(tmp_path, content, table).drive["swing"].angle
    assert angle.times == (0.0, 0.5, 1.0)
    assert angle.values == (10.0, 20.0, 30.5)
    assert angle.factor == pytest.approx(0.017453292519943295)  # π/180
    assert angle.smooth  # as a motion's table in the scene


def test_a_table_in_a_file_is_as_one_in_the_scene_and_lies_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    here = '{ times = ["0 s", "0.5 s", "1 s"], values = [10.0, 20.0, 30.5], unit = "deg" }'
    from_file, own = load(tmp_path, GOOD).drive["swing"].angle, load(tmp_path, GOOD, here).drive["swing"].angle
    assert (from_file.times, from_file.values) == (own.times, own.values)
    load(tmp_path, GOOD)
    monkeypatch.chdir(tmp_path)
    assert load_scene("mine.toml").drive["swing"].angle.times == (0.0, 0.5, 1.0)


def test_results_are_kept_by_the_contents_of_a_table(tmp_path: Path):
    before = collect_inputs(load(tmp_path, GOOD))
    assert collect_inputs(load(tmp_path, GOOD)) == before
    assert collect_inputs(load(tmp_path, GOOD.replace("30.5", "30.6"))) != before


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("t,q1\n0,10\n0.5,x2\n1,3\n", "drive.swing.angle.file = 'motion.csv': row 3, column 'q1': 'x2' is no number"),
        ("t,q1\n0,10\n# note\n0.5\n1,3\n", "row 4, column 'q1': the cell is empty"),
        ("t,q1\n0,10\n0.5,nan\n1,3\n", "row 3, column 'q1': 'nan' is no number"),
        ("t,q1\n0,10\n0.5,20\n0.5,3\n", "row 4, column 't': must be above 0.5, the time in the row before"),
        ("t,q2\n0,10\n1,3\n", "angle.column = 'q1': no such column; the columns of the first row: t, q2"),
        ("s,q1\n0,10\n1,3\n", "angle.time = 't': no such column"),
        ("t,q1,q1\n0,1,2\n1,3,4\n", "column = 'q1': is the name of several columns; give a number: 2, 3"),
        ("t,q1\n0,10\n", "motion.csv': has 1 rows of numbers; a table needs 2 at least"),
        ("t,q1\n-1,10\n1,1\n", "motion.csv': begins at -1 s; times count from the start, 0"),
        ("", "is empty"),
        (b"t,q1\n\xff,1\n", "isn't text in UTF-8"),
        ("t,q1\n" + "".join(f"{k},0\n" for k in range(100_001)), "has 100001 rows; 100000 are the most"),
    ],
)
def test_faults_of_a_file_are_told_by_row_and_column(tmp_path: Path, content: str | bytes, message: str):
    with refused(message):
        load(tmp_path, content)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('{ file = "other.csv", time = "t", column = "q1", unit = "deg" }', "can't be read: No such file"),
        ('{ file = "motion.csv", time = "t", unit = "deg" }', "angle.column: is missing: the column's name in"),
        ('{ file = "motion.csv", column = "t", unit = "deg" }', "angle.time: is missing: the column's name in"),
        ('{ file = "motion.csv", time = "t", column = 9, unit = "deg" }', "column = 9: is beyond the last column: the"),
        (
            '{ file = "motion.csv", time = "t", column = 0, unit = "deg" }',
            "column = 0: must be the column's name in the",
        ),
        ('{ file = "motion.csv", time = "t", column = "q1" }', "angle.unit: is missing"),
        ('{ file = "motion.csv", time = "t", column = "q1", unit = "mm" }', "isn't a unit of angle; 'rad' works"),
        ('{ file = "motion.csv", time = "t", column = "q1", unit = "deg", values = [1.0] }', "can't stand beside file"),
        ('{ formula = "t", column = "q1", unit = "deg" }', "belongs to a table in a file: give file, too"),
        ('{ file = "motion.csv", time = "t", column = "q1", unit = "deg", time_unit = "mm" }', "time_unit = 'mm'"),
    ],
)
def test_faults_of_the_keys_name_the_key(tmp_path: Path, table: str, message: str):
    with refused(message):
        load(tmp_path, GOOD, table)


def test_a_spring_takes_its_force_from_a_file(tmp_path: Path):
    (tmp_path / "bump.csv").write_text("x;F\n-30;-9\n-10;-1,2\n0;0\n40;4,1\n")
    ground = 'ground.wall = { at = ["2 m", "0 m", "0 m"] }\n'
    spring = (
        'spring.bump = { between = ["ground.wall", "rod.a"], force = { file = "bump.csv", elongation = "x", '
        'column = "F", elongation_unit = "mm", unit = "kN", between = "smooth" } }\n'
    )
    (tmp_path / "mine.toml").write_text(ROD + ground + spring + SIMULATION)
    force = load_scene(tmp_path / "mine.toml").spring["bump"].force
    assert force.elongations == pytest.approx((-0.03, -0.01, 0.0, 0.04))
    assert force.values == (-9.0, -1.2, 0.0, 4.1)
    (tmp_path / "bump.csv").write_text("x;F\n" + "".join(f"{k};0\n" for k in range(201)))
    with pytest.raises(InputError, match=r"spring.bump.force.file = 'bump.csv': has 201 rows; 200 are the most"):
        load_scene(tmp_path / "mine.toml")
