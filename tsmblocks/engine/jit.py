"""Machine code from LLVM IR, cached on disk.

The cache is private to the user (loading machine code executes it), files are written atomically, and what is
unreadable is compiled again.
"""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import os
import stat
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

CACHE_BYTES = 200_000_000
"""Size of the cache [bytes] above which the oldest files are deleted. Chosen: small beside a disk."""
_LOCK = threading.Lock()
MOST_LOADED = 64
"""Functions that are kept loaded beside those in use, each of which takes 0.8 MB. Chosen: as many as the candidates of
one round of a diagnosis; what is loaded again from the cache on disk takes some 2 ms."""
_LOADED: dict[str, tuple[Any, Any]] = {}
_MAGIC = b"tsmblocks machine code 1\n"
WRITES_PER_PRUNE = 200
"""Files that a process writes between two checks of the size of the cache; the first check follows the first file."""
_WRITES = itertools.count()


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


def cache_directory() -> Path | None:
    """Directory of cached machine code; None when switched off with ``TSMBLOCKS_CACHE=off``.

    ``TSMBLOCKS_CACHE`` may name another directory.
    """
    named = os.environ.get("TSMBLOCKS_CACHE", "")
    if named == "off":
        return None
    if named:
        return Path(named)
    if sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return base / "tsmblocks"


def _private(directory: Path) -> bool:
    """Make the directory if needed; whether only this user can write to it."""
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        info = directory.stat()
    except OSError:
        return False
    if sys.platform == "win32":  # a user's own folder is protected there
        return True
    return info.st_uid == os.getuid() and not stat.S_IMODE(info.st_mode) & 0o022


def _read(path: Path) -> bytes | None:
    """The machine code in a file, or None when it is missing, owned by another user or damaged."""
    try:
        if sys.platform != "win32" and path.stat().st_uid != os.getuid():
            return None
        data = path.read_bytes()
    except OSError:
        return None
    head, digest, body = data[: len(_MAGIC)], data[len(_MAGIC) : len(_MAGIC) + 32], data[len(_MAGIC) + 32 :]
    return body if head == _MAGIC and hashlib.sha256(body).digest() == digest else None


def _write(path: Path, body: bytes) -> None:
    """Write a file atomically, then check the size of the cache now and then."""
    name = ""
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=".new-")
        with os.fdopen(handle, "wb") as file:
            file.write(_MAGIC + hashlib.sha256(body).digest() + body)
        Path(name).replace(path)
        if next(_WRITES) % WRITES_PER_PRUNE == 0:  # listing thousands of files takes longer than writing one
            _prune(path.parent)
    except OSError:  # without a cache (disk full, read-only, file in use) the code is compiled each time
        if name:
            with suppress(OSError):
                Path(name).unlink(missing_ok=True)


def _prune(directory: Path) -> None:
    """Delete the oldest files above the limit."""
    with os.scandir(directory) as found:
        files = [(f.stat().st_mtime, f.stat().st_size, Path(f.path)) for f in found if f.is_file()]
    total = sum(size for _, size, _ in files)
    for _, size, file in sorted(files, key=lambda row: row[0]):
        if total <= CACHE_BYTES:
            return
        file.unlink(missing_ok=True)
        total -= size


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
    directory = cache_directory()
    path = directory / f"{key}.o" if directory is not None and _private(directory) else None
    body = _read(path) if path is not None else None
    if body is None:
        module = _module(llvm, text)
        passes = llvm.create_new_module_pass_manager()
        passes.add_always_inliner_pass()
        if promote:
            passes.add_sroa_pass()
        passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
        body = machine.emit_object(module)
        if path is not None:
            _write(path, body)
    return bytes(body)
