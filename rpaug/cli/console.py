"""What all commands share: where they print, how they fail, and the arguments they have in common.

Every command prints for people, or with --json for programs. Exit codes: 0 done; 1 done, but some episodes were
skipped; 2 nothing was done, and one line says why.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from rpaug.core import owner
from rpaug.core.errors import BadInput, RpaugError, of_the_machine
from rpaug.core.visible import visible

RESUME = "the same command with --resume goes on"
console = Console(stderr=True, emoji=False)


def dataset_path(given: str) -> Path:
    """What an argument names: `sample` is the dataset that ships, and of one at a URL a copy is fetched."""
    from rpaug.core import registry

    if "://" not in given:
        return registry.dataset(given)
    from rpaug.core.remote import RemoteFolder  # only here: it brings what images are read with

    return RemoteFolder(given).fetch()


@contextmanager
def written(given: str, resume: bool) -> Iterator[Path]:
    """The folder that a command writes; what is at a URL goes on in its copy, which is sent when the work is done.
    Raises BadInput where something is there that it does not go on with."""
    from rpaug.core.remote import RemoteFolder, is_url
    from rpaug.pipeline import journal, report

    if not is_url(given):
        yield Path(given)
        return
    remote = RemoteFolder(given)
    if remote.is_there():
        if not resume:
            expected = "a new path, or --resume"
            raise BadInput(Path(given), "--out", found="something there already", expected=expected)
        remote.fetch(keep=True)
    yield remote.folder
    if remote.folder.exists():
        remote.send(last=(journal.NAME, report.SUMMARY))  # whoever sees the summary sees all


Dataset = Annotated[
    Path,
    typer.Argument(
        help="Folder or URL of a dataset, or `sample`.",
        show_default=False,
        parser=dataset_path,
        metavar="DATASET",
    ),
]
EpisodeKey = Annotated[str | None, typer.Option(help="Key of one episode; the first if not given.")]
Arms = Annotated[
    list[Path] | None,
    typer.Option("--arm", help="URDF or MJCF file of the robot's arm; may be given several times."),
]
UsedModels = Annotated[
    list[str] | None,
    typer.Option(
        "--models",
        help="A model by folder or hub id, as text=NAME; also instances, depth, inpaint, poses, device. May be given "
        "several times; off: none but the recipe's.",
    ),
]
Licence = Annotated[
    str | None, typer.Option(help="Of the source, for the dataset card, where it states none.")
]
Llm = Annotated[
    str | None,
    typer.Option(
        "--llm",
        help="URL of an OpenAI-compatible endpoint; `off`: none, whatever environment and llm.toml say.",
    ),
]
ModelName = Annotated[str | None, typer.Option(help="Name of the model to ask there.")]
KeyVariable = Annotated[
    str, typer.Option(help="Environment variable that holds the endpoint's key.")
]
Patience = Annotated[float, typer.Option(min=0.1, help="Seconds for one answer of the endpoint.")]
Price = Annotated[
    tuple[float, float] | None,
    typer.Option(help="Cost of a million tokens in and out, to report the cost."),
]


class DeviceChoice(Enum):
    """What an option `--device` takes; `rpaug.core.devices` says what it means on this machine."""

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"


OnDevice = Annotated[
    DeviceChoice,
    typer.Option(
        "--device",
        help="What fits Gaussians and edits appearance: auto takes a CUDA GPU where there is one, and says why if not.",
    ),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON value on stdout, nothing else.")
]


def guarded(command: Callable[..., int]) -> Callable[..., None]:
    """Expected failures become one line and exit code 2; a bug of ours says so, and how to see it."""

    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        again = f"; {RESUME}" if "resume" in kwargs else ""
        try:
            _there(kwargs.get("dataset"))
            with owner.ends_like_ctrl_c():
                code = command(*args, **kwargs)
        except (RpaugError, OSError) as error:
            machine = of_the_machine(error)
            words = f"{_words(machine)}{again}" if machine else _words(error)
            code = fail(words, kwargs.get("as_json", False))
        except KeyboardInterrupt:
            words = f"stopped; what is in an output folder is whole{again}"
            code = fail(words, kwargs.get("as_json", False))
        except (typer.Exit, typer.Abort):
            raise
        except Exception as error:
            if os.environ.get("RPAUG_DEBUG"):
                raise
            name = type(error).__name__
            code = fail(
                f"a fault in rpaug ({name}: {error}); RPAUG_DEBUG=1 shows where",
                kwargs.get("as_json", False),
            )
        raise typer.Exit(code)

    return run


def _words(error: Exception) -> str:
    if not isinstance(error, OSError):
        return str(error)
    place = f"{error.filename}: " if error.filename else ""
    return f"{place}{error.strerror or error}"


def _there(dataset: Path | None) -> None:
    """See that a dataset is there before what could read it is imported. Raises BadInput."""
    if dataset is not None and not dataset.exists():
        raise BadInput(
            dataset, "dataset", found="no such folder", expected="the folder of a dataset"
        )


def fail(message: str, as_json: bool) -> int:
    if as_json:
        print_json({"error": message})
    else:
        console.print(f"[bold red]error[/] {plain(message)}", highlight=False, soft_wrap=True)
    return 2


def warn(label: str, words: str) -> None:
    """One line beside the output: what was skipped, or is worth knowing."""
    console.print(f"[yellow]{label}[/] {plain(words)}", highlight=False, soft_wrap=True)


def plain(text: str) -> str:
    """The text as rich shows it: no markup, and no control characters for the terminal."""
    return visible(text).replace("[", r"\[")


def print_json(value: Any) -> None:
    sys.stdout.write(json.dumps(value, indent=1) + "\n")  # ASCII: no terminal obeys any of it


def counted(number: int, noun: str) -> str:
    """As `1 episode`, `2 episodes`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def say(line: str) -> None:
    """One line on stdout, never wrapped."""
    Console(emoji=False).print(plain(line), highlight=False, soft_wrap=True)


def read_episode(dataset: Path, key: str | None) -> Any:
    """The episode of that key, the first if None. Raises BadInput."""
    from rpaug.core import registry

    adapter = registry.adapter_for(dataset)
    keys = adapter.episodes(dataset)
    if key is not None and key not in keys:
        raise BadInput(dataset, "--episode", found=key, expected=f"one of: {', '.join(keys[:20])}")
    return adapter.read(dataset, key if key is not None else keys[0])


def write_new(path: Path, data: bytes) -> None:
    from rpaug.core.files import write_atomic

    if path.exists():
        raise BadInput(
            path, "output", found="something there already", expected="a path that does not exist"
        )
    write_atomic(path, data)
