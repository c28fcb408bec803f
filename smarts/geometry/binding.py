"""Binds arguments to kernels, so that calls do not pass them again.

Passing a tuple of sixty arrays to numba costs 20 us per call, more than many kernels need: numba looks up the
tuple's type and unboxes every array. `bind` writes the addresses, shapes and strides of arguments that stay
the same to memory once, and compiled code reads them there: a call costs 0.3 us, however many arguments are
bound. Compiled code reads only the fields of named tuples that it uses.
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
"""Number of bindings that a `LateBound` caches."""
_WORD = 8
"""Size of a number, an address, an extent or a stride [bytes]."""

T = TypeVar("T")


class Replaceable(Generic[T]):
    """A bound argument that can be replaced in all kernels at once by a value of the same type.

    Args:
        value: The initial value: an array, an integer, a float, or a tuple of these.
    """

    def __init__(self, value: T) -> None:
        self.kind = typeof(value)
        self._words = np.frombuffer(b"".join(_words(value)), np.int64).copy()
        self._value = value

    @property
    def value(self) -> T:
        """The current value."""
        return self._value

    @property
    def address(self) -> int:
        """The address at which compiled code reads the value."""
        return self._words.ctypes.data

    def replace(self, value: T) -> None:
        """Replace the value in all kernels that it is bound to.

        Raises:
            TypeError: The value has another type than the current one.
        """
        kind = typeof(value)
        if kind != self.kind:
            raise TypeError(f"what was bound as {self.kind} cannot be replaced by {kind}")
        self._words[:] = np.frombuffer(b"".join(_words(value)), np.int64)
        self._value = value


class _Bound(partial):
    """A kernel with the address of its bound arguments; keeps these alive."""

    held: tuple[Any, ...]


def bind(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return a kernel with its first arguments bound; callers pass the others by position.

    Arrays are bound by reference, so the kernel sees later changes to their contents. Numbers are bound by
    value.

    Args:
        function: A kernel, made by `kernel`.
        arguments: Arrays, integers, floats, `Replaceable`s, and tuples of these.

    Raises:
        TypeError: An argument has an unsupported type.
    """
    memory = np.frombuffer(b"".join(_words(arguments)), np.int64)
    kinds = tuple(
        _Reference(each.kind) if isinstance(each, Replaceable) else typeof(each) for each in arguments
    )
    bound = _Bound(_address_kernel(function, kinds), memory.ctypes.data)
    bound.held = memory, arguments
    return bound


class LateBound:
    """A kernel whose next arguments are bound when it is called; bindings to the same objects are cached.

    Args:
        function: A kernel, made by `kernel`.
        arguments: Its first arguments, as for `bind`.
    """

    def __init__(self, function: Any, *arguments: Any) -> None:
        self._function, self._arguments = function, arguments
        self._bound: dict[tuple[int, ...], Callable[..., Any]] = {}

    def to(self, *arguments: Any) -> Callable[..., Any]:
        """Return the kernel with its next arguments bound too, from the cache for the same objects."""
        key = tuple(map(id, arguments))
        found = self._bound.get(key)
        if found is None:
            if len(self._bound) == _MOST_BOUND:
                self._bound.clear()
            # A binding keeps its arguments alive, so no other object has the same `id`.
            found = self._bound[key] = bind(self._function, *self._arguments, *arguments)
        return found


class _Reference(types.Type):
    """The numba type of a `Replaceable`: the address of a value is bound, not the value."""

    def __init__(self, kind: types.Type) -> None:
        super().__init__(f"reference to {_name_of(kind)}")
        self.kind = kind


def _words(argument: Any) -> Iterator[bytes]:
    """Yield the bytes of an argument in the order in which `_load` reads them."""
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
def _address_kernel(function: Any, kinds: tuple[types.Type, ...]) -> Any:
    """Return a kernel that calls `function` with arguments at an address, followed by further arguments."""
    target = function.py_func
    # Pass `target` and `unpack` as globals: numba's cache keys would hold process-specific closure cells. The
    # function's name holds the layout of the arguments instead.
    names = {"target": function, "unpack": _unpacker(kinds), "__name__": target.__module__}
    wrapper = FunctionType(_call.__code__, names)
    wrapper.__module__ = target.__module__
    wrapper.__qualname__ = f"bound_{target.__qualname__}_{_layout_digest(*kinds)}"
    return kernel(wrapper)


def _call(address: int, *others: Any) -> Any:
    return target(*unpack(address), *others)  # type: ignore[name-defined]  # noqa: F821


def _unpacker(kinds: tuple[types.Type, ...]) -> Any:
    """Return an intrinsic that reads arguments of types `kinds` at an address."""
    found = _tuple_of(kinds)

    @intrinsic
    def unpack(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return context.make_tuple(builder, found, _load_all(context, builder, kinds, values[0]))

        return found(types.intp), generate

    return unpack


class _Held(types.Type):
    """The numba type of a named tuple that is passed as one address; fields are read where they are used.

    Numba passes tuples of arrays by value, five or more words per array, which takes longer than many
    kernels.
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
        """Return the type of a field, or None if the tuple has no field `name`."""
        fields = held.kind.fields
        return _kernel_type(held.kind.types[fields.index(name)]) if name in fields else None


@lower_getattr_generic(_Held)
def _read_field(context: Any, builder: Any, held: _Held, address: Any, name: str) -> Any:
    """Generate code that reads a field."""
    number = held.kind.fields.index(name)
    place = sum(map(_size, held.kind.types[:number]))
    return _load(context, builder, held.kind.types[number], _offset_address(builder, address, place))


@cache
def _layout_digest(*kinds: Any) -> str:
    """Return a digest of everything that decides where compiled code reads values of types `kinds`.

    It includes this module: kernels need not import it, so their own digests would miss a change.
    """
    content = " ".join([sources_digest(__name__), *map(_layout, kinds)])
    return hashlib.blake2b(content.encode(), digest_size=6).hexdigest()


def _layout(kind: Any) -> str:
    """Return a description of a type's contents in order, with field names (which `str` leaves out)."""
    if isinstance(kind, _Reference):
        return f"reference to {_layout(kind.kind)}"
    if not _is_tuple(kind):
        return str(kind)
    names = kind.fields if _is_named(kind) else [""] * len(kind.types)
    fields = (f"{name}: {_layout(each)}" for name, each in zip(names, kind.types, strict=True))
    return f"({', '.join(fields)})"


def _name_of(kind: Any) -> str:
    """Return a type's name, unique to its layout: numba compares types by name."""
    title = kind.instance_class.__name__ if _is_named(kind) else str(kind)
    return f"{title} {_layout_digest(kind)}"


def _kernel_type(kind: Any) -> Any:
    """Return the type that compiled code receives for a bound argument of type `kind`."""
    if isinstance(kind, _Reference):
        return _kernel_type(kind.kind)
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
    return types.BaseTuple.from_types([_kernel_type(kind) for kind in kinds])


def _size(kind: Any) -> int:
    """Return the number of words that `_words` yields for a value of a type."""
    if _is_tuple(kind):
        return sum(map(_size, kind.types))
    return 1 + 2 * kind.ndim if isinstance(kind, types.Array) else 1


def _offset_address(builder: Any, address: Any, words: int) -> Any:
    """Generate the address `words` words after `address`."""
    return builder.add(address, address.type(words * _WORD))


def _load_all(context: Any, builder: Any, kinds: tuple[Any, ...], address: Any) -> list[Any]:
    """Generate code that reads consecutive values of types `kinds`."""
    places = accumulate(map(_size, kinds), initial=0)
    return [
        _load(context, builder, kind, _offset_address(builder, address, place))
        for kind, place in zip(kinds, places, strict=False)
    ]


def _load(context: Any, builder: Any, kind: Any, address: Any) -> Any:
    """Generate code that reads a value of a type; the result has type `_kernel_type(kind)`."""
    if isinstance(kind, _Reference):
        return _load(context, builder, kind.kind, _load(context, builder, types.intp, address))
    if _is_named(kind):
        return address
    if _is_tuple(kind):
        return context.make_tuple(
            builder, _kernel_type(kind), _load_all(context, builder, kind.types, address)
        )
    if not isinstance(kind, types.Array):
        return _word(builder, context.get_value_type(kind), address, 0)
    array = context.make_array(kind)(context, builder)
    intp = context.get_value_type(types.intp)
    data = _word(builder, context.get_data_type(kind.dtype).as_pointer(), address, 0)
    shape = [_word(builder, intp, address, 1 + axis) for axis in range(kind.ndim)]
    strides = [_word(builder, intp, address, 1 + kind.ndim + axis) for axis in range(kind.ndim)]
    size = context.get_constant(types.intp, get_itemsize(context, kind))
    # No owner: the bound kernel keeps the array alive.
    populate_array(array, data, shape, strides, size, None)
    return array._getvalue()


def _word(builder: Any, kind: Any, address: Any, place: int) -> Any:
    """Generate code that reads one word; words do not change while the kernel runs."""
    value = builder.load(builder.inttoptr(_offset_address(builder, address, place), kind.as_pointer()))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value
