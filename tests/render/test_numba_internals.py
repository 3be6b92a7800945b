"""What rpaug uses of numba and llvmlite beyond their documented interface; a failure says which function to look at.

`pyproject.toml` allows numba up to the newest minor version that these tests have seen.
"""

from importlib import import_module
from operator import attrgetter

import pytest

SIMD, BANKS, JIT = (
    "rpaug/render/splat/_simd.py",
    "rpaug/render/splat/_banks.py",
    "rpaug/core/jit.py",
)
USED = (
    ("numba.core.types", "Type", SIMD, "Lanes, Mask"),
    ("numba.core.types", "UniTuple", BANKS, "bank_of_zeros"),
    ("numba.core.types", "IntegerLiteral", BANKS, "bank_of_zeros"),
    ("numba.extending", "register_model", SIMD, "_LanesModel, _MaskModel"),
    ("numba.extending", "models.PrimitiveModel", SIMD, "_LanesModel, _MaskModel"),
    ("numba.extending", "lower_builtin", SIMD, "_operation, _lower_and"),
    ("numba.extending", "intrinsic", SIMD, "broadcast, and every function under @intrinsic"),
    ("numba.core.typing.templates", "AbstractTemplate", SIMD, "_operation, _And"),
    ("numba.core.typing.templates", "infer_global", SIMD, "_operation, _And"),
    ("numba.core.typing.templates", "signature", SIMD, "_operation, _And"),
    ("numba.core.cgutils", "get_or_insert_function", SIMD, "fma, absolute, prefetch"),
    ("numba.core.cgutils", "unpack_tuple", SIMD, "prefetch"),
    ("numba.core.base", "BaseContext.cast", SIMD, "_as_lanes, pointer_to"),
    ("numba.core.base", "BaseContext.make_array", SIMD, "pointer_to, prefetch, next_ticket"),
    ("numba.core.base", "BaseContext.get_dummy_value", SIMD, "prefetch, store"),
    ("numba.core.base", "BaseContext.make_tuple", BANKS, "bank_of_zeros"),
    ("llvmlite.ir", "VectorType", SIMD, "VECTOR"),
    ("llvmlite.ir", "IRBuilder.shuffle_vector", SIMD, "shuffle"),
    ("llvmlite.ir", "IRBuilder.insert_element", SIMD, "spread"),
    ("llvmlite.ir", "IRBuilder.fcmp_ordered", SIMD, "_operation, minimum, maximum"),
    ("llvmlite.ir", "IRBuilder.cttz", SIMD, "lowest_bit"),
    ("llvmlite.ir", "IRBuilder.atomic_rmw", SIMD, "next_ticket"),
    ("llvmlite.ir", "IntType.as_pointer", SIMD, "read_vector, write_vector, prefetch"),
    ("numba.core.caching", "_CacheLocator", JIT, "_UserFolder"),
    ("numba.core.caching", "CompileResultCacheImpl._locator_classes", JIT, "_CacheFiles"),
    ("numba.core.caching", "FunctionCache._impl_class", JIT, "_Cache"),
    (
        "numba.core.dispatcher",
        "Dispatcher.enable_caching",
        JIT,
        "kernel, which sets `_cache` itself",
    ),
    ("numba.misc.appdirs", "AppDirs", JIT, "cache_folder"),
)


@pytest.mark.parametrize(("module", "name", "file", "functions"), USED)
def test_what_we_lean_on_is_there(module: str, name: str, file: str, functions: str) -> None:
    try:
        attrgetter(name)(import_module(module))
    except (ImportError, AttributeError) as error:
        pytest.fail(f"{module}.{name} is gone ({error}): look at {functions} of {file}")
