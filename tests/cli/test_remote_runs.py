"""Runs from and to an object store: the bytes of a run from and to a folder."""

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import lerobot_samples
import pytest
import rlds_samples
from quick_fits import QUICK, quick_worker
from runs import GROUP, contents
from test_cli import run

from rpaug.gaussians import cached
from rpaug.pipeline import workers

fsspec = pytest.importorskip("fsspec", reason="the extra `remote` is not installed")

RECIPE = "version: 1\ncopies: 2\nedits:\n  - {op: sensor_noise}\n"


def made(kind: str, template: Path, folder: Path) -> None:
    """A small dataset of a layout."""
    if kind == "rlbench":
        shutil.copytree(template, folder)
    else:
        {"rlds": rlds_samples.dataset, "lerobot": lerobot_samples.dataset}[kind](folder)


def noted(folder: Path) -> dict[str, bytes]:
    return {name: data for name, data in contents(folder).items() if not name.endswith(".html")}


@pytest.fixture
def url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Of a store in memory, and a cache of its own."""
    monkeypatch.setenv("RPAUG_CACHE", str(tmp_path / "cache"))
    fsspec.filesystem("memory").store.clear()
    return "memory://bucket"


def worker_that_fits_nothing(connection: Connection) -> None:
    vars(cached.fit)["fitted"] = None
    quick_worker(connection)


@pytest.mark.parametrize("kind", ["rlbench", "rlds", "lerobot"])
def test_a_run_from_and_to_a_store_has_the_bytes_of_one_on_a_disk(
    kind: str, template: Path, tmp_path: Path, url: str
) -> None:
    (tmp_path / "r.yaml").write_text(RECIPE)
    made(kind, template, tmp_path / "data/in")
    same_bytes(url, fsspec.filesystem("memory"), "/bucket", tmp_path)


def same_bytes(url: str, store: fsspec.AbstractFileSystem, root: str, folder: Path) -> None:
    """Put the dataset there, run over it, go on with the finished run, on another machine as well, and compare."""
    store.put(f"{folder}/data/", f"{root}/data/", recursive=True)
    given = ("--recipe", folder / "r.yaml")
    assert run("augment", folder / "data/in", *given, "--out", folder / "out/one")[0] == 0
    wanted = noted(folder / "out/one")
    there = ("augment", f"{url}/data/in", *given, "--out", f"{url}/out/one")
    assert run(*there)[0] == 0
    store.get(f"{root}/out/one", str(folder / "sent"), recursive=True)
    assert noted(folder / "sent") == wanted
    code, _, said = run(*there)
    assert (code, "something there already" in said) == (2, True)
    before = store.find(root, detail=True)
    shutil.rmtree(folder / "cache")  # as if on another machine
    assert run(*there, "--resume")[0] == 0
    shutil.rmtree(folder / "sent")
    store.get(f"{root}/out/one", str(folder / "sent"), recursive=True)
    assert noted(folder / "sent") == wanted
    assert store.find(root, detail=True).keys() == before.keys()
    assert run("verify", f"{url}/out/one", "--against", f"{url}/data/in")[0] == 0


def test_fitted_scenes_in_a_store_are_found_by_other_machines(
    template: Path, tmp_path: Path, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, fit in QUICK.items():
        monkeypatch.setattr(cached, name, fit)
    monkeypatch.setattr(workers, "_serve", quick_worker)
    (tmp_path / "r.yaml").write_text(RECIPE)
    given = ("augment", template, "--recipe", tmp_path / "r.yaml", "--tier", 3)
    assert run(*given, "--out", tmp_path / "one", "--scenes", tmp_path / "scenes")[0] == 0
    wanted, scenes = noted(tmp_path / "one"), f"{url}/scenes"
    assert run(*given, "--out", tmp_path / "two", "--scenes", scenes)[0] == 0
    assert noted(tmp_path / "two") == wanted
    store = fsspec.filesystem("memory")
    sent = store.find("/bucket/scenes", detail=True)
    assert {name.removeprefix("/bucket/scenes/") for name in sent} == {
        *contents(tmp_path / "scenes")
    }
    shutil.rmtree(tmp_path / "cache")  # as if on another machine
    monkeypatch.setattr(workers, "_serve", worker_that_fits_nothing)
    assert run(*given, "--out", tmp_path / "three", "--scenes", scenes)[0] == 0
    assert noted(tmp_path / "three") == wanted
    assert store.find("/bucket/scenes", detail=True) == sent


def test_folders_by_url_are_the_same_store(template: Path, tmp_path: Path, url: str) -> None:
    (tmp_path / "r.yaml").write_text(RECIPE)
    made("rlbench", template, tmp_path / "data/in")
    out = f"file://{tmp_path}/there/out"
    given = ("--recipe", tmp_path / "r.yaml", "--out", out)
    assert run("augment", f"file://{tmp_path}/data/in", *given)[0] == 0
    assert (tmp_path / "there/out" / GROUP / "episode3").is_dir()


def test_nodes_of_a_cluster_see_no_url(tmp_path: Path, url: str) -> None:
    (tmp_path / "r.yaml").write_text(RECIPE)
    given = ("--recipe", tmp_path / "r.yaml", "--out", f"{url}/out", "--engine", "ray")
    code, _, said = run("augment", "sample", *given)
    assert (code, "not by URL" in said) == (2, True)


@pytest.fixture
def s3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A server that speaks S3, with a bucket."""
    pytest.importorskip("moto", reason="moto[server] is not installed")
    s3fs = pytest.importorskip("s3fs", reason="s3fs is not installed")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    monkeypatch.setenv("RPAUG_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "test")
    line = [sys.executable, "-m", "moto.server", "-p", str(port)]
    server = subprocess.Popen(line, env=os.environ.copy(), stderr=subprocess.DEVNULL)
    try:
        for _ in range(600):
            with socket.socket() as asked:
                if not asked.connect_ex(("127.0.0.1", port)):
                    break
            time.sleep(0.1)
        s3fs.S3FileSystem().mkdir("bucket")
        yield
    finally:
        server.kill()
        server.wait()


@pytest.mark.usefixtures("s3")
def test_a_run_from_and_to_s3(template: Path, tmp_path: Path) -> None:
    (tmp_path / "r.yaml").write_text(RECIPE)
    made("rlds", template, tmp_path / "data/in")
    same_bytes("s3://bucket", fsspec.filesystem("s3"), "bucket", tmp_path)
