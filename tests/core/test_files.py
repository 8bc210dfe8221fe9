"""Files that are written whole, and work that one process does at a time, also where processes die or locks fail."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fmd.core.errors import InputError
from fmd.core.files import one_at_a_time, sparing, whole_file

# Adds one to a number in a file, many times, each in two steps that another process must not come between.
COUNTS = """
import sys, time
from pathlib import Path
from fmd.core.files import one_at_a_time
lock, number = Path(sys.argv[1]), Path(sys.argv[2])
for _ in range(20):
    with one_at_a_time(lock):
        value = int(number.read_text())
        time.sleep(0.001)
        number.write_text(str(value + 1))
"""
# Says that it is in, and stays there until it is killed.
STAYS = """
import sys, time
from pathlib import Path
from fmd.core.files import one_at_a_time
with one_at_a_time(Path(sys.argv[1])):
    print("in", flush=True)
    time.sleep(60)
"""


def start(program: str, *arguments: Path) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", program, *map(str, arguments)], stdout=subprocess.PIPE, text=True)


def test_processes_come_one_at_a_time(tmp_path: Path) -> None:
    lock, number = tmp_path / "folder" / "lock", tmp_path / "number"
    number.write_text("0")
    processes = [start(COUNTS, lock, number) for _ in range(3)]
    for process in processes:
        process.communicate(timeout=60)
        assert process.returncode == 0
    assert number.read_text() == "60"
    assert not lock.exists()


def test_a_process_that_is_killed_lets_the_next_one_in(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    process = start(STAYS, lock)
    assert process.stdout is not None
    assert process.stdout.readline() == "in\n"
    assert lock.exists()
    process.send_signal(signal.SIGKILL)
    process.communicate()
    begin = time.monotonic()
    with one_at_a_time(lock):
        assert lock.exists()
    assert time.monotonic() - begin < 10.0
    assert not lock.exists()


def test_a_failure_inside_ends_the_lock_and_goes_on(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    with pytest.raises(ValueError, match="inside"), one_at_a_time(lock):
        raise ValueError("inside")
    assert not lock.exists()
    with one_at_a_time(lock):
        pass


def test_all_go_through_where_the_folder_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    lock = tmp_path / "file" / "lock"
    with one_at_a_time(lock), one_at_a_time(lock):
        pass
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.parametrize("code", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP])
def test_all_go_through_where_there_are_no_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int) -> None:
    fcntl = pytest.importorskip("fcntl")

    def refuse(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", refuse)
    lock, entered = tmp_path / "lock", 0
    with one_at_a_time(lock), one_at_a_time(lock):
        entered += 1
    assert entered == 1


def test_a_file_appears_whole(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("old")
    with whole_file(path) as part:
        part.write_text("new")
        assert (part.parent, part.suffix) == (tmp_path, ".csv")  # renamed on one disk; writers look at the suffix
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_writer_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("old")

    def write() -> None:
        with whole_file(path) as part:
            part.write_text("ha")
            raise RuntimeError("half-way")

    with pytest.raises(RuntimeError, match="half-way"):
        write()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_spared_files_are_not_written_over(tmp_path: Path):
    (tmp_path / "input.csv").write_text("kept")
    with sparing([tmp_path / "input.csv", tmp_path / "missing"]):
        with whole_file(tmp_path / "other.csv") as part:
            part.write_text("new")
        with pytest.raises(InputError, match=r"input\.csv: is a file that the scene is read from"):  # noqa: SIM117
            with whole_file(tmp_path / "input.csv"):
                pass
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"input.csv": "kept", "other.csv": "new"}
    with whole_file(tmp_path / "input.csv") as part:
        part.write_text("new")
    assert (tmp_path / "input.csv").read_text() == "new"
