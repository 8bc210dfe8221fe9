"""The cache: a value comes out as it went in, or not at all."""

import errno
import os
import pickle
import stat
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.core.cache import Cache, stage_key
from fmd.core.files import whole_file
from fmd.core.paths import _private

VALUE = {"numbers": np.arange(10.0), "names": ("a", "b"), "nothing": None}


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache")


@pytest.fixture
def entry(cache: Cache) -> Path:
    """The file of a value that has been saved under "key"."""
    cache.save("key", VALUE)
    assert cache.folder is not None
    return cache.folder / "key"


def assert_whole(found: Any) -> None:
    assert found.keys() == VALUE.keys()
    assert np.array_equal(found["numbers"], VALUE["numbers"])
    assert found["names"] == VALUE["names"]


def test_a_value_comes_back(cache: Cache, entry: Path) -> None:
    assert_whole(cache.load("key"))
    assert_whole(Cache(entry.parent).load("key"))


def test_an_unknown_key_gives_nothing(cache: Cache, entry: Path) -> None:
    assert entry.exists()
    assert cache.load("another") is None


def test_a_second_value_takes_the_place_of_the_first(cache: Cache, entry: Path) -> None:
    cache.save("key", "second")
    assert cache.load("key") == "second"
    assert [path.name for path in entry.parent.iterdir()] == ["key"]


@pytest.mark.parametrize("kept", [0, 1, 31, 32, 33, 0.5, -1])
def test_a_truncated_entry_gives_nothing(cache: Cache, entry: Path, kept: float) -> None:
    content = entry.read_bytes()
    entry.write_bytes(content[: int(kept * len(content)) if kept == 0.5 else int(kept)])
    assert cache.load("key") is None


def test_an_entry_with_one_bit_flipped_gives_nothing(cache: Cache, entry: Path) -> None:
    content = entry.read_bytes()
    for place in {0, 31, 32, len(content) // 2, len(content) - 1}:
        damaged = bytearray(content)
        damaged[place] ^= 1 << (place % 8)
        entry.write_bytes(damaged)
        assert cache.load("key") is None
    entry.write_bytes(content)
    assert_whole(cache.load("key"))


def test_an_entry_with_something_behind_it_gives_nothing(cache: Cache, entry: Path) -> None:
    entry.write_bytes(entry.read_bytes() + b"\0")
    assert cache.load("key") is None


def test_a_damaged_entry_is_replaced(cache: Cache, entry: Path) -> None:
    entry.write_bytes(b"")
    cache.save("key", VALUE)
    assert_whole(cache.load("key"))


def test_a_folder_in_the_place_of_an_entry_gives_nothing(cache: Cache, entry: Path) -> None:
    entry.unlink()
    entry.mkdir()
    cache.save("key", VALUE)
    assert cache.load("key") is None
    assert [path.name for path in entry.parent.iterdir()] == ["key"]


@pytest.mark.parametrize("step", ["replace", "fdopen"])
def test_a_disk_that_refuses_leaves_nothing_half_written(
    cache: Cache, entry: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    def refuse(*args: Any, **options: Any) -> None:
        if step == "fdopen":
            os.close(args[0])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, step, refuse)
    cache.save("key", "second")
    cache.save("third", "third")
    monkeypatch.undo()
    assert [path.name for path in entry.parent.iterdir()] == ["key"]
    assert_whole(cache.load("key"))
    assert cache.load("third") is None


def test_a_folder_that_cannot_be_made_is_left_alone(tmp_path: Path) -> None:
    # a file stands in its place: that stops the superuser too
    (tmp_path / "file").write_text("in the way")
    cache = Cache(tmp_path / "file" / "cache")
    cache.save("key", VALUE)
    assert cache.load("key") is None
    assert (tmp_path / "file").read_text() == "in the way"


def test_a_folder_that_cannot_be_written_is_left_alone(
    cache: Cache, entry: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # mkstemp stands for the system's refusal, which the superuser would never see
    def refuse(**_: Any) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(tempfile, "mkstemp", refuse)
    cache.save("other", VALUE)
    assert cache.load("other") is None
    assert_whole(cache.load("key"))
    assert [path.name for path in entry.parent.iterdir()] == ["key"]


def test_no_folder_keeps_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cache = Cache(None)
    cache.save("key", VALUE)
    assert cache.load("key") is None
    assert list(tmp_path.iterdir()) == []


def test_a_key_names_its_stage_and_comes_out_the_same_each_time() -> None:
    inputs = {"length": 0.34, "mesh": {"order": 2, "divisions": [48, 4, 2]}}
    again = {"mesh": {"divisions": [48, 4, 2], "order": 2}, "length": 0.34}  # the order of keys means nothing
    key = stage_key("mesh", inputs, ("fmd/meshes",), ("numpy",))
    assert key.startswith("mesh-")
    assert key == stage_key("mesh", again, ("fmd/meshes",), ("numpy",))


def test_keys_differ_with_everything_that_a_result_depends_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def key(
        stage: str = "mesh", length: float = 0.34, sources: tuple[str, ...] = ("fmd/meshes",), package: str = "numpy"
    ) -> str:
        return stage_key(stage, {"length": length, "divisions": [48, 4, 2]}, sources, (package,))

    keys = {key(), key(stage="body"), key(length=np.nextafter(0.34, 1)), key(sources=("fmd/fem",))}
    keys.add(key(package="scipy"))
    monkeypatch.setattr("fmd.core.cache.package_version", lambda package: f"another {package}")
    keys.add(key())
    assert len(keys) == 6


def test_what_killed_processes_left_half_written_is_deleted_in_time(tmp_path: Path) -> None:
    folder = tmp_path / "cache"  # listed once in a process
    folder.mkdir(mode=0o700)
    old, new = folder / ".part-old", folder / ".part-new"
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (0, 0))
    Cache(folder).save("another", VALUE)
    assert (old.exists(), new.exists()) == (False, True)
    abandoned, others = tmp_path / ".summary.12345.json", tmp_path / ".other.12345.json"
    for path in (abandoned, others):
        path.write_text("half")
        os.utime(path, (0, 0))
    with whole_file(tmp_path / "summary.json") as part:
        part.write_text("whole")
    assert (abandoned.exists(), others.exists()) == (False, True)


def test_an_entry_under_another_name_gives_nothing(cache: Cache, entry: Path) -> None:
    (entry.parent / "other").write_bytes(entry.read_bytes())
    assert cache.load("other") is None


def test_entries_are_for_this_user_alone(entry: Path) -> None:
    assert stat.S_IMODE(entry.stat().st_mode) == 0o600
    assert stat.S_IMODE(entry.parent.stat().st_mode) == 0o700


class Trap:
    """What a pickle would run while it is loaded."""

    def __reduce__(self) -> Any:
        return os.mkdir, ("trapped",)


@pytest.mark.parametrize("pickled", [VALUE, Trap()], ids=["a value", "a trap"])
def test_a_pickle_in_the_place_of_an_entry_is_never_run(
    cache: Cache, entry: Path, pickled: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    cache.save_bytes("key", pickle.dumps(pickled))
    assert cache.load("key") is None
    assert not (tmp_path / "trapped").exists()
    assert entry.exists()


@pytest.mark.parametrize(
    ("kind", "fits"),
    [
        ("dict[str, Any]", True),
        ("Mapping", True),
        ("Array | dict", True),
        ("Array", False),
        ("tuple", False),
        ("Mapping[str, Array]", False),
    ],
)
def test_a_value_of_another_kind_than_expected_gives_nothing(cache: Cache, entry: Path, kind: str, fits: bool) -> None:
    assert entry.exists()
    assert (cache.load("key", kind) is not None) is fits


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
def test_a_folder_that_others_may_write_to_is_not_used_and_said(
    tmp_path: Path, mode: int, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "shared"
    folder.mkdir()
    Cache(folder).save("key", VALUE)
    folder.chmod(mode)
    _private.clear()  # as a new run
    cache = Cache(folder)
    assert cache.load("key") is None
    cache.save("other", VALUE)
    assert [path.name for path in folder.iterdir()] == ["key"]
    said = capsys.readouterr().err
    assert said.count(f"cache folder {folder} may be written by others and isn't used") == 1


def test_a_folder_of_another_user_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: own + 1)
    Cache(tmp_path).save("key", VALUE)
    assert list(tmp_path.iterdir()) == []
    assert "belongs to another user" in capsys.readouterr().err
