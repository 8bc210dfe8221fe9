"""Tables of several kinds, of which a key says which one a table is."""

from typing import Any, get_args

from pydantic import BaseModel, GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

from fmd.core.data_classes import dataclass


@dataclass(frozen=True)
class KindBy:
    """Choice of a table's class among those of a union by the word at one of its keys.

    It gives the faults of pydantic's own discriminator, but for the kind in their paths. That one makes the checks of
    all classes of a union; here only those that a scene has are made, which takes a third of the time.

    Example:

        Coupler = Annotated[Gear | Rack, KindBy("type")]
    """

    key: str  # name of the field, a ``Literal`` of the words of each class

    def __get_pydantic_core_schema__(self, union: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        classes, by_word = get_args(union), self._list_classes(union)
        known = ", ".join(repr(word) for word in by_word)

        def check(table: Any, info: ValidationInfo) -> Any:
            if isinstance(table, classes):
                return table
            if not isinstance(table, dict):
                raise PydanticKnownError("model_attributes_type")
            key = repr(self.key)
            if self.key not in table:
                raise PydanticKnownError("union_tag_not_found", {"discriminator": key})
            word = table[self.key]
            if not isinstance(word, str) or word not in by_word:
                context = {"discriminator": key, "tag": str(word), "expected_tags": known}
                raise PydanticKnownError("union_tag_invalid", context)
            return by_word[word].model_validate(table, context=info.context)

        def describe(_: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
            for table in classes:
                table.model_rebuild()
            choices = {word: table.__pydantic_core_schema__ for word, table in by_word.items()}
            return handler(core_schema.tagged_union_schema(choices, self.key))

        metadata = {"pydantic_js_functions": [describe]}
        return core_schema.with_info_plain_validator_function(check, metadata=metadata)

    def _list_classes(self, union: Any) -> dict[str, type[BaseModel]]:
        """List the classes of a union by the words that choose them."""
        return {word: each for each in get_args(union) for word in get_args(each.model_fields[self.key].annotation)}
