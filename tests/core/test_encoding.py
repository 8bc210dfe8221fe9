"""Values as bytes: they come back to the last bit and to the kind, and nothing else comes back at all."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from fmd.core.encoding import conforms, decode, encode
from fmd.fem.material import Material, MaterialOfElements
from fmd.reduction.factor.figures import FactorFigures
from fmd.reduction.modes import Modes
from fmd.scene.scene import load_scene

MODES = Modes(
    np.array([1.0, 1 / 3, np.pi]),
    np.asfortranarray(np.arange(36.0).reshape(4, 3, 3)),
    6,
    1e-9,
    (1, 2, 3),
    factor=FactorFigures("SuperLU", "METIS", 12, 40, 840),
)


@pytest.mark.parametrize(
    "value",
    [
        None, True, 7, 2**70, 0.1, float("inf"), "µ", b"\0\xff", 1 + 2j, range(1, 9, 2), slice(0, 3), Path("a/b"),
        (), [1, (2, [3])], {"a": 1, ("b", 2): {"c": None}}, {1, 2}, frozenset({"x"}), Material(7e10, 0.3, 2700.0),
    ],
)  # fmt: skip
def test_a_value_comes_back_with_its_kind(value: Any) -> None:
    found = decode(encode(value))
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6.0).reshape(2, 3)), np.array(3.5),
        np.array([np.nan, -0.0, 5e-324]), np.arange(4, dtype=np.int32), np.zeros((0, 3)), np.array(["ab", "c"]),
        np.array([True, False]), np.array([1 + 2j]),
    ],
)  # fmt: skip
def test_an_array_comes_back_to_the_last_bit_and_its_order_in_memory(array: Any) -> None:
    found = decode(encode(array))
    assert found.tobytes("A") == array.tobytes("A")
    assert (found.dtype, found.shape, found.flags.f_contiguous) == (array.dtype, array.shape, array.flags.f_contiguous)
    assert found.flags.writeable


def test_objects_come_back_with_all_fields_and_shared_ones_once() -> None:
    first, second = decode(encode([MODES, {"again": MODES}]))
    assert second["again"] is first
    assert first.shapes.tobytes("A") == MODES.shapes.tobytes("A")
    assert (first.numbers, first.factor, first.n_rigid) == (MODES.numbers, MODES.factor, MODES.n_rigid)


def test_tables_of_scenes_come_back() -> None:
    body = load_scene("beam").body["beam"]
    assert decode(encode(body)) == body


def test_sparse_matrices_come_back() -> None:
    A = sp.random_array((7, 5), density=0.4, rng=np.random.default_rng(0), format="csr")
    assert (decode(encode(A)) != A).nnz == 0


@pytest.mark.parametrize("value", [lambda: 0, object(), np.array([object()]), re.compile("a"), subprocess.Popen])
def test_what_is_no_data_is_not_kept(value: Any) -> None:
    with pytest.raises(TypeError, match="isn't kept"):
        encode({"value": value})


def tree(*items: Any) -> bytes:
    text = json.dumps([*items]).encode()
    return len(text).to_bytes(8, "little") + text


@pytest.mark.parametrize(
    "content",
    [
        b"", b"1", tree("object", "subprocess", "Popen", ["args", "true"]), tree("object", "os", "system"),
        tree("object", "fmd.core.files", "remove_abandoned", ["folder", "/"]),
        tree("enum", "fmd.core.units", "Any", "x"),
        tree("object", "fmd.core.cache", "Cache.save"), tree("object", "fmd.nowhere", "Material"), tree("unknown"),
        tree("object", "fmd.fem.material", "Material", ["E", 1.0], ["nu", 0.3]),
        tree("object", "fmd.fem.material", "Material", ["E", "x"], ["nu", 0.3], ["rho", 1.0]),
        tree("object", "fmd.fem.material", "Material", ["E", 1.0], ["nu", 0.3], ["rho", 1.0], ["new", 1.0]),
        tree("array", 0, 100), tree("array", -5, 3), tree("again", 3), tree("dict", [1]), tree("bytes", 0, 10**30),
        b"\xff" * 40, tree("csr", [2, 2], 1, 2, 3),
    ],
)  # fmt: skip
def test_wrong_content_is_an_error_of_its_value_and_runs_nothing(content: bytes) -> None:
    with pytest.raises(ValueError, match=r".+"):
        decode(content)


def test_any_damaged_byte_is_an_error_or_another_value_but_never_another_exception() -> None:
    whole, random = encode({"modes": MODES, "K": sp.eye_array(3, format="csr")}), np.random.default_rng(1)
    refused = 0
    for _ in range(1000):
        damaged = bytearray(whole)
        damaged[int(random.integers(len(whole)))] = int(random.integers(256))
        try:
            decode(bytes(damaged))
        except ValueError:
            refused += 1
    assert refused > 250  # of the rest, a number in an array is another one, which the digest beside it tells


@pytest.mark.parametrize(
    ("value", "kind", "fits"),
    [
        (MODES, "Modes", True), (MODES, "EigenPairs", True), (MODES, "FactorFigures | None", False),
        (None, "FactorFigures | None", True), (1, "float", True), (1.0, "int", False), ("a", "Array", False),
        (MODES.omega, "Array", True), ({"a": MODES}, "Mapping[str, Modes]", True),
        ({"a": 1}, "Mapping[str, Modes]", False),
        ((MODES, None), "tuple[Modes | None, ...]", True), ((MODES, "x"), "tuple[Modes | None, ...]", False),
        (Material(1.0, 0.3, 1.0), "AnyMaterial", True), ([1], "list[str]", False), (MODES, "MaterialOfElements", False),
    ],
)  # fmt: skip
def test_kinds_are_told_apart_by_their_annotations(value: Any, kind: str, fits: bool) -> None:
    assert MaterialOfElements  # loaded, so that its name is known
    assert conforms(value, kind) is fits
