"""Numba compilers of kernels: callees end as LLVM code, only kernels called from Python as machine code.

Numba compiles every callee as if Python called it too: with a wrapper, optimised, to machine code. The caller
uses none of this: it links the callee's LLVM code and optimises it again. Numba also compiles a callee for
each combination of argument types, with `int32` and `int64` apart. Here a callee is compiled to LLVM code
only, once for all integer widths. This halves the compile time of an environment's kernels; results are
bit-identical.
"""

from __future__ import annotations

import fcntl
import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FunctionType
from typing import Any

import llvmlite.binding as llvm
from llvmlite.ir import Constant, GlobalVariable, IntType
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

_OPTIONS = {"nopython": True, "boundscheck": None, "error_model": "numpy"}
_NARROW = {types.int8, types.int16, types.int32}
_LOCK = ".kernels.lock"
"""Lock file in a folder of compiled kernels; held while an entry is added."""
_ENVIRONMENT = "_ZN08NumbaEnv"
"""Prefix of the variables that hold a function's Python objects."""


class _Cache(FunctionCache):
    """Numba's disk cache with a lock, so that one process at a time adds entries.

    Adding an entry reads, extends and writes an index. Two processes at once would give two entries the same
    file and so damage the cache.
    """

    def save_overload(self, sig: Any, data: Any) -> None:
        """Add a compiled overload."""
        folder = Path(self.cache_path)
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / _LOCK).open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            super().save_overload(sig, data)


class _Dispatcher(CPUDispatcher):
    """Numba's compiler of one function, with the locked disk cache."""

    def enable_caching(self) -> None:
        """Cache compiled code on disk."""
        self._cache = _Cache(self.py_func)


class Kernel(_Dispatcher):
    """A function that is compiled once for calls from Python and separately for calls from kernels.

    Args:
        function: The function.
        others: Arguments that numba passes when it copies a dispatcher; ignored.
    """

    def __init__(self, function: Callable, *others: Any) -> None:
        super().__init__(function, targetoptions=_OPTIONS, pipeline_class=_Compiler)
        self.enable_caching()
        self.callee = _Callee(_renamed(function))

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the type of a call from another compiled function."""
        return self.callee.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return the compiled callee for a signature."""
        return self.callee.get_overload(sig)

    def compile(self, sig: Any) -> Any:
        """Compile for arguments from Python, or load the code from the cache."""
        with _no_collection():
            return super().compile(sig)


class _Callee(_Dispatcher):
    """A kernel for calls from other kernels."""

    def __init__(self, function: Callable, *others: Any) -> None:
        options = {**_OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        super().__init__(function, targetoptions=options, pipeline_class=_CalleeCompiler)
        self.enable_caching()

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the type of a call with all integers widened to 64 bits."""
        return super().get_call_template(tuple(map(_widened, args)), {k: _widened(v) for k, v in kws.items()})


def _widened(kind: Any) -> Any:
    return types.int64 if isinstance(kind, types.IntegerLiteral) or kind in _NARROW else kind


def _renamed(function: Any) -> Callable:
    """Return a copy of a function with another name in the disk cache."""
    copy = FunctionType(
        function.__code__,
        function.__globals__,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    copy.__kwdefaults__ = function.__kwdefaults__
    copy.__module__ = function.__module__
    copy.__qualname__ = f"callee_{function.__qualname__}"
    return copy


@contextmanager
def _no_collection() -> Iterator[None]:
    """Disable the garbage collector: scanning the compiler's long-lived objects takes 10% of the time."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class _Flags(Flags):
    """Numba's flags with a fast comparison, by the flags that are set: numba compares them 100,000 times."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return self._values == other._values if isinstance(other, _Flags) else super().__eq__(other)

    def __hash__(self) -> int:
        return hash(_Flags)


class _Compiler(CompilerBase):
    """Numba's own compiler passes, with `_Flags`."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.state.flags = _Flags(self.state.flags)

    def define_pipelines(self) -> list[Any]:
        """Return the passes."""
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


class _CalleeCompiler(_Compiler):
    """Numba's compiler passes, with a last pass that leaves LLVM code."""

    def define_pipelines(self) -> list[Any]:
        """Return the passes."""
        (passes,) = super().define_pipelines()
        passes.add_pass_after(_CalleeLowering, NativeLowering)
        passes.passes = [each for each in passes.passes if each[0] is not NativeLowering]
        passes.finalize()
        return [passes]


@register_pass(mutates_CFG=True, analysis_only=False)
class _CalleeLowering(NativeLowering):
    """Lowers a function into a library that generates no machine code."""

    _name = "callee_lowering"

    def run_pass(self, state: Any) -> Any:
        """Lower the function into a `_CalleeLibrary`."""
        state.library = _CalleeLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().run_pass(state)


class _CalleeLibrary(JITCodeLibrary):
    """The LLVM code of a function, to be linked into its callers and optimised there."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self: Any) -> None:
        """Generate machine code only for the variables that hold the function's Python objects."""
        self._finalize_dynamic_globals()
        module = self._codegen._create_empty_module(f"{self.name}.environments")
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                own: Any = GlobalVariable(module, IntType(8).as_pointer(), variable.name)
                own.linkage, own.initializer = "common", Constant(own.value_type, None)
        self._environments = llvm.parse_assembly(str(module))
        self._codegen._add_module(self._environments)
        self._codegen._engine.finalize_object()
        self._finalized = True

    def serialize_using_object_code(self) -> Any:
        """Return the bitcode for the disk cache."""
        return self.serialize_using_bitcode()
