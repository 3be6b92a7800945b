"""The preview for editing: the page, and the frames it asks for, on this machine alone.

The server listens on 127.0.0.1 and answers only requests that name this place as their host and origin: no other
machine, and no page of another site in the same browser, can ask it for anything.
"""

import json
import time
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock
from typing import Any
from urllib.parse import parse_qs, urlsplit

from rpaug.core import memo, progress, registry, safe_yaml
from rpaug.core.errors import BadInput, RpaugError
from rpaug.pages import preview
from rpaug.pages.rehearsal import GivenUp, Rehearsal
from rpaug.pages.session import Session
from rpaug.pipeline import recipe as recipes
from rpaug.pipeline.recipe import Recipe

HOST = "127.0.0.1"
MOST_BYTES = 2**20  # of a request
MOST_COPIES = 10_000
MOST_VALUES = 20_000  # in a field that is written as YAML
SESSIONS = 3  # episodes that are kept
KEPT_ANSWERS = (
    8  # of scenes that differ in what a recipe's edits did to them: changes go back and forth
)
WRITTEN = "$yaml"
"""The key of a value that the form's user wrote as text: it is read as YAML."""


class Server(ThreadingHTTPServer):
    """Serves one dataset's preview at `url`. It draws for one request at a time, and tries ordinary edits while there
    is none; what a browser opens ahead and leaves silent holds up no other. `stage` says what is being done."""

    def __init__(self, root: Path, recipe: Recipe, key: str | None, port: int) -> None:
        self.root, self.recipe = root, recipe
        self.keys = list(registry.adapter_for(root).episodes(root))
        if key is not None and key not in self.keys:
            expected = f"one of: {', '.join(self.keys[:20])}"
            raise BadInput(root, "episode", found=key, expected=expected)
        self.first = self.keys.index(key) if key is not None else 0
        self._sessions: OrderedDict[str, Session] = OrderedDict()
        self._lock, self.stage, self._rehearsal = Lock(), "", Rehearsal()
        memo.keep(KEPT_ANSWERS)
        super().__init__((HOST, port), _Handler)
        if self.keys:
            self._rehearsal.follow(self.session(self.keys[self.first]), recipe)

    @property
    def url(self) -> str:
        """Where a browser finds it."""
        return f"http://{HOST}:{self.server_port}/"

    def session(self, key: str) -> Session:
        """The session of an episode, one of the last few. Raises BadInput for an unknown key."""
        if key not in self.keys:
            raise BadInput(self.root, "episode", found=key, expected="one of the dataset's")
        with self._lock:
            found = self._sessions.pop(key, None) or Session(self.root, key)
            self._sessions[key] = found
            while len(self._sessions) > SESSIONS:
                self._sessions.popitem(last=False)
        return found

    def page(self) -> bytes:
        """The page, without any image yet; with the episodes that are there now."""
        self.keys = list(registry.adapter_for(self.root).episodes(self.root))
        data = {
            "served": True,
            "notes": preview.unfinished(self.root),
            "keys": self.keys,
            "first": self.first,
            "recipe": self.recipe.source,
            "yaml": preview.text(self.recipe.source),
            "schema": recipes.schema(),
        }
        return preview.built(data)

    def episode(self, key: str) -> dict[str, Any]:
        """What was recorded, with the first frame: at once, before anything is looked for."""
        session = self.session(key)
        return {**_paged(session.recorded()), "before": session.before([0])}

    def found(self, key: str) -> dict[str, Any]:
        """The same with what was found in it, when that is known."""
        session = self.session(key)
        with self._rehearsal.asked():
            described = session.describe()
        self._rehearsal.follow(session, self.recipe)
        return _paged(described)

    def recorded(self, key: str, frame: int) -> dict[str, Any]:
        """The recorded images of a frame. Raises RpaugError."""
        session = self.session(key)
        return {"before": session.before([_frame(session, frame)])}

    def hear(self, told: progress.Told) -> None:
        """Remember what is being done."""
        share = f", {told['done']} of {told['total']}" if told["total"] else ""
        self.stage = "" if told["stage"] == progress.FINISHED else f"{told['stage']}{share}"

    def drawn(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """One frame of one copy under the form's recipe, with the seconds it took. Raises RpaugError."""
        start = time.perf_counter()
        session, recipe, copy = self._copy(asked)
        with self._rehearsal.asked():
            self.stage = ""
            _ = session.found
            t = _frame(session, int(asked["frame"]))
            made = session.drawn(recipe, copy, [t], judged=False)
            before = session.before([t])
        self.recipe = recipe
        taken = round(time.perf_counter() - start, 2)
        return {
            "draw": made,
            "before": before,
            "yaml": preview.text(recipe.source),
            "seconds": taken,
        }

    def judged(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """What gates say of that copy over all frames, as a run judges it, and whether it was drawn again; nothing
        where something else is asked for meanwhile. Raises RpaugError."""
        session, recipe, copy = self._copy(asked)
        with suppress(GivenUp), self._rehearsal.spare() as see:
            shown = session.judged(recipe, copy, see)
            return {**shown.verdict(), "again": bool(shown.failed)}
        return {"judged": False}

    def _copy(self, asked: Mapping[str, Any]) -> tuple[Session, Recipe, int]:
        """Which copy of which episode is asked for, under which recipe. Raises RpaugError."""
        recipe = recipes.build(_read(asked["recipe"]))
        session, copy = self.session(asked["episode"]), int(asked["copy"])
        if not 1 <= copy <= MOST_COPIES:
            raise RpaugError(f"copy {copy}: expected 1 to {MOST_COPIES}")
        return session, recipe, copy

    def server_close(self) -> None:
        """Free the port."""
        super().server_close()
        self._rehearsal.end()


def _paged(described: dict[str, Any]) -> dict[str, Any]:
    """What a page asks for frame by frame."""
    return {**described, "frames": list(range(described["length"])), "single": True}


def _frame(session: Session, t: int) -> int:
    """Raises RpaugError where there is no such frame."""
    if not 0 <= t < session.episode.length:
        raise RpaugError(f"frame {t}: no such frame; expected 0 to {session.episode.length - 1}")
    return t


@contextmanager
def server(root: Path, recipe: Recipe, key: str | None, port: int) -> Iterator[Server]:
    """A server, whose port is free again afterwards. Raises BadInput for an unknown key, or a port that is taken."""
    try:
        made = Server(root, recipe, key, port)
    except OSError as error:
        found = str(error.strerror or error)
        raise BadInput("--port", str(port), found=found, expected="a free port, or 0") from None
    try:
        with progress.heard(made.hear):
            yield made
    finally:
        made.server_close()


def _read(given: Any) -> Any:
    """Plain data, in which what the user wrote as text is read as YAML. Raises RpaugError."""
    if isinstance(given, dict) and set(given) == {WRITTEN}:
        try:
            return safe_yaml.load(str(given[WRITTEN]).encode(), MOST_VALUES)[0]
        except safe_yaml.NotPlain as error:
            raise RpaugError(f"{given[WRITTEN]!r:.60}: {error}") from None
    if isinstance(given, dict):
        return {name: _read(value) for name, value in given.items()}
    return [_read(one) for one in given] if isinstance(given, list) else given


class _Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        """The page, or what is known of an episode."""
        parts = urlsplit(self.path)
        given = {name: values[0] for name, values in parse_qs(parts.query).items()}
        if not self._ours():
            self._answer(403, b"not from here", "text/plain")
        elif parts.path == "/":
            self._answer(200, self.server.page(), "text/html; charset=utf-8")
        elif parts.path == "/doing":
            self._told(lambda: {"doing": self.server.stage})
        elif parts.path == "/episode":
            self._told(lambda: self.server.episode(given["key"]))
        elif parts.path == "/found":
            self._told(lambda: self.server.found(given["key"]))
        elif parts.path == "/recorded":
            self._told(lambda: self.server.recorded(given["key"], int(given["frame"])))
        else:
            self._answer(404, b"no such page", "text/plain")

    def do_POST(self) -> None:
        """A frame under a recipe, or what gates say of the copy."""
        work = {"/draw": self.server.drawn, "/judge": self.server.judged}
        asked = work.get(urlsplit(self.path).path)
        size = self.headers.get("Content-Length", "")
        if not self._ours():
            self._answer(403, b"not from here", "text/plain")
        elif asked is None:
            self._answer(404, b"no such page", "text/plain")
        elif not size.isdecimal() or int(size) > MOST_BYTES:
            self._answer(413, b"too long", "text/plain")
        else:
            data = self.rfile.read(int(size))
            self._told(lambda: asked(json.loads(data)))

    def _ours(self) -> bool:
        """Whether the request names this server as its host, and its page as where it comes from."""
        own = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
        origin = self.headers.get("Origin")
        return self.headers.get("Host") in own and (
            origin is None or origin.removeprefix("http://") in own
        )

    def _told(self, work: Any) -> None:
        """The answer as JSON; what is wrong is told in words."""
        try:
            code, told = 200, work()
        except RpaugError as error:
            code, told = 400, {"error": str(error)}
        except (ValueError, KeyError, TypeError) as error:
            code, told = (
                400,
                {"error": f"not a request of this page ({type(error).__name__}: {error})"},
            )
        self._answer(code, json.dumps(told).encode(), "application/json")

    def _answer(self, code: int, data: bytes, kind: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        with suppress(ConnectionError):  # a page that was closed or loaded anew waits no more
            self.end_headers()
            self.wfile.write(data)

    def log_message(self, *_: Any) -> None:
        """Say nothing: the terminal is for what goes wrong."""
