"""Folders of the cache and of kernels, and digests of the source that follow every change of it."""

import os
import re
import tempfile
from pathlib import Path

import pytest

from fmd.core import paths as folders
from fmd.core.paths import KERNEL_SOURCES, cache_folder, kernel_folder, source_digest


def test_a_change_in_the_source_changes_its_digest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "_ROOT", tmp_path)
    monkeypatch.setattr(folders, "_digest_source", folders._digest_source.__wrapped__)  # read anew, as by another run
    digest = source_digest.__wrapped__
    part = tmp_path / "part"
    (part / "__pycache__").mkdir(parents=True)
    (part / "one.py").write_text("x = 1\n")
    (tmp_path / "two.py").write_text("y = 1\n")
    before = digest("part", "two.py")
    (part / "__pycache__" / "one.py").write_text("not a source\n")
    (part / "notes.txt").write_text("not a source\n")
    assert digest("part", "two.py") == before
    (part / "one.py").write_text("x = 2\n")
    changed = digest("part", "two.py")
    (tmp_path / "two.py").write_text("y = 2\n")
    assert len({before, changed, digest("part", "two.py"), digest("part")}) == 4


def test_the_environment_says_where_the_cache_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FMD_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    for empty in ("", None):  # an empty variable means none
        monkeypatch.delenv("FMD_CACHE") if empty is None else monkeypatch.setenv("FMD_CACHE", empty)
        assert cache_folder().name == "fmd"
        assert cache_folder().is_absolute()


def test_kernels_are_kept_in_the_cache_by_their_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FMD_CACHE", str(tmp_path))
    digest = source_digest(*KERNEL_SOURCES)
    assert kernel_folder() == tmp_path / "kernels" / digest
    assert kernel_folder().is_dir()


def test_kernels_go_elsewhere_if_the_cache_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("FMD_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    folders.own_temporary_folder.cache_clear()
    folder = kernel_folder()
    folders.own_temporary_folder.cache_clear()
    assert folder.is_dir()
    assert folder.parent.parent == tmp_path / "temporary" / f"fmd-{os.getuid()}"  # where the next run finds it


@pytest.mark.parametrize("state", ["new", "own", "another's", "open to all", "a file"])
def test_a_user_without_a_home_has_a_folder_that_nobody_else_can_write_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: str
) -> None:
    def homeless(_: str) -> Path:
        raise RuntimeError("could not determine the home directory")

    user = os.getuid()
    monkeypatch.setattr(folders.platformdirs, "user_cache_path", homeless)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv("FMD_CACHE")
    folder = tmp_path / f"fmd-{user}"
    if state == "a file":
        folder.write_text("in the way")
    elif state != "new":
        folder.mkdir(mode=0o700)
    if state == "open to all":
        folder.chmod(0o777)
    if state == "another's":
        monkeypatch.setattr(os, "getuid", lambda: user + 1)
        folder.rename(tmp_path / f"fmd-{user + 1}")
    folders.own_temporary_folder.cache_clear()
    found = cache_folder()
    folders.own_temporary_folder.cache_clear()
    assert (found == folder) == (state in ("new", "own"))
    assert found.parent == tmp_path
    assert found.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("name", ["fmd/no_such_folder", "fmd/core/no_such_file.py"])
def test_a_source_that_does_not_exist_is_refused(name: str) -> None:
    with pytest.raises(FileNotFoundError, match=f"{name}: no such source in .*; a stage's key names it"):
        source_digest("fmd/core", name)


def test_a_digest_of_a_file_is_that_of_its_content_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "_ROOT", tmp_path)
    for name in ("one.py", "two.py"):
        (tmp_path / name).write_text("x = 1\n")
    digest = source_digest.__wrapped__
    assert digest("one.py") == digest("two.py") != digest("one.py", "two.py")


def test_a_digest_changes_with_the_numbers_that_its_source_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "_ROOT", tmp_path)
    monkeypatch.setattr(folders, "_digest_source", folders._digest_source.__wrapped__)  # read anew, as by another run
    limits = tmp_path / "fmd" / "core" / "limits"
    limits.mkdir(parents=True)
    (tmp_path / "one.py").write_text("from fmd.core.limits import first as limits\n")
    (tmp_path / "two.py").write_text("from fmd.core.limits.second import (\n    MOST,\n)\n")
    digest, found = source_digest.__wrapped__, []
    for of_first, of_second in ((1, 1), (2, 1), (2, 2)):
        (limits / "first.py").write_text(f"MOST = {of_first}\n")
        (limits / "second.py").write_text(f"MOST = {of_second}\n")
        found.append((digest("one.py"), digest("two.py")))
    assert [at == found[0][0] for at, _ in found] == [True, False, False]
    assert [at == found[0][1] for _, at in found] == [True, True, False]


def test_sources_that_were_not_touched_are_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One whose time and size are as before, but that was written since, is."""
    monkeypatch.setattr(folders, "_ROOT", tmp_path)
    monkeypatch.setenv("FMD_CACHE", str(tmp_path / "cache"))
    source = tmp_path / "one.py"
    source.write_text("x = 1\n")

    def digest() -> tuple[str, bool]:
        """Digest as another run does; true if the file was read."""
        was_read = []
        monkeypatch.setattr("builtins.open", lambda *given: was_read.append(given[0] == str(source)) or opened(*given))
        folders._digest_source.cache_clear()
        folders._known_sources.cache_clear()
        found = source_digest.__wrapped__("one.py")
        monkeypatch.setattr("builtins.open", opened)
        return found, any(was_read)

    opened = open
    (first, _), (_, young_read) = digest(), digest()
    assert young_read  # what was written just now may be written again within the clock's tick
    monkeypatch.setattr(folders, "SETTLED_NS", 0)
    assert digest() == (first, True)
    assert digest() == (first, False)
    times = source.stat()
    source.write_text("x = 2\n")
    os.utime(source, ns=(times.st_atime_ns, times.st_mtime_ns))
    changed, was_read = digest()
    assert was_read
    assert changed != first
    for damaged in ("{", "[]"):
        (tmp_path / "cache" / "sources.json").write_text(damaged)
        assert digest() == (changed, True)
    folders._digest_source.cache_clear()
    folders._known_sources.cache_clear()


def test_kernels_have_a_new_folder_where_no_other_can_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(folders, "cache_folder", lambda: tmp_path / "file")
    monkeypatch.setattr(folders, "own_temporary_folder", lambda: tmp_path / "file")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    folder = kernel_folder()
    assert folder.is_dir()
    assert folder.parent == tmp_path / "temporary"


def test_all_that_kernels_are_compiled_from_is_in_the_name_of_their_folder() -> None:
    package = Path(folders.__file__).parents[1]
    marked = [
        file
        for file in package.rglob("*.py")
        if re.search(r"^@(kernel|inner|inlined|contracted|unrolled)\b", file.read_text(), re.M)
    ]
    assert len(marked) > 20
    for file in marked:
        assert any(file.is_relative_to(package.parent / source) for source in KERNEL_SOURCES), file
