"""Kernels are compiled once and found again: by other processes, for each constant, wherever one can write."""

import json
import os
import subprocess
import sys
from pathlib import Path

HELPER = """
from rpaug.core.jit import inlined

@inlined
def scaled(x):
    return {factor} * x
"""
KERNEL = """
import functools, json, sys
from rpaug.core.jit import kernel
from made.helper import scaled

@functools.cache
def maker(n):
    def body(x):
        return scaled(x) + n
    return kernel(body)

out = []
for n in map(int, sys.argv[1:]):
    body = maker(n)
    value = body(1.0)
    hits = sum(body.stats.cache_hits.values()) if hasattr(body, "stats") else 0
    out.append([value, hits])
print(json.dumps(out))
"""


def install(folder: Path, factor: int = 10) -> None:
    """A package with a kernel and, in another file, its helper."""
    package = folder / "made"
    package.mkdir(exist_ok=True)
    (package / "__init__.py").write_text("")
    (package / "helper.py").write_text(HELPER.format(factor=factor))
    (package / "kernels.py").write_text(KERNEL)


def run(folder: Path, cache: str, *constants: int, factor: int | None = 10) -> list[list[float]]:
    """(value, cache hits) of the kernel for each constant, in a process of its own; None: as installed."""
    if factor is not None:
        install(folder, factor)
    done = subprocess.run(
        [sys.executable, "-m", "made.kernels", *map(str, constants)],
        env={
            **os.environ,
            "NUMBA_CACHE_DIR": cache,
            "PYTHONPATH": os.pathsep.join([str(folder), *sys.path]),
        },
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def test_another_process_finds_what_one_compiled(tmp_path):
    cache = str(tmp_path / "cache")
    assert run(tmp_path, cache, 1, 2) == [[11, 0], [12, 0]]
    assert run(tmp_path, cache, 2, 1, 3) == [[12, 1], [11, 1], [13, 0]]
    assert not list((tmp_path / "made").rglob("*.nbc"))  # the package's own folder may be read-only


def test_a_changed_helper_in_another_file_is_noticed(tmp_path):
    cache = str(tmp_path / "cache")
    assert run(tmp_path, cache, 1) == [[11, 0]]
    # Of another length: Python tells sources apart by their size and second.
    assert run(tmp_path, cache, 1, factor=200) == [[201, 0]]


def test_without_a_folder_to_write_to_kernels_still_run(tmp_path):
    file = tmp_path / "in_the_way"
    file.write_text("")
    assert run(tmp_path, str(file), 1) == [[11, 0]]


def test_an_install_that_is_read_only_is_compiled_and_found_again(tmp_path):
    install(tmp_path)
    package, cache = tmp_path / "made", str(tmp_path / "cache")
    files = {path.name for path in package.iterdir()}
    package.chmod(0o555)
    try:
        assert run(tmp_path, cache, 1, factor=None) == [[11, 0]]
        assert run(tmp_path, cache, 1, factor=None) == [[11, 1]]
    finally:
        package.chmod(0o755)
    # The interpreter's own cache may appear where permissions do not bind (root); kernels never do.
    assert {path.name for path in package.iterdir()} - {"__pycache__"} == files
    assert not list(package.rglob("*.nb?"))
