"""Points of a sweep: values from the command line, refused values, and keys of results."""

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.sweep.points import Variation, make_points, parse_variations, sample_variations


def test_a_comma_within_brackets_or_quotes_belongs_to_its_value():
    parsed = parse_variations(["a.b=[1, 2],[3,4]", "c.0.d = 'x,y' , {u=1,v=[2,3]}", 'simulation.step="1 us","2 us"'])
    assert parsed[0] == Variation("a.b", ("[1, 2]", "[3,4]"))
    assert parsed[1] == Variation("c.0.d", ("'x,y'", "{u=1,v=[2,3]}"))


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        ([], "is missing"),
        (["simulation.step"], "must look like"),
        (["simulation.step=1us,"], "must look like"),
        (["=1"], "must look like"),
        (["a=1,2,1"], "has a value twice"),
        (["a=1", "a=2"], "is varied twice"),
    ],
)
def test_a_wrong_list_of_values_is_refused(texts, said):
    with pytest.raises(InputError, match=said):
        parse_variations(texts)


def test_a_sweep_that_is_wrong_everywhere_is_refused_as_a_whole():
    with pytest.raises(InputError, match=r"--vary: body\.bem.*did you mean 'beam'"):
        make_points("beam", parse_variations(["body.bem.nu=0.3,0.34"]))
    numbers = ",".join(map(str, range(100)))
    with pytest.raises(InputError, match="makes 1000000 points"):
        make_points("beam", parse_variations([f"a={numbers}", f"b={numbers}", f"c={numbers}"]))


def test_a_points_key_is_that_of_its_scene_however_it_is_written():
    one, same, other = (
        point.key for point in make_points("beam", parse_variations(["simulation.step=1us,1e-3 ms,2us"]))
    )
    assert one == same != other


def test_a_points_key_is_that_of_its_mesh_file_too(tmp_path):
    scene = tmp_path / "part.toml"
    scene.write_text(
        """title = "part"
        [body.part]
        shape = "mesh"
        mesh = { file = "part.vtu", unit = "mm" }
        E = "70 GPa"
        nu = 0.3
        rho = "2700 kg/m^3"
        modes = { count = 2 }
        marker = {}
        """
    )
    keys = []
    for content in ("one", "another"):
        (tmp_path / "part.vtu").write_text(content)
        keys.append(make_points(scene, parse_variations(["body.part.nu=0.3"]))[0].key)
    assert keys[0] != keys[1]
    (tmp_path / "part.vtu").unlink()
    with pytest.raises(InputError, match=r"body\.part\.mesh\.file"):
        make_points(scene, parse_variations(["body.part.nu=0.3"]))


def test_a_range_gives_its_values_evenly_or_with_equal_ratios():
    (even, ratios, mixed) = parse_variations(["a=100..400:4 N/m", "b=1e-3..10:5 N m/rad log", "c=-1..1:3,5"])
    assert even.values == ("100 N/m", "200 N/m", "300 N/m", "400 N/m")
    assert ratios.values == ("0.001 N m/rad", "0.01 N m/rad", "0.1 N m/rad", "1 N m/rad", "10 N m/rad")
    assert mixed.values == ("-1", "0", "1", "5")
    assert parse_variations(["a=1..100:3 log"])[0].values == ("1", "10", "100")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a=4..1:3", "lower to a higher"),
        ("a=1..4:1", "2 to"),
        ("a=0..4:3 log", "above 0"),
        ("a=1..4 N", "number of values"),
    ],
)
def test_a_range_that_is_none_is_refused(text, said):
    with pytest.raises(InputError, match=said):
        parse_variations([text])


def test_a_latin_hypercube_has_a_point_in_each_part_of_every_range():
    texts = ["a=0..10 mm", "b=1..1e10 log"]
    a, b = (v.values for v in sample_variations(texts, "latin-hypercube", 10, 3))
    assert sorted(int(float(value.split()[0])) for value in a) == list(range(10))
    assert sorted(int(np.log10(float(value))) for value in b) == list(range(10))
    assert sample_variations(texts, "random", 10, 3) == sample_variations(texts, "random", 10, 3)
    assert sample_variations(texts, "random", 10, 3) != sample_variations(texts, "random", 10, 4)
    for wrong in (["a=1,2"], ["a=1..2:3"], ["a=1..2", "a=2..3"]):
        with pytest.raises(InputError, match=r"only range of its key|leave out :3"):
            sample_variations(wrong, "random", 10, 3)
    with pytest.raises(InputError, match="--points"):
        sample_variations(texts, "random", 1, 3)
