"""`rpaug models`, against a server that answers as the Hugging Face Hub does."""

import hashlib
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import tiny_models

COMMIT = "a" * 40


@dataclass(frozen=True)
class Ended:
    code: int
    text: str


def rpaug(*arguments: str) -> Ended:
    """In a process of its own: the hub's package reads its environment once."""
    command = [sys.executable, "-m", "rpaug", *arguments]
    made = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert "Traceback" not in made.stderr, made.stderr
    return Ended(made.returncode, made.stdout + (made.stderr if made.returncode else ""))


class Hub(BaseHTTPRequestHandler):
    """Serves the folder of each repository: its card, its list of files, and the files."""

    folders: dict[str, Path]

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_GET(self) -> None:
        path = self.path.split("?")[0].strip("/")
        for name, folder in self.folders.items():
            if path.startswith(f"api/models/{name}/tree/"):
                return self._tree(folder)
            if path.startswith(f"api/models/{name}"):
                return self._card(name, folder)
            for revision in ("main", COMMIT):
                if path.startswith(f"{name}/resolve/{revision}/"):
                    return self._file(folder / path.split("/", 4)[4])
        return self._answer(404, b"{}", {"X-Error-Code": "RepoNotFound"})

    def _card(self, name: str, folder: Path) -> None:
        files = [
            {"rfilename": path.name, "size": path.stat().st_size, "blobId": _digest(path)}
            for path in sorted(folder.iterdir())
        ]
        config = json.loads((folder / "config.json").read_text())
        said = {
            "id": name, "modelId": name, "sha": COMMIT, "private": False, "siblings": files, "tags": [],
            "cardData": {"license": "apache-2.0"}, "config": {"model_type": config.get("model_type")},
        }  # fmt: skip
        self._answer(200, json.dumps(said).encode(), {"Content-Type": "application/json"})

    def _tree(self, folder: Path) -> None:
        files = [
            {"type": "file", "path": path.name, "size": path.stat().st_size, "oid": _digest(path)}
            for path in sorted(folder.iterdir())
        ]
        self._answer(200, json.dumps(files).encode(), {"Content-Type": "application/json"})

    def _file(self, path: Path) -> None:
        if not path.is_file():
            return self._answer(404, b"", {"X-Error-Code": "EntryNotFound"})
        etag = f'"{_digest(path)}"'
        return self._answer(200, path.read_bytes(), {"ETag": etag, "X-Repo-Commit": COMMIT})

    def _answer(self, code: int, body: bytes, headers: dict[str, str]) -> None:
        self.send_response(code)
        for key, value in {**headers, "Content-Length": str(len(body))}.items():
            self.send_header(key, value)
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(body)

    def log_message(self, *given: object) -> None:
        pass


def _digest(path: Path) -> str:
    return hashlib.sha1(path.read_bytes()).hexdigest()


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Path]]:
    folders = {
        "lab/dino": tiny_models.saved("grounding-dino", tmp_path / "dino"),
        "lab/pickled": tiny_models.saved("sam2", tmp_path / "pickled"),
        "lab/words": tiny_models.saved("owlv2", tmp_path / "words"),
    }
    (tmp_path / "pickled" / "model.safetensors").rename(tmp_path / "pickled" / "pytorch_model.bin")
    config = json.loads((tmp_path / "words" / "config.json").read_text()) | {"model_type": "bert"}
    (tmp_path / "words" / "config.json").write_text(json.dumps(config))
    (tmp_path / "dino" / "run_me.py").write_text("raise SystemExit")
    handler = type("Served", (Hub,), {"folders": folders})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{server.server_port}")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "home"))
    yield folders
    server.shutdown()


def test_a_model_is_fetched_when_asked_and_found_afterwards(hub: dict[str, Path]) -> None:
    before = rpaug("models", "check", "lab/dino")
    assert before.code == 2
    assert "nothing is fetched unasked: rpaug models pull lab/dino" in before.text
    asked = rpaug("models", "pull", "lab/dino", "--yes")
    assert asked.code == 0, asked.text
    assert "licence: apache-2.0, for models: text" in asked.text
    fetched = sorted(
        path.name for path in Path(asked.text.split("fetched to ")[1].strip()).iterdir()
    )
    assert "model.safetensors" in fetched
    assert "run_me.py" not in fetched
    listed = rpaug("models", "ls")
    assert "lab/dino" in listed.text
    assert "1 model" in listed.text
    checked = rpaug("models", "check", "lab/dino", "--json")
    assert checked.code == 0, checked.text
    assert json.loads(checked.text)["uses"] == ["text"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("lab/pickled", "weights in pickles could run code"),
        ("lab/words", "model_type 'bert', which rpaug does not use"),
        ("lab/nothing", "lab/nothing: "),
    ],
)
def test_what_is_no_model_for_a_recipe_is_not_fetched(
    name: str, said: str, hub: dict[str, Path], tmp_path: Path
) -> None:
    found = rpaug("models", "pull", name, "--yes")
    assert found.code == 2
    assert said in found.text
    assert not list((tmp_path / "home").rglob("*.safetensors"))


def test_a_folder_is_checked_by_itself(tmp_path: Path) -> None:
    folder = tiny_models.saved("sam3_video", tmp_path)
    found = rpaug("models", "check", str(folder))
    assert found.code == 0, found.text
    assert "for models: text, instances" in found.text
    (folder / "model.safetensors").unlink()
    spoilt = rpaug("models", "check", str(folder))
    assert spoilt.code == 2
    assert "Traceback" not in spoilt.text
