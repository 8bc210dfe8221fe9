"""Lines on which the keys and values of a TOML file stand, for messages; Python's own reader gives none."""

import re
import tomllib
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

from fmd.core.limits.scene import SCENES_KEPT

KeyPath = tuple[str | int, ...]

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_TEXT = re.compile(r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'', re.DOTALL)
_KEY = re.compile(r'[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'')
_DOT = re.compile(r"[ \t]*\.[ \t]*")
_BARE_VALUE = re.compile(r"[^,\]}#\n]*")


@lru_cache(maxsize=SCENES_KEPT)
def find_lines(text: str) -> Mapping[KeyPath, int]:
    """Find the lines, from 1, of all tables, keys and items of lists in a TOML file that is valid.

    They are by the keys that lead to each; items of lists count from 0.
    """
    return MappingProxyType(_Scanner(text).lines)


class _Scanner:
    """Walk through the text of a valid TOML file that notes where each key stands."""

    def __init__(self, text: str) -> None:
        self.text, self.at, self.line, self.counted = text, 0, 1, 0
        self.lines: dict[KeyPath, int] = {}
        self.n_items: dict[KeyPath, int] = {}  # of arrays of tables
        table: KeyPath = ()
        self._skip()
        while self.at < len(text):
            if text[self.at] == "[":
                table = self._read_header()
            else:
                self._read_pair(table)
            self._skip()

    def _skip(self, pattern: re.Pattern[str] = _BLANK) -> str:
        """Go past what matches here and return it."""
        match = pattern.match(self.text, self.at)
        self.at = match.end() if match else self.at
        return match[0] if match else ""

    def _note(self, path: KeyPath) -> None:
        self.line += self.text.count("\n", self.counted, self.at)
        self.counted = self.at
        self.lines.setdefault(path, self.line)

    def _read_keys(self) -> tuple[str, ...]:
        """Read a key, or several with dots between them."""
        keys = []
        while True:
            key = self._skip(_KEY)
            keys.append(next(iter(tomllib.loads(f"{key}=0"))) if key[:1] in ('"', "'") else key)
            if not self._skip(_DOT):
                return tuple(keys)

    def _read_header(self) -> KeyPath:
        """Read ``[table]`` or ``[[item of a list]]`` and return its path."""
        is_item = self.text.startswith("[[", self.at)
        self.at += 2 if is_item else 1
        self._skip()
        keys = self._read_keys()
        path: KeyPath = ()
        for key in keys[:-1] if is_item else keys:
            path += (key,)
            self._note(path)
            if path in self.n_items:
                path += (self.n_items[path] - 1,)
        if is_item:
            path += (keys[-1],)
            self._note(path)
            self.n_items[path] = self.n_items.get(path, 0) + 1
            path += (self.n_items[path] - 1,)
            self._note(path)
        self._skip()
        self.at += 2 if is_item else 1
        return path

    def _read_pair(self, table: KeyPath) -> None:
        """Read ``key = value``."""
        path = table
        for key in self._read_keys():
            path += (key,)
            self._note(path)
        self._skip()
        self.at += 1  # the equals sign
        self._skip()
        self._read_value(path)

    def _read_value(self, path: KeyPath) -> None:
        opening = self.text[self.at : self.at + 1]
        if opening not in ("[", "{"):
            self._skip(_TEXT if opening in ('"', "'") else _BARE_VALUE)
            return
        self.at += 1
        self._skip()
        number = 0
        while self.text[self.at] not in "]}":
            if opening == "{":
                self._read_pair(path)
            else:
                self._note((*path, number))
                self._read_value((*path, number))
                number += 1
            self._skip()
            self.at += self.text[self.at] == ","
            self._skip()
        self.at += 1
