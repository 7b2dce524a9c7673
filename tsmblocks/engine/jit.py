"""Machine code from LLVM IR, cached on disk by ``code_cache``; code that cannot be read there is compiled again."""

from __future__ import annotations

import ctypes
import hashlib
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from tsmblocks.common.fork_locks import hold_over_forks
from tsmblocks.engine.code_cache import read_code, write_code

_LOCK = threading.RLock()
MOST_LOADED = 64
"""Functions that are kept loaded beside those in use, each of which takes 0.8 MB. Chosen: as many as the candidates of
one round of a diagnosis; what is loaded again from the cache on disk takes some 2 ms."""
_LOADED: dict[str, tuple[Any, Any]] = {}


def _lock_of_library() -> Any:
    """The lock that llvmlite holds during each of its calls, where it is loaded."""
    return getattr(getattr(sys.modules.get("llvmlite.binding.ffi"), "lib", None), "_lock", None) or nullcontext()


@contextmanager
def _compiler_at_rest() -> Iterator[None]:
    """Wait until no thread compiles or calls the compiler, and keep it so."""
    with _LOCK, _lock_of_library():
        yield


hold_over_forks(_compiler_at_rest)


def available() -> bool:
    """Whether llvmlite can be imported and is not switched off (``TSMBLOCKS_ENGINE=casadi``)."""
    if os.environ.get("TSMBLOCKS_ENGINE", "") == "casadi":
        return False
    try:
        import llvmlite.binding  # noqa: F401
    except ImportError:
        return False
    return True


def _binding() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


def host() -> str:
    """The target triple of this machine."""
    return str(_binding().get_default_triple())


def _machine(llvm: Any, quick: bool) -> tuple[Any, str]:
    """A target machine for this processor, and the text that identifies it."""
    level = 0 if quick else 2
    features = llvm.get_host_cpu_features().flatten()
    if "+avx512f" in features:
        features += ",-prefer-256-bit"
    cpu = llvm.get_host_cpu_name()
    target = llvm.Target.from_triple(llvm.get_default_triple())
    import llvmlite

    name = "|".join([llvm.get_default_triple(), cpu, features, llvmlite.__version__, f"opt{level}"])
    return target.create_target_machine(cpu=cpu, features=features, opt=level, jit=True, codemodel="jitdefault"), name


def compile_text(text: str, *, promote: bool, quick: bool = False) -> Any:
    """The function ``run`` of a module as a callable taking the address of its table.

    ``promote`` moves stack variables into registers (for all but the large form). ``quick`` compiles without
    optimisation: a third of the time to compile, about half as much again to run, for code that runs a few times.
    """
    llvm = _binding()
    with _LOCK:
        machine, identity = _machine(llvm, quick)
        key = hashlib.sha256(f"{identity}|{promote}|{text}".encode()).hexdigest()
        if key in _LOADED:
            _LOADED[key] = _LOADED.pop(key)  # the last ones used are kept
        else:
            engine = llvm.create_mcjit_compiler(_module(llvm, ""), machine)
            engine.add_object_file(llvm.ObjectFileRef.from_data(_object(llvm, machine, key, text, promote)))
            engine.finalize_object()
            function: Any = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(engine.get_function_address("run"))
            function.engine = engine  # keeps the code alive as long as the function
            while len(_LOADED) >= MOST_LOADED:
                _LOADED.pop(next(iter(_LOADED)))
            _LOADED[key] = (engine, function)
        return _LOADED[key][1]


def _module(llvm: Any, text: str) -> Any:
    module = llvm.parse_assembly(text)
    module.triple = llvm.get_default_triple()
    return module


def _object(llvm: Any, machine: Any, key: str, text: str, promote: bool) -> bytes:
    """Object code, from the cache or compiled."""
    body = read_code(key)
    if body is None:
        module = _module(llvm, text)
        passes = llvm.create_new_module_pass_manager()
        passes.add_always_inliner_pass()
        if promote:
            passes.add_sroa_pass()
        passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
        body = bytes(machine.emit_object(module))
        write_code(key, body)
    return body
