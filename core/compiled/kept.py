"""numba's `njit`, with a cache that the program can do without.

numba itself stops with an error where no folder can be written and where a kept file is damaged, and it uses a kept
function although a constant or a function that it was compiled with has changed since. Here each of these means only
that the function is compiled again.
"""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Callable
from contextlib import suppress
from types import CodeType
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps

Function = TypeVar("Function", bound=Callable[..., Any])
Packed = tuple[int, bytes]
"""Checksum and content of what is kept of a function."""


def njit(cache: bool = False, **options: Any) -> Callable[[Function], Function]:
    """Compile a function on its first call, as `numba.njit` does; `cache` keeps the result where that is possible."""

    def compiled(function: Function) -> Function:
        dispatcher: Any = numba.njit(**options)(function)
        if cache:
            with suppress(RuntimeError, OSError):  # no folder can be written: it is compiled anew in every run
                dispatcher._cache = KeptFunction(function)
        return cast(Function, dispatcher)

    return compiled


def pack(content: bytes) -> Packed:
    """What is kept, with its checksum."""
    return zlib.crc32(content), content


def unpack(packed: Any) -> bytes:
    """The content of what is kept. Raises ValueError where it is damaged or was kept in another way."""
    match packed:
        case (checksum, bytes(content)) if zlib.crc32(content) == checksum:
            return content
    raise ValueError("what is kept of this function is damaged")


def made_of(function: Callable[..., Any]) -> int:
    """A checksum of all that a function is compiled from: its code, and the constants and functions that it uses."""
    seen: dict[int, None] = {}
    found: list[str] = []
    _collect(function, seen, found)
    return zlib.crc32("\n".join(found).encode())


def _collect(function: Callable[..., Any], seen: dict[int, None], found: list[str]) -> None:
    if id(function) in seen:
        return
    seen[id(function)] = None
    code = function.__code__
    found.append(_code_text(code))
    for name in _names(code):
        used = function.__globals__.get(name)
        if isinstance(used, Dispatcher):
            found.append(f"{name}: {[(key, _text(value)) for key, value in used.targetoptions.items()]}")
            _collect(used.py_func, seen, found)
        elif isinstance(used, np.ndarray):
            found.append(f"{name}: {used.dtype} {used.shape} {used.tobytes()!r}")
        elif isinstance(used, bool | int | float | complex | str | tuple | np.generic):
            found.append(f"{name}: {_text(used)}")


def _code_text(code: CodeType) -> str:
    """Byte code and constants, without the places in the file, which may move."""
    inner = [_code_text(one) if isinstance(one, CodeType) else _text(one) for one in code.co_consts]
    return f"{code.co_code!r} {code.co_names} {inner}"


def _text(value: object) -> str:
    """The same in every process: the order of a set is not."""
    return str(sorted(map(repr, value))) if isinstance(value, set | frozenset) else repr(value)


def _names(code: CodeType) -> list[str]:
    inner = [name for one in code.co_consts if isinstance(one, CodeType) for name in _names(one)]
    return [*code.co_names, *inner]


class _KeptResult(CompileResultCacheImpl):
    """Packs what is kept together with what it is good for."""

    function: Callable[..., Any]

    def reduce(self, cres: Any) -> Packed:
        good_for = made_of(self.function), cres.library.codegen.magic_tuple()
        return pack(dumps((good_for, super().reduce(cres))))

    def rebuild(self, target_context: Any, packed: Any) -> Any:
        good_for, payload = pickle.loads(unpack(packed))
        if good_for != (made_of(self.function), target_context.codegen().magic_tuple()):
            return None
        return super().rebuild(target_context, payload)


class KeptFunction(FunctionCache):
    """What numba keeps of one function. Raises RuntimeError where no folder for it can be written."""

    _impl_class = _KeptResult

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._impl.function = function

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for these arguments; None where it is not kept, or what is kept cannot be used."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception:  # a damaged file makes pickle and LLVM raise anything
            return None
        return found if found is None or tuple(found.signature.args) == tuple(sig) else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function in place of a damaged one; where it cannot be written, nothing more is tried."""
        try:
            super().save_overload(sig, data)
        except Exception:
            try:
                self.flush()  # the index may be what is damaged
                super().save_overload(sig, data)
            except Exception:
                self.disable()


def kept_folder(value: Any) -> str:
    """Where a compiled function is kept; empty for one that is not, and for anything else."""
    cache = getattr(value, "_cache", None) if isinstance(value, Dispatcher) else None
    return str(cache.cache_path) if isinstance(cache, KeptFunction) else ""
