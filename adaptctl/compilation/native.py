"""Machine code in memory from LLVM IR, compiled once for a processor and kept for other processes."""

from __future__ import annotations

import functools
import hashlib
import os
import threading
import weakref
from collections.abc import Mapping
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from adaptctl.compilation.object_cache import ObjectCache, cache_folder
from adaptctl.compilation.processor import Processor

_RECIPE = 3
"""Changes when the same IR would give other code."""


class NativeCode:
    """Machine code in the memory of this process, which stays there as long as the object lives. It is made of the
    bytes of a compiled object file, `data`, and of the LLVM target `machine` that it was compiled for; `load` makes it
    of LLVM IR. The bytes are not checked."""

    def __init__(self, data: bytes, machine: llvm.TargetMachine) -> None:
        self.engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        self.engine.add_object_file(llvm.ObjectFileRef.from_data(data))
        self.engine.finalize_object()
        weakref.finalize(self, _release, self.engine).atexit = False

    def address(self, symbol: str) -> int:
        """The address in memory, an integer, of the function of the name `symbol` in this code; 0 where it has none of
        that name. Nothing is raised."""
        with _compiler():
            return int(self.engine.get_function_address(symbol))


def load(text: str, processor: Processor | None = None) -> NativeCode:
    """The `NativeCode` of a module of LLVM IR, `text`: compiled for a `processor`, None for this machine's, or read
    from the cache of compiled objects of earlier processes. Raises `RuntimeError` for text that LLVM refuses,
    `InputError` where the environment variable ADAPTCTL_PROCESSOR names a level that this machine does not have."""
    with _compiler():
        processor = processor or Processor.host()
        machine = processor.machine()
        return NativeCode(_object(text, processor, machine), machine)


def define(addresses: Mapping[str, int]) -> None:
    """Register the `addresses` in memory of functions and objects, by the names under which native code that is loaded
    later refers to them. They hold for the whole process; nothing is checked."""
    with _compiler():
        for name, address in addresses.items():
            llvm.add_symbol(name, address)


def _release(engine: Any) -> None:
    with _compiler():
        engine.close()


def _object(text: str, processor: Processor, machine: llvm.TargetMachine) -> bytes:
    """The compiled object: a kept one, or a new one, which is kept."""
    folder = cache_folder()
    if folder is None:
        return _compiled(text, machine)
    cache, key = ObjectCache(folder), _key(text, processor, machine.triple)
    data = cache.get(key)
    if data is None:
        data = _compiled(text, machine)
        cache.put(key, data)
    return data


def _key(text: str, processor: Processor, triple: str) -> bytes:
    """A digest of all that the code depends on."""
    versions = _RECIPE, llvmlite.__version__, llvm.llvm_version_info
    return hashlib.sha256(repr((versions, triple, processor, text)).encode()).digest()


def _compiled(text: str, machine: llvm.TargetMachine) -> bytes:
    """The object that LLVM makes of a module. Its usual passes would find nothing more: the expressions are simple and
    each is there once."""
    module = llvm.parse_assembly(text, llvm.create_context())
    module.verify()
    passes = llvm.create_new_module_pass_manager()
    passes.add_always_inliner_pass()
    passes.add_sroa_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    return bytes(machine.emit_object(module))


@functools.cache
def _compiler() -> threading.RLock:
    """LLVM, made ready, for one thread at a time.

    No process is forked while another thread uses LLVM, or the child would wait for that thread for ever: so all
    that LLVM makes is also freed while this is held.
    """
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    # LLVM joins the loads of a block in lists of up to 2048, and compares each with each: 1,296 gains took seconds.
    # Lists of 64 give the same code, byte for byte.
    llvm.set_option("", "-combiner-tokenfactor-inline-limit=64")
    lock = threading.RLock()
    os.register_at_fork(before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release)
    return lock
