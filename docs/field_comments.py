"""Fields of data classes in the site's API pages: the comment beside a field, or above it, is its text there."""

from __future__ import annotations

import ast
from itertools import takewhile
from typing import Any

import griffe


class FieldComments(griffe.Extension):
    """Takes comments of annotated fields as their docstrings."""

    def on_attribute_instance(self, *, node: Any, attr: griffe.Attribute, **_: Any) -> None:
        """Give a field of a class without a docstring the text of its comment."""
        if attr.docstring or not isinstance(node, ast.AnnAssign) or not isinstance(attr.parent, griffe.Class):
            return
        lines = attr.lines_collection[attr.filepath]
        _, mark, text = lines[node.end_lineno - 1].rpartition("  # ")
        if not mark:
            above = takewhile(lambda line: line.startswith("# "), (x.strip() for x in lines[node.lineno - 2 :: -1]))
            text = " ".join(line[2:] for line in [*above][::-1])
        if text:
            attr.docstring = griffe.Docstring(text[:1].upper() + text[1:], lineno=node.lineno, parent=attr)
