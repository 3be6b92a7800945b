"""A local HTTP server that plays an OpenAI-compatible endpoint, well-behaved or not."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from rpaug.providers import negotiation
from rpaug.providers.language import Endpoint

KEY = "sk-very-secret-0123"


def completion(content: Any, **usage: int) -> bytes:
    choice = {"message": {"role": "assistant", "content": content}}
    return json.dumps({"choices": [choice], "usage": usage}).encode()


class Handler(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.seen.append((dict(self.headers), json.loads(body)))  # type: ignore[attr-defined]
        self.server.play(self, len(self.server.seen))  # type: ignore[attr-defined]

    def answer(self, data: bytes, status: int = 200, **headers: str) -> None:
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *args: object) -> None:
        pass


@contextmanager
def served(
    play: Callable[[Handler, int], None], timeout: float = 5.0
) -> Iterator[tuple[Endpoint, list]]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    negotiation.TAKEN.clear()  # another server may have had this port
    server.seen, server.play = [], play  # type: ignore[attr-defined]
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    try:
        url = f"http://127.0.0.1:{server.server_port}/v1"
        yield Endpoint(url, "small", KEY, timeout, (1.0, 2.0)), server.seen  # type: ignore[attr-defined]
    finally:
        server.shutdown()
        server.server_close()
