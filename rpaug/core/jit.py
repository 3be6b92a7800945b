"""Compile a kernel once per machine: numba's cache in the user's own cache folder.

An installed package may be read-only, and numba looks only at the one file a function stands in, so a
kernel whose helpers live elsewhere would come back stale. Here compiled kernels lie in the cache (`rpaug.core.cache`;
in `NUMBA_CACHE_DIR` if that is set) and are stamped with the sources of the whole package the kernel belongs to.
"""

import functools
import hashlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.registry import cpu_target

from rpaug.core import cache

_config: Any = numba.config  # its names are made when it is loaded


def cache_folder() -> Path:
    """Where compiled kernels are kept, in `kernels`: `NUMBA_CACHE_DIR` if set, else the cache."""
    return Path(_config.CACHE_DIR or cache.root())


def prime() -> None:
    """Load what numba takes for its first kernel, a sixth of a second, so that children that are forked have it."""
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()


@functools.cache
def _package_stamp(folder: Path) -> str:
    sources = hashlib.sha256(numba.__version__.encode())
    for path in sorted(folder.glob("*.py")):
        sources.update(path.name.encode() + b"\0" + path.read_bytes())
    return sources.hexdigest()


@functools.cache
def _see_writable(path: str) -> None:
    """Raises OSError for a folder that cannot be written: looked at once, since many kernels have the same one."""
    Path(path).mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=path).close()


class _UserFolder(caching._CacheLocator):
    def __init__(self, function: Callable[..., Any], file: str) -> None:
        self._package = Path(file).resolve().parent
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_UserFolder | None":
        locator = cls(py_func, py_file)
        try:
            locator.ensure_cache_path()
        except OSError:
            return None
        return locator

    def ensure_cache_path(self) -> None:
        _see_writable(self.get_cache_path())

    def get_cache_path(self) -> str:
        place = hashlib.sha256(str(self._package).encode()).hexdigest()[:12]
        return str(cache_folder() / "kernels" / f"{self._package.name}-{place}")

    def get_source_stamp(self) -> str:
        return _package_stamp(self._package)

    def get_disambiguator(self) -> str:
        return str(self._line)


class _CacheFiles(caching.CompileResultCacheImpl):
    _locator_classes = [_UserFolder]


class _Cache(caching.FunctionCache):
    _impl_class = _CacheFiles


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile on first call, without the GIL and without fast-math, and keep the result on disk.

    A closure may be passed: its integer free variables become compile-time constants and part of the
    cache's key. Without a writable cache folder the kernel is compiled anew in every process.
    """
    dispatcher: Any = numba.njit(nogil=True, error_model="numpy")(function)
    try:
        dispatcher._cache = _Cache(function)
    except RuntimeError:  # no folder to write to
        return dispatcher
    return dispatcher


inlined = numba.njit(forceinline=True, error_model="numpy")
"""Compile as part of each kernel that calls it."""
