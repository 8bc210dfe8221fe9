"""Meanings of the fields of classes: the comments beside them or above them."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import takewhile
from typing import Any

TO_TOOLS = ("type: ignore", "noqa", "pragma")


def read_comments(table: type) -> dict[str, str]:
    """Read what the comments of a class say of the fields that it defines.

    One above a field is also of those of the same type that follow it without any.
    """
    lines, classes = _read_source(table.__module__)
    meanings, shared, kind = dict[str, str](), "", ""
    for field, text, _ in comments_of_fields(classes[table.__name__], lines):
        before, kind = kind, ast.unparse(field.annotation)
        if text or kind != before:
            shared = text if lines[field.lineno - 2].lstrip().startswith("#") else ""
        meanings[field.target.id] = text or shared
    return {name: meaning for name, meaning in meanings.items() if meaning}


def comments_of_fields(node: ast.ClassDef, lines: Sequence[str]) -> Iterator[tuple[Any, str, bool]]:
    """Yield the annotated fields of a class, their comments, and whether the next field shares that.

    It does if it is of the same type and has none: then the text is neither's alone.
    """
    fields = [field for field in node.body if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)]
    texts = [_comment(field, lines) for field in fields]
    described = [text or _has_docstring(node, field) for field, text in zip(fields, texts, strict=True)]
    for k, (field, text) in enumerate(zip(fields, texts, strict=True)):
        after = fields[k + 1 : k + 2]
        alike = any(ast.unparse(each.annotation) == ast.unparse(field.annotation) for each in after)
        yield field, text, bool(text) and alike and not described[k + 1]


@cache
def _read_source(module: str) -> tuple[list[str], dict[str, ast.ClassDef]]:
    source = inspect.getsource(sys.modules[module])
    return source.splitlines(), {
        node.name: node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)
    }


def _has_docstring(node: ast.ClassDef, field: ast.AnnAssign) -> bool:
    return any(isinstance(after, ast.Expr) for after in node.body[node.body.index(field) + 1 :][:1])


def _comment(field: ast.AnnAssign, lines: Sequence[str]) -> str:
    _, *beside = lines[(field.end_lineno or 0) - 1].split("  # ")
    above = takewhile(lambda line: line.startswith("# "), (x.strip() for x in lines[field.lineno - 2 :: -1]))
    told = [text for text in beside if not text.startswith(TO_TOOLS)]
    return " ".join(told or [line[2:] for line in [*above][::-1]])
