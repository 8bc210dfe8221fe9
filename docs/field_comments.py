"""Fields of data classes in the site's API pages: the comment beside a field, or above it, is its text there."""

import ast
from typing import Any

import griffe

from fmd.scene.schema import comments_of_fields


class FieldComments(griffe.Extension):
    """Takes comments of annotated fields as their docstrings, and our data classes as Python's: for their arguments."""

    def on_alias_instance(self, *, alias: griffe.Alias, **_: Any) -> None:
        """Let ``dataclass`` be Python's own wherever it is imported, which Griffe knows."""
        if alias.target_path == "fmd.core.data_classes.dataclass":
            alias.target_path = "dataclasses.dataclass"

    def on_class_members(self, *, node: Any, cls: griffe.Class, **_: Any) -> None:
        """Give fields of a class without a docstring the text of their comments."""
        if isinstance(node, ast.ClassDef):
            for field, text, is_shared in comments_of_fields(node, cls.lines_collection[cls.filepath]):
                attribute = cls.members[field.target.id]
                if text and not is_shared and isinstance(attribute, griffe.Attribute) and not attribute.docstring:
                    sentence = text[:1].upper() + text[1:]
                    attribute.docstring = griffe.Docstring(sentence, lineno=field.lineno, parent=attribute)
