"""Machine code from LLVM IR, cached for other processes."""

from __future__ import annotations

import functools
import hashlib
import os
import threading
import weakref
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm

from adaptctl.compilation.lanes import Precision
from adaptctl.compilation.object_cache import ObjectCache, cache_folder
from adaptctl.errors import InputError
from adaptctl.stages import COMPILING, stage

_WIDEST = {"avx512f": 8, "avx": 4, "sse2": 2, "neon": 2}
"""doubles per register by instruction set; the first available counts"""

_AVX2 = ("sse2", "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
_AVX512 = (*_AVX2, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
_LEVELS = {"sse2": ("x86-64", ("sse2",)), "avx2": ("x86-64-v3", _AVX2), "avx512": ("x86-64-v4", _AVX512)}
"""Levels of the x86-64 ABI: LLVM's names and required features."""


LEVEL, QUICK = 1, 0
"""LLVM's optimization levels. At level 2 the same code takes a third longer to compile than at 1, and runs no faster;
at 0 long straight-line code takes a sixth, and runs a third to a half longer."""


def optimization() -> int:
    """Optimization level that ADAPTCTL_OPTIMIZATION names; at 0, no multiplication and addition are fused."""
    level = os.environ.get("ADAPTCTL_OPTIMIZATION", "") or str(LEVEL)
    if level not in (str(LEVEL), str(QUICK)):
        raise InputError(f"ADAPTCTL_OPTIMIZATION: expected {QUICK} or {LEVEL}, got {level!r}")
    return int(level)


class Processor(NamedTuple):
    """Processor that native code is made for."""

    name: str
    features: str

    @classmethod
    def host(cls) -> Processor:
        """This machine's processor, limited by ADAPTCTL_PROCESSOR ("sse2", "avx2" or "avx512")."""
        level = os.environ.get("ADAPTCTL_PROCESSOR", "")
        return _whole() if level in ("", "native") else _whole().limited(level)

    def limited(self, level: str) -> Processor:
        """This processor with the instruction sets of a `level`."""
        if level not in _LEVELS:
            known = ", ".join(("native", *_LEVELS))
            raise InputError(f"ADAPTCTL_PROCESSOR: expected one of {known}, got {level!r}")
        name, needed = _LEVELS[level]
        missing = [feature for feature in needed if f"+{feature}" not in self.features.split(",")]
        if missing:
            lacks = f"this processor, {self.name}, lacks {', '.join(missing)}"
            raise InputError(f"ADAPTCTL_PROCESSOR: {level!r} cannot be used: {lacks}; use 'native', or unset it")
        return Processor(name, ",".join(f"+{feature}" for feature in needed))

    @property
    def lanes(self) -> int:
        """Number of doubles that one SIMD instruction works on."""
        has = self.features.split(",")
        return next((lanes for feature, lanes in _WIDEST.items() if f"+{feature}" in has), 1)

    def lanes_of(self, precision: Precision) -> int:
        """Numbers of a `precision` per SIMD register."""
        return self.lanes if precision == "double" or self.lanes == 1 else 2 * self.lanes

    def machine(self, level: int = LEVEL) -> llvm.TargetMachine:
        """New LLVM target machine for this processor, at an optimization level."""
        target = llvm.Target.from_default_triple()
        return target.create_target_machine(cpu=self.name, features=self.features, opt=level, jit=True)


@functools.cache
def _whole() -> Processor:
    return Processor(llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())


_RECIPE = 5
"""Changes when the same IR would give other code."""


class NativeCode:
    """Machine code in memory, freed with the object."""

    def __init__(self, objects: Iterable[bytes], machine: llvm.TargetMachine) -> None:
        self.engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        for data in objects:
            self.engine.add_object_file(llvm.ObjectFileRef.from_data(data))
        self.engine.finalize_object()
        weakref.finalize(self, _release, self.engine).atexit = False

    def address(self, symbol: str) -> int:
        """Address in memory of a function of this code."""
        with _compiler():
            return int(self.engine.get_function_address(symbol))


def load(text: str, processor: Processor | None = None, pieces: str = "") -> NativeCode:
    """The `NativeCode` of a module of LLVM IR, `text`, and of one of `pieces` that is compiled quickly; both if any."""
    with _compiler():
        processor, level = processor or Processor.host(), optimization()
        machine = processor.machine(level)
        if level == QUICK:  # which would fuse in lanes alone
            text, pieces = text.replace(" contract ", " "), pieces.replace(" contract ", " ")
        objects = [_object(text, processor, machine, level)] if text else []
        if pieces:
            objects.append(_object(pieces, processor, processor.machine(QUICK), QUICK))
        return NativeCode(objects, machine)


_modules: weakref.WeakValueDictionary[str, NativeCode] = weakref.WeakValueDictionary()


def load_shared(text: str, symbols: Sequence[str], processor: Processor) -> NativeCode:
    """Code of a module that others call by its symbols, loaded once; they must keep it."""
    with _compiler():
        code = _modules.get(symbols[0])
        if code is None:
            code = _modules[symbols[0]] = load(text, processor)
            define({symbol: code.address(symbol) for symbol in symbols})
        return code


def define(addresses: Mapping[str, int]) -> None:
    """Register addresses for native code loaded later."""
    with _compiler():
        for name, address in addresses.items():
            llvm.add_symbol(name, address)


def _release(engine: Any) -> None:
    with _compiler():
        engine.close()


def _object(text: str, processor: Processor, machine: llvm.TargetMachine, level: int) -> bytes:
    folder = cache_folder()
    if folder is None:
        return _compiled(text, machine)
    cache, key = ObjectCache(folder), _key(text, processor, machine.triple, level)
    data = cache.get(key)
    if data is None:
        data = _compiled(text, machine)
        cache.put(key, data)
    return data


def _key(text: str, processor: Processor, triple: str, level: int) -> bytes:
    """Digest of all that the code depends on."""
    versions = _RECIPE, llvmlite.__version__, llvm.llvm_version_info
    return hashlib.sha256(f"{versions, level, triple, processor}\n{text}".encode()).digest()


def _compiled(text: str, machine: llvm.TargetMachine) -> bytes:
    with stage(COMPILING):
        return _emitted(text, machine)


def _emitted(text: str, machine: llvm.TargetMachine) -> bytes:
    module = llvm.parse_assembly(text, llvm.create_context())
    module.verify()
    passes = llvm.create_new_module_pass_manager()
    passes.add_always_inliner_pass()
    passes.add_sroa_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    llvm.set_option("", "-disable-lsr=true")  # loops have few addresses, and LLVM took a tenth of its time for them
    try:
        return bytes(machine.emit_object(module))
    finally:
        llvm.set_option("", "-disable-lsr=false")  # another package's loops may need it


@functools.cache
def _compiler() -> threading.RLock:
    import logging  # noqa: F401  # whose lock a fork must take after ours, under which the cache logs

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    # LLVM joins the loads of a block in lists of up to 2048, and compares each with each: 1,296 gains took seconds.
    # Lists of 64 give the same code, byte for byte.
    llvm.set_option("", "-combiner-tokenfactor-inline-limit=64")
    lock = threading.RLock()
    os.register_at_fork(before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release)
    return lock
