"""New things from words or a picture: made by a model of yours, behind a command or an HTTP endpoint, as Gaussians.

Models such as LGM (Tang et al. 2024, arXiv 2402.05054) and GRM (Xu et al. 2024, arXiv 2403.14621) need a GPU and an
environment of their own, so rpaug only asks and checks: what comes back is untrusted until it was read whole.
"""

import base64
import hashlib
import json
import os
import shlex
import signal
import subprocess
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rpaug.assets import library, reading
from rpaug.assets.library import Asset
from rpaug.core.errors import BadInput, RpaugError, Unsupported
from rpaug.core.files import check_image, read_bytes

OUTPUT, IMAGE, TEXT = "{out}", "{image}", "{text}"
MOST_BYTES = 512 << 20  # of a .ply
SECONDS = 600.0
CHUNK = 1 << 16
TOLD = 300  # characters of a failing model's last words that are repeated


@dataclass(frozen=True)
class GenerationRequest:
    """What to make: words, a picture, or both."""

    text: str = ""
    image: Path | None = None

    def check(self) -> None:
        """Raises RpaugError if nothing is wished for, BadInput if the picture is none."""
        if not self.text.strip() and self.image is None:
            raise RpaugError("generate: say what to make, with --text or --image")
        if self.image is not None:
            check_image(self.image, read_bytes(self.image))


@dataclass(frozen=True)
class Limits:
    """How long to wait, and how large an answer to take."""

    seconds: float = SECONDS
    most_bytes: int = MOST_BYTES


def by_command(command: str, wish: GenerationRequest, limits: Limits | None = None) -> bytes:
    """The .ply that a program writes to the file put for `{out}`; `{text}` and `{image}` are put in as well.

    No shell is involved. Raises Unsupported, with the program's last words, if it cannot be started, takes too long,
    fails, or leaves nothing or too much.
    """
    limits = limits or Limits()
    words = shlex.split(command)
    if not words or not any(OUTPUT in word for word in words):
        raise RpaugError(f"--command {command!r}: name where the .ply goes with {OUTPUT}")
    for slot, given in ((TEXT, bool(wish.text)), (IMAGE, wish.image is not None)):
        if any(slot in word for word in words) and not given:
            raise RpaugError(f"--command {command!r}: it takes {slot}, and none was given")
    with tempfile.TemporaryDirectory(prefix="rpaug-generate-") as folder:
        target = Path(folder) / "made.ply"
        filled = {OUTPUT: str(target), TEXT: wish.text, IMAGE: str(wish.image)}
        words = [_put(word, filled) for word in words]
        _run(words, limits.seconds, Path(folder) / "words.txt")
        if not target.is_file():
            raise Unsupported(f"{words[0]}: it ended well but wrote no {OUTPUT}")
        if target.stat().st_size > limits.most_bytes:
            raise Unsupported(_too_large(words[0], target.stat().st_size, limits))
        return read_bytes(target)


def by_endpoint(address: str, wish: GenerationRequest, limits: Limits | None = None) -> bytes:
    """The .ply that an HTTP endpoint answers a POST of JSON with: {"text": ..., "image": base64 or null}.

    Raises Unsupported if nobody answers, the answer takes too long, is no success or too large.
    """
    limits = limits or Limits()
    if urllib.parse.urlsplit(address).scheme not in ("http", "https"):
        raise RpaugError(
            f"--endpoint {address}: give an address that begins with http:// or https://"
        )
    picture = base64.b64encode(read_bytes(wish.image)).decode() if wish.image else None
    body = json.dumps({"text": wish.text, "image": picture}).encode()
    headers = {"Content-Type": "application/json", "Accept": "application/octet-stream"}
    request = urllib.request.Request(address, body, headers)
    end = time.monotonic() + limits.seconds
    try:
        with urllib.request.urlopen(request, timeout=limits.seconds) as answer:
            return _read(answer, address, end, limits)
    except Unsupported:
        raise
    except urllib.error.HTTPError as error:
        stated = error.read(TOLD).decode("utf-8", "replace").strip()
        raise Unsupported(f"{address}: answered {error.code} {error.reason}: {stated}") from None
    except TimeoutError:
        raise Unsupported(_too_long(address, limits.seconds)) from None
    except (urllib.error.URLError, OSError) as error:
        reason = getattr(error, "reason", error)
        if isinstance(reason, TimeoutError):
            raise Unsupported(_too_long(address, limits.seconds)) from None
        raise Unsupported(f"{address}: no answer: {reason}") from None
    except Exception as error:  # http.client raises its own kinds for answers that are not HTTP
        raise Unsupported(f"{address}: a broken answer: {error}") from None


def keep(
    data: bytes,
    name: str,
    wish: GenerationRequest,
    by: str,
    category: str = "thing",
    scale: float = 1.0,
    up: str = "z",
) -> Asset:
    """Check what was made and let it join the library, with where it came from. Raises BadInput."""
    library.check_name(name)
    with tempfile.TemporaryDirectory(prefix="rpaug-generate-") as folder:
        path = Path(folder) / f"{name}.ply"
        path.write_bytes(data)
        try:
            thing, splats = reading.read(path, scale, up)
        except BadInput as error:  # the folder is gone when this is read
            raise BadInput(by, error.field, found=error.found, expected=error.expected) from None
    if splats is None:
        raise BadInput(by, "answer", found="a mesh", expected="a .ply of Gaussians")
    return library.add(name, category, thing, "generated", splats, provenance(data, wish, by))


def provenance(data: bytes, wish: GenerationRequest, by: str) -> Mapping[str, str]:
    """Who made it, of what, and the bytes' own name."""
    facts = {"made by": by, "text": wish.text, "sha256": hashlib.sha256(data).hexdigest()}
    if wish.image is not None:
        facts["image"] = wish.image.name
        facts["image sha256"] = hashlib.sha256(read_bytes(wish.image)).hexdigest()
    return {key: value for key, value in facts.items() if value}


def _put(word: str, filled: Mapping[str, str]) -> str:
    """A word of the command with its slots filled; what was put in is not looked at again."""
    for slot, value in filled.items():
        if slot in word:
            first, last = word.split(slot, 1)
            return _put(first, filled) + value + _put(last, filled)
    return word


def _run(words: list[str], seconds: float, log: Path) -> None:
    """Run a program to its end, its words kept in a file. Raises Unsupported."""
    with log.open("wb") as stated:
        try:
            program = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=stated,
                stderr=stated,
                start_new_session=True,
            )
        except OSError as error:
            raise Unsupported(f"{words[0]}: cannot be started: {error.strerror}") from None
        try:
            code = program.wait(seconds)
        except subprocess.TimeoutExpired:
            raise Unsupported(_too_long(words[0], seconds)) from None
        finally:
            _stop(program)
    if code:
        tail = log.read_bytes()[-TOLD:].decode("utf-8", "replace").strip()
        raise Unsupported(f"{words[0]}: ended with code {code}: {tail or 'it said nothing'}")


def _stop(program: subprocess.Popen) -> None:
    """End the program and what it started, if it still runs."""
    if program.poll() is None:
        os.killpg(program.pid, signal.SIGKILL)
        program.wait()


def _read(answer, address: str, end: float, limits: Limits) -> bytes:
    """An answer's bytes, as they come: a slow sender gets no more time than a silent one."""
    length = answer.headers.get("Content-Length")
    if length is not None and length.isdigit() and int(length) > limits.most_bytes:
        raise Unsupported(_too_large(address, int(length), limits))
    parts, size = [], 0
    while part := answer.read1(CHUNK):
        parts.append(part)
        size += len(part)
        if size > limits.most_bytes:
            raise Unsupported(_too_large(address, size, limits))
        if time.monotonic() > end:
            raise Unsupported(_too_long(address, limits.seconds))
    if length is not None and length.isdigit() and size != int(length):
        raise Unsupported(f"{address}: sent {size} bytes and had promised {length}")
    return b"".join(parts)


def _too_long(who: str, seconds: float) -> str:
    return f"{who}: took longer than {seconds:g} s; --timeout allows more"


def _too_large(who: str, size: int, limits: Limits) -> str:
    return f"{who}: {size} bytes, and {limits.most_bytes} are allowed"
