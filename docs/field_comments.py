"""Fields of data classes in the site's API pages: the comment beside a field, or above it, is its text there."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import Any

import griffe

TO_TOOLS = ("type: ignore", "noqa", "pragma")


class FieldComments(griffe.Extension):
    """Takes comments of annotated fields as their docstrings."""

    def on_class_members(self, *, node: Any, cls: griffe.Class, **_: Any) -> None:
        """Give fields of a class without a docstring the text of their comments."""
        if isinstance(node, ast.ClassDef):
            for field, text, is_shared in comments_of_fields(node, cls.lines_collection[cls.filepath]):
                attribute = cls.members[field.target.id]
                if text and not is_shared and isinstance(attribute, griffe.Attribute) and not attribute.docstring:
                    sentence = text[:1].upper() + text[1:]
                    attribute.docstring = griffe.Docstring(sentence, lineno=field.lineno, parent=attribute)


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


def _has_docstring(node: ast.ClassDef, field: ast.AnnAssign) -> bool:
    return any(isinstance(after, ast.Expr) for after in node.body[node.body.index(field) + 1 :][:1])


def _comment(field: ast.AnnAssign, lines: Sequence[str]) -> str:
    _, *beside = lines[(field.end_lineno or 0) - 1].split("  # ")
    above = takewhile(lambda line: line.startswith("# "), (x.strip() for x in lines[field.lineno - 2 :: -1]))
    told = [text for text in beside if not text.startswith(TO_TOOLS)]
    return " ".join(told or [line[2:] for line in [*above][::-1]])
