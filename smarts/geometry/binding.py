"""Kernels whose arguments are bound once.

To hand numba a tuple of sixty arrays costs 20 us a call: it looks up the tuple's type and takes every array
out of its Python object, which is more than many kernels of the step take themselves. So what stays the same
from call to call is written down once, as addresses, shapes and strides, and compiled code reads it there:
the call costs 0.3 us however much there is. Of named tuples it reads only what is used.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import accumulate
from types import FunctionType
from typing import Any, Generic, TypeVar

import numpy as np
from llvmlite.ir import IntType
from numba import typeof
from numba.core import types
from numba.core.extending import intrinsic, lower_getattr_generic, models, register_model
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.np.arrayobj import get_itemsize, populate_array

from smarts.geometry.compiling import kernel, sources_digest

_MOST_BOUND = 4
"""Bindings that a `LateBound` keeps."""
_WORD = 8
"""Bytes of a number, an address, an extent or a stride."""

T = TypeVar("T")


class Replaceable(Generic[T]):
    """An argument to bind that may be replaced by another of the same type: all kernels get the new one.

    Args:
        value: What is bound at first; arrays, whole numbers, floats, and tuples of such.
    """

    def __init__(self, value: T) -> None:
        self.kind = typeof(value)
        self._words = np.frombuffer(b"".join(_words(value)), np.int64).copy()
        self._value = value

    @property
    def value(self) -> T:
        """The value that is bound now."""
        return self._value

    @property
    def address(self) -> int:
        """The address at which compiled code reads it."""
        return self._words.ctypes.data

    def replace(self, value: T) -> None:
        """Bind another value from now on.

        Raises:
            TypeError: It is of another type.
        """
        kind = typeof(value)
        if kind != self.kind:
            raise TypeError(f"what was bound as {self.kind} cannot be replaced by {kind}")
        self._words[:] = np.frombuffer(b"".join(_words(value)), np.int64)
        self._value = value


class _Bound(partial):
    """A call of a kernel with an address; keeps alive what lies there."""

    held: tuple[Any, ...]


def bind(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return a kernel with its first arguments given, for calls by position with the others.

    Arrays are bound as they lie in memory: what is written into them later is seen. Numbers are bound by
    their value.

    Args:
        function: A kernel, made by `kernel`.
        arguments: Arrays, whole numbers, floats, tuples of such, and `Replaceable`.

    Raises:
        TypeError: An argument is of another type.
    """
    memory = np.frombuffer(b"".join(_words(arguments)), np.int64)
    kinds = tuple(
        _Reference(each.kind) if isinstance(each, Replaceable) else typeof(each) for each in arguments
    )
    bound = _Bound(_taking_address(function, kinds), memory.ctypes.data)
    bound.held = memory, arguments
    return bound


class LateBound:
    """A kernel that is bound to further arguments at the call: those that are usually the same objects.

    Args:
        function: A kernel, made by `kernel`.
        arguments: Its first arguments, as for `bind`.
    """

    def __init__(self, function: Any, *arguments: Any) -> None:
        self._function, self._arguments = function, arguments
        self._bound: dict[tuple[int, ...], Callable[..., Any]] = {}

    def to(self, *arguments: Any) -> Callable[..., Any]:
        """Return the kernel with its next arguments bound too; the same objects are bound once."""
        key = tuple(map(id, arguments))
        found = self._bound.get(key)
        if found is None:
            if len(self._bound) == _MOST_BOUND:
                self._bound.clear()
            # What is bound keeps its arguments alive, so that no other object has the same `id`.
            found = self._bound[key] = bind(self._function, *self._arguments, *arguments)
        return found


class _Reference(types.Type):
    """The type of what is not bound itself, but by its address."""

    def __init__(self, kind: types.Type) -> None:
        super().__init__(f"reference to {_name_of(kind)}")
        self.kind = kind


def _words(argument: Any) -> Iterator[bytes]:
    """Yield the bytes of an argument, in the order in which `_unpacked` reads them."""
    if isinstance(argument, Replaceable):
        yield struct.pack("=q", argument.address)
    elif isinstance(argument, tuple):
        for each in argument:
            yield from _words(each)
    elif isinstance(argument, np.ndarray):
        numbers = argument.ctypes.data, *argument.shape, *argument.strides
        yield struct.pack(f"={len(numbers)}q", *numbers)
    elif type(argument) in (int, float):
        yield struct.pack("=q" if isinstance(argument, int) else "=d", argument)
    else:
        raise TypeError(f"a kernel cannot be bound to {argument!r} of {type(argument)}")


@cache
def _taking_address(function: Any, kinds: tuple[types.Type, ...]) -> Any:
    """Return a kernel that takes the address of bound arguments, and then others, for another kernel."""
    target = function.py_func
    # Globals, not cells of a closure: numba's cache would write objects of this process into its keys. Their
    # layout is in the name instead.
    names = {"target": function, "unpack": _unpacker(kinds), "__name__": target.__module__}
    wrapper = FunctionType(_call.__code__, names)
    wrapper.__module__ = target.__module__
    wrapper.__qualname__ = f"bound_{target.__qualname__}_{_layout_digest(*kinds)}"
    return kernel(wrapper)


def _call(address: int, *others: Any) -> Any:
    return target(*unpack(address), *others)  # type: ignore[name-defined]  # noqa: F821


def _unpacker(kinds: tuple[types.Type, ...]) -> Any:
    """Return a compiled function that reads arguments of some types at an address."""
    found = _tuple_of(kinds)

    @intrinsic
    def unpack(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return context.make_tuple(builder, found, _loaded(context, builder, kinds, values[0]))

        return found(types.intp), generate

    return unpack


class _Held(types.Type):
    """The type of a named tuple that stays in memory: code that is given it gets one address.

    Its fields are read where they are used. Tuples of arrays themselves are handed from function to function
    by value, five words or more for each array, which takes longer than many functions do.
    """

    def __init__(self, kind: Any) -> None:
        super().__init__(f"held {_name_of(kind)}")
        self.kind = kind


@register_model(_Held)
class _HeldModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Held) -> None:
        super().__init__(manager, kind, IntType(8 * _WORD))


@infer_getattr
class _HeldFields(AttributeTemplate):
    key = _Held

    def generic_resolve(self, held: _Held, name: str) -> Any:
        """Return the type of a field, None if there is none of this name."""
        fields = held.kind.fields
        return _seen(held.kind.types[fields.index(name)]) if name in fields else None


@lower_getattr_generic(_Held)
def _read_field(context: Any, builder: Any, held: _Held, address: Any, name: str) -> Any:
    """Generate the reading of a field."""
    number = held.kind.fields.index(name)
    place = sum(map(_size, held.kind.types[:number]))
    return _load(context, builder, held.kind.types[number], _shifted(builder, address, place))


@cache
def _layout_digest(*kinds: Any) -> str:
    """Return a digest of all that decides where compiled code looks for values of some types.

    That is this module too. A kernel need not import it, so that its own digest would not notice a change.
    """
    content = " ".join([sources_digest(__name__), *map(_layout, kinds)])
    return hashlib.blake2b(content.encode(), digest_size=6).hexdigest()


def _layout(kind: Any) -> str:
    """Return what a type holds, in order: other than its string, with the names of fields."""
    if isinstance(kind, _Reference):
        return f"reference to {_layout(kind.kind)}"
    if not _is_tuple(kind):
        return str(kind)
    names = kind.fields if _is_named(kind) else [""] * len(kind.types)
    fields = (f"{name}: {_layout(each)}" for name, each in zip(names, kind.types, strict=True))
    return f"({', '.join(fields)})"


def _name_of(kind: Any) -> str:
    """Return a name for a type that another layout does not have: numba tells types apart by their names."""
    title = kind.instance_class.__name__ if _is_named(kind) else str(kind)
    return f"{title} {_layout_digest(kind)}"


def _seen(kind: Any) -> Any:
    """Return the type as which compiled code gets what is bound as a type."""
    if isinstance(kind, _Reference):
        return _seen(kind.kind)
    if _is_named(kind):
        return _Held(kind)
    if _is_tuple(kind):
        return _tuple_of(kind.types)
    return kind


def _is_tuple(kind: Any) -> bool:
    return isinstance(kind, types.BaseTuple)


def _is_named(kind: Any) -> bool:
    return isinstance(kind, types.BaseNamedTuple)


def _tuple_of(kinds: tuple[Any, ...]) -> Any:
    return types.BaseTuple.from_types([_seen(kind) for kind in kinds])


def _size(kind: Any) -> int:
    """Return how many words `_words` yields for a value of a type."""
    if _is_tuple(kind):
        return sum(map(_size, kind.types))
    return 1 + 2 * kind.ndim if isinstance(kind, types.Array) else 1


def _shifted(builder: Any, address: Any, words: int) -> Any:
    """Generate the address of what lies some words behind."""
    return builder.add(address, address.type(words * _WORD))


def _loaded(context: Any, builder: Any, kinds: tuple[Any, ...], address: Any) -> list[Any]:
    """Generate the reading of values that lie one after the other."""
    places = accumulate(map(_size, kinds), initial=0)
    return [
        _load(context, builder, kind, _shifted(builder, address, place))
        for kind, place in zip(kinds, places, strict=False)
    ]


def _load(context: Any, builder: Any, kind: Any, address: Any) -> Any:
    """Generate the reading of a value of a type; return it as the type that is seen."""
    if isinstance(kind, _Reference):
        return _load(context, builder, kind.kind, _load(context, builder, types.intp, address))
    if _is_named(kind):
        return address
    if _is_tuple(kind):
        return context.make_tuple(builder, _seen(kind), _loaded(context, builder, kind.types, address))
    if not isinstance(kind, types.Array):
        return _word(builder, context.get_value_type(kind), address, 0)
    array = context.make_array(kind)(context, builder)
    intp = context.get_value_type(types.intp)
    data = _word(builder, context.get_data_type(kind.dtype).as_pointer(), address, 0)
    shape = [_word(builder, intp, address, 1 + axis) for axis in range(kind.ndim)]
    strides = [_word(builder, intp, address, 1 + kind.ndim + axis) for axis in range(kind.ndim)]
    size = context.get_constant(types.intp, get_itemsize(context, kind))
    # Without an owner: the bound kernel keeps the array alive.
    populate_array(array, data, shape, strides, size, None)
    return array._getvalue()


def _word(builder: Any, kind: Any, address: Any, place: int) -> Any:
    """Generate the reading of one word, which does not change while the kernel runs."""
    value = builder.load(builder.inttoptr(_shifted(builder, address, place), kind.as_pointer()))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value
