"""``fmd export``: a body or the mechanism for another program."""

import json

import pytest

from pipeline.output.formats import _WRITERS
from pipeline.reduction.body_file import load_body
from pipeline.scene.outputs import EXPORT_FORMATS, MECHANISM_FORMATS, Export


def test_every_format_has_a_name_a_suffix_and_a_writer():
    assert set(_WRITERS) == set(EXPORT_FORMATS) >= set(MECHANISM_FORMATS)
    assert set(EXPORT_FORMATS) == set(Export.model_fields["format"].annotation.__args__[0].__args__)


def test_a_body_is_written_for_python(fmd, tmp_path, capsys):
    path = tmp_path / "new" / "arm.nc"
    assert fmd("export", "beam", "--to", "python", "--out", path, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"format": "python", "files": [str(path)]}
    assert len(load_body(path).body.omega) == 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("beam", "--to", "pyton"), "--to = 'pyton': no such format; there are"),
        (("beam", "--to", "python", "--body", "bim"), "no such flexible body; there are beam"),
        (("beam", "--to", "python", "--out", "x.msh"), "a file of format python ends in .nc"),
    ],
)
def test_wrong_options_get_one_message(fmd, options, message, capsys):
    assert fmd("export", *options) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
