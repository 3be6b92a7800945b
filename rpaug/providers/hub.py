"""Models by name: a local folder in transformers' layout, or one of the Hugging Face Hub that was pulled before.

Nothing is fetched unless `pull` is asked to. Only safetensors and plain text are: weights in pickles are refused.
"""

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput, MissingExtra, RpaugError, Unsupported

EXTRA = "models"
ID = re.compile(
    r"[A-Za-z0-9][\w.-]*/[A-Za-z0-9][\w.-]*(?:@[\w.-]+)?"
)  # owner/name, a revision after it
TAKEN = ("*.json", "*.safetensors", "*.txt", "*.model")  # of a repository; no pickle, no code
MOST_JSON = 2**20  # bytes of a config that is read


@dataclass(frozen=True)
class HubModel:
    """What the hub or its local copy says of a model: bytes to fetch or held, and its licence ("" for unknown)."""

    name: str
    model_type: str
    bytes: int
    licence: str
    folder: Path | None = None


def folder(name: str) -> Path:
    """Where a model's files lie. Raises Unsupported where they do not, with what would bring them; MissingExtra."""
    if Path(name).is_dir():
        return Path(name)
    if not ID.fullmatch(name) or name.startswith((".", "/")):
        raise Unsupported(
            f"{name}: no model there: expected a folder in transformers' layout, or an id of the hub (owner/name)"
        )
    hub, (repository, revision) = _hub(), _parts(name)
    try:
        found = hub.snapshot_download(
            repository, revision=revision, allow_patterns=TAKEN, local_files_only=True
        )
    except hub.errors.LocalEntryNotFoundError:
        raise Unsupported(
            f"{name}: not on this machine, and nothing is fetched unasked: rpaug models pull {name}"
        ) from None
    return Path(found)


def config(place: Path) -> dict[str, Any]:
    """The `config.json` in a folder. Raises Unsupported where none can be read."""
    path = place / "config.json"
    if not path.is_file():
        raise Unsupported(f"{place}: no model there (no config.json)")
    try:
        if path.stat().st_size > MOST_JSON:
            raise ValueError("it is larger than 1 MB")
        made = json.loads(path.read_text())
        if not isinstance(made, dict):
            raise ValueError("it is no mapping")
    except (OSError, ValueError, RecursionError) as error:
        raise Unsupported(f"{path}: no configuration of a model: {error}") from None
    return made


def told(name: str) -> HubModel:
    """What the hub says of a model, without fetching it. Raises RpaugError if it cannot be asked."""
    hub, (repository, revision) = _hub(), _parts(name)
    try:
        found = hub.HfApi().model_info(repository, revision=revision, files_metadata=True)
    except Exception as error:  # the hub's client raises whatever its transport does
        raise RpaugError(f"{name}: {_why(error)}") from None
    files = {one.rfilename: one.size or 0 for one in found.siblings or ()}
    taken = hub.utils.filter_repo_objects(files, allow_patterns=list(TAKEN))
    taken = list(taken)
    if not any(file.endswith(".safetensors") for file in taken):
        raise BadInput(
            name,
            "weights",
            found=", ".join(sorted(files)) or "no file",
            expected="*.safetensors (weights in pickles could run code)",
        )
    card = found.card_data.to_dict() if found.card_data else {}
    kind = (found.config or {}).get("model_type", "")
    licence = card.get("license_name") or card.get("license") or ""
    return HubModel(name, str(kind), sum(files[file] for file in taken), str(licence))


def pull(name: str) -> HubModel:
    """Fetch a model into the hub's own cache (`HF_HOME`). Raises RpaugError."""
    said, hub, (repository, revision) = told(name), _hub(), _parts(name)
    try:
        found = hub.snapshot_download(repository, revision=revision, allow_patterns=list(TAKEN))
    except Exception as error:  # as above
        raise RpaugError(f"{name}: {_why(error)}") from None
    kind = str(config(Path(found)).get("model_type", ""))
    return HubModel(name, kind, said.bytes, said.licence, Path(found))


def pulled() -> list[HubModel]:
    """The models in the hub's cache that say what they are, by name."""
    hub = _hub()
    try:
        cache = hub.scan_cache_dir()
    except hub.errors.CacheNotFound:
        return []
    out = []
    for repository in cache.repos:
        if repository.repo_type != "model":
            continue
        for revision in repository.revisions:
            try:
                kind = str(config(revision.snapshot_path).get("model_type", ""))
            except Unsupported:
                continue
            refs = sorted(revision.refs)
            at = "" if "main" in refs else f"@{refs[0] if refs else revision.commit_hash}"
            place = revision.snapshot_path
            out.append(
                HubModel(f"{repository.repo_id}{at}", kind, revision.size_on_disk, "", place)
            )
    return sorted(out, key=lambda one: one.name)


def _parts(name: str) -> tuple[str, str | None]:
    repository, _, revision = name.partition("@")
    return repository, revision or None


def _why(error: Exception) -> str:
    """An error's first line that says something."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


def _hub() -> Any:
    """The hub's package. Raises MissingExtra."""
    try:
        import huggingface_hub as package
        import huggingface_hub.errors
    except ImportError:
        raise MissingExtra("huggingface_hub", EXTRA) from None
    os.environ.setdefault("HF_HUB_DISABLE_TELEMETRY", "1")
    return package
