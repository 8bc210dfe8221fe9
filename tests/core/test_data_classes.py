"""Data classes with late methods are those of Python's decorator, class by class."""

import copy
import dataclasses
import pickle
from abc import ABC, abstractmethod
from dataclasses import FrozenInstanceError, field, replace
from functools import cached_property
from inspect import signature

import pytest

from fmd.core.data_classes import dataclass

KINDS = ({}, {"frozen": True}, {"frozen": True, "slots": True}, {"eq": False}, {"frozen": True, "eq": False})


def _classes(make, options):
    """Return a class and one made of it, with all that fields may be."""

    @make(**options)
    class Base:
        """A base."""

        a: int
        b: list[int] = field(default_factory=list, compare=False)

    @make(**options)
    class Own(Base):
        """One that adds to it."""

        c: float = 2.0
        hidden: str = field(default="h", repr=False)
        made: int = field(init=False, default=0)

        def __post_init__(self):
            object.__setattr__(self, "made", self.a + 1)

    return Base, Own


@pytest.fixture(params=KINDS, ids=str)
def pairs(request):
    return [*zip(_classes(dataclass, request.param), _classes(dataclasses.dataclass, request.param), strict=True)]


def test_arguments_text_equality_and_hash_are_those_of_pythons_decorator(pairs):
    for late, plain in pairs:
        assert str(signature(late)) == str(signature(plain))
        assert repr(late(3, [1])) == repr(plain(3, [1]))
        for one, other in (((3, [1]), (3, [2])), ((3,), (4,))):
            assert (late(*one) == late(*other)) == (plain(*one) == plain(*other))
        assert (late.__hash__ is None) == (plain.__hash__ is None)
        if dataclasses.fields(plain)[0] and plain.__hash__ not in (None, object.__hash__):
            assert hash(late(3, [1])) == hash(plain(3, [1]))
        assert late(1) != plain(1)
        assert [f.name for f in dataclasses.fields(late)] == [f.name for f in dataclasses.fields(plain)]
        with pytest.raises(TypeError, match="missing 1 required positional argument: 'a'"):
            late()
    own = pairs[1][0](4, c=5.0)
    assert (own.made, own.c, own.hidden) == (5, 5.0, "h")
    assert own.b is not pairs[1][0](4).b


def test_replaced_and_copied_ones_are_equal_ones(pairs):
    for late, plain in pairs:
        assert repr(replace(late(3), a=7)) == repr(replace(plain(3), a=7))
        assert repr(copy.deepcopy(late(3))) == repr(late(3))
        assert dataclasses.asdict(late(3)) == dataclasses.asdict(plain(3))


@dataclass(frozen=True, slots=True)
class Slotted:
    """One with slots."""

    a: int
    b: str = "b"


@dataclass(frozen=True)
class Lazy:
    """One that remembers a result."""

    a: int

    @cached_property
    def twice(self):
        return 2 * self.a


@pytest.mark.parametrize("kind", [Slotted, Lazy])
def test_frozen_ones_refuse_values_before_and_after_a_method_was_compiled(kind):
    empty = object.__new__(kind)
    for each in (empty, kind(1)):
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'a'"):
            each.a = 2
        with pytest.raises(FrozenInstanceError, match="cannot delete field 'a'"):
            del each.a


def test_frozen_ones_with_slots_are_pickled_and_have_no_other_attributes():
    assert pickle.loads(pickle.dumps(Slotted(3))) == Slotted(3)
    assert not hasattr(Slotted(3), "__dict__")
    assert Lazy(4).twice == pickle.loads(pickle.dumps(Lazy(4))).twice == 8


def test_methods_of_a_class_itself_stay():
    @dataclass(frozen=True)
    class Own:  # noqa: PLW1641 - the decorator gives it its hash
        a: int

        def __repr__(self):
            return "mine"

        def __eq__(self, other):
            return True

    assert (repr(Own(1)), Own(1) == 3, hash(Own(1))) == ("mine", True, hash((1,)))


def test_abstract_ones_stay_abstract_and_bases_are_called():
    @dataclass(frozen=True)
    class Base(ABC):
        a: int

        def __post_init__(self):
            if self.a < 0:
                raise ValueError("below 0")

        @abstractmethod
        def area(self): ...

    @dataclass(frozen=True)
    class Square(Base):
        b: int = 1

        def area(self):
            return self.a**2

    with pytest.raises(TypeError, match="abstract"):
        Base(1)
    assert Square(3).area() == 9
    with pytest.raises(ValueError, match="below 0"):
        Square(-1)


@pytest.mark.parametrize("base_frozen", [False, True])
@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("others", [dataclass, dataclasses.dataclass])
def test_classes_of_pythons_decorator_inherit_as_from_its_own(others, frozen, base_frozen):
    """A script may inherit from a class of ours by Python's decorator, whose checks are of both."""

    def inherit(make):
        @make(frozen=base_frozen)
        class Base:
            a: int

        @others(frozen=frozen)
        class Own(Base):
            b: int = 0

        return Base, Own

    if frozen != base_frozen:
        for make in (dataclass, dataclasses.dataclass):
            with pytest.raises(TypeError, match="cannot inherit"):
                inherit(make)
        return
    (base, own), (plain, _) = inherit(dataclass), inherit(dataclasses.dataclass)
    assert repr(base.__dataclass_params__) == repr(plain.__dataclass_params__)
    assert replace(own(1), b=2) == own(1, 2)


def test_plain_classes_that_inherit_from_a_frozen_one_have_values_of_their_own():
    class Own(Lazy):
        pass

    own = Own(1)
    own.other = 2
    assert own.other == 2
    del own.other
    assert not hasattr(own, "other")
    with pytest.raises(FrozenInstanceError):
        own.a = 2
