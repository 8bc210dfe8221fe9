"""Mutated scenes: whatever is done to a scene's text, reading it ends in a scene or in one message that names a fault.

A mutation is of one of two kinds: it makes a scene wrong for certain (a misspelt key, a unit of another dimension, a
name that nothing has), which must be refused, or it may leave a scene that can be computed.
"""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import fmd.models
from fmd import load_scene
from fmd.core.errors import InputError

SCENES = sorted(Path(fmd.models.__file__).parent.glob("*.toml"))
MUTANTS = (200, pytest.param(1000, marks=[pytest.mark.slow, pytest.mark.long]))
SECONDS = 10.0  # to read one scene, on a busy machine
MOST_LINES = 12  # of a message: three faults that are lines of different tables, with those of like bodies

Lines = list[str]
Mutation = Callable[[Lines, np.random.Generator], Lines | None]
"""Return changed lines, or ``None`` where a scene has nothing to change so."""

NUMBER = re.compile(r'(?<=")-?\d[\d.e+-]*(?= [^"]+")')
UNIT = re.compile(r'(?<=["\s]\d )[A-Za-z][^"\]]*(?=")|(?<=\d\d )[A-Za-z][^"\]]*(?=")')
KEY = re.compile(r"^([a-z_]+) = ")
HEAD = re.compile(r"^\[([a-z]+)\.([A-Za-z0-9_-]+)\]$")


def _pick(lines: Lines, pattern: re.Pattern[str], rng: np.random.Generator) -> tuple[int, re.Match[str]] | None:
    """Return one of the lines that match, and its match."""
    keys = [(k, line.partition("#")[0]) for k, line in enumerate(lines) if not line.startswith(("title", "source"))]
    found = [(k, m) for k, line in keys if (m := pattern.search(line))]
    return found[int(rng.integers(len(found)))] if found else None


def _replace(pattern: re.Pattern[str], values: tuple[str, ...]) -> Mutation:
    """Return a mutation that puts one of some texts where a pattern matches."""

    def mutate(lines: Lines, rng: np.random.Generator) -> Lines | None:
        at = _pick(lines, pattern, rng)
        if at is None:
            return None
        k, m = at
        new = values[int(rng.integers(len(values)))]
        return [*lines[:k], lines[k][: m.start()] + new + lines[k][m.end() :], *lines[k + 1 :]]

    return mutate


def _misspell(lines: Lines, rng: np.random.Generator) -> Lines | None:
    """Swap, double or drop a letter of a key."""
    at = _pick(lines, KEY, rng)
    if at is None:
        return None
    k, m = at
    key, place = m[1], int(rng.integers(len(m[1])))
    wrong = [key[:place] + key[place] + key[place:], key[:place] + key[place + 1 :], key + "x"][int(rng.integers(3))]
    return [*lines[:k], f"{wrong or 'x'} = {lines[k][m.end() :]}", *lines[k + 1 :]]


def _drop_line(lines: Lines, rng: np.random.Generator) -> Lines | None:
    k = int(rng.integers(len(lines)))
    return lines[:k] + lines[k + 1 :]


def _double_line(lines: Lines, rng: np.random.Generator) -> Lines | None:
    """A key or a table that is there twice is no TOML."""
    keys = [k for k, line in enumerate(lines) if KEY.match(line)]
    k = keys[int(rng.integers(len(keys)))] if keys else 0
    return lines[: k + 1] + lines[k:]


def _swap_lines(lines: Lines, rng: np.random.Generator) -> Lines | None:
    a, b = rng.integers(len(lines), size=2)
    changed = list(lines)
    changed[a], changed[b] = changed[b], changed[a]
    return changed


def _cut_off(lines: Lines, rng: np.random.Generator) -> Lines | None:
    text = "\n".join(lines)
    return text[: int(rng.integers(len(text)))].split("\n")


def _flip_characters(lines: Lines, rng: np.random.Generator) -> Lines | None:
    text = list("\n".join(lines))
    for k in rng.integers(len(text), size=3):
        text[k] = chr(int(rng.choice([0, 34, 35, 46, 61, 91, 93, 123, 0x7F, 0xE9, 0x2028, 0x1F600])))
    return "".join(text).split("\n")


def _drop_table(lines: Lines, rng: np.random.Generator) -> Lines | None:
    heads = [k for k, line in enumerate(lines) if line.startswith("[")]
    if not heads:
        return None
    k = heads[int(rng.integers(len(heads)))]
    end = next((j for j in heads if j > k), len(lines))
    return lines[:k] + lines[end:]


def _rename(lines: Lines, rng: np.random.Generator) -> Lines | None:
    """Rename a body, a joint or a place, and leave the old name where it is used."""
    at = _pick(lines, HEAD, rng)
    if at is None:
        return None
    k, m = at
    return [*lines[:k], f"[{m[1]}.{m[2]}-2]", *lines[k + 1 :]]


@dataclass(frozen=True)
class Kind:
    """A kind of mutation, and whether a scene with it must be refused."""

    mutate: Mutation
    wrong: bool


NUMBERS = ("0", "-1", "1e308", "1e-300", "-1e30", "5e-324", "1e18", "0.5")
VALUES = ("{}", "[]", "[[]]", "true", "-7", "1e400", '""', '"x"', "[1, 2]", '["1 m", 2]', "1979-05-27", "{ a = 1 }")
KINDS = {
    "key": Kind(_misspell, wrong=True),
    "double": Kind(_double_line, wrong=True),
    "dimension": Kind(_replace(UNIT, ("K", "cd", "mol/s", "Ohm", "", "m/0", "é")), wrong=True),
    "no number": Kind(_replace(NUMBER, ("nan", "inf", "-inf", "1,5", "one", "0x10", "1e999")), wrong=True),
    "number": Kind(_replace(NUMBER, NUMBERS), wrong=False),
    "value": Kind(_replace(re.compile(r"(?<= = ).+$"), VALUES), wrong=False),
    "line": Kind(_drop_line, wrong=False),
    "swap": Kind(_swap_lines, wrong=False),
    "cut": Kind(_cut_off, wrong=False),
    "characters": Kind(_flip_characters, wrong=False),
    "table": Kind(_drop_table, wrong=False),
    "rename": Kind(_rename, wrong=False),
}


def mutant(seed: int) -> tuple[str, str, bool]:
    """Return a mutated scene of a seed: how it was made, its text, and whether it must be refused."""
    rng = np.random.default_rng([seed, 19])
    scene = SCENES[int(rng.integers(len(SCENES)))]
    lines, made, wrong = scene.read_text().split("\n"), [], False
    for _ in range(int(rng.integers(1, 4))):
        name = str(rng.choice(list(KINDS)))
        changed = KINDS[name].mutate(lines, rng)
        if changed is not None:
            wrong = KINDS[name].wrong if not made else False  # a later change may take the fault out again
            lines, made = changed, [*made, name]
    return f"{scene.stem}: {', '.join(made)}", "\n".join(lines), wrong


def read(file: Path) -> str | None:
    """Return the message with which a scene is refused, or ``None``."""
    try:
        load_scene(file)
    except InputError as error:
        return str(error)
    return None


@pytest.mark.parametrize("mutants", MUTANTS)
def test_hundreds_of_mutated_scenes_are_read_or_refused_by_one_message(tmp_path: Path, mutants: int) -> None:
    (tmp_path / "robot-motion.csv").write_bytes((SCENES[0].parent / "robot-motion.csv").read_bytes())
    file, refused = tmp_path / "mutant.toml", 0
    for seed in range(mutants):
        made, text, wrong = mutant(seed)
        file.write_text(text, encoding="utf-8")
        begun = time.monotonic()
        message = read(file)
        assert time.monotonic() - begun < SECONDS, (seed, made)
        refused += message is not None
        if message is None:
            assert not wrong, f"seed {seed} ({made}) was accepted"
        else:
            assert "mutant.toml" in message, (seed, made, message)
            assert len(message.splitlines()) <= MOST_LINES, (seed, made, message)
    print(f"{mutants} mutants: {refused} refused, {mutants - refused} read")
    assert 0.02 * mutants < mutants - refused < 0.95 * mutants  # both ends are met
