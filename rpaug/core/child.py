"""A fresh process that ends as soon as the one that began it does, be it killed, and while it still loads as well.

Light: loading what a worker does jobs with takes a second, or many where there is other work, and until then nobody
there would look.
"""

import os
import threading
from importlib import import_module
from multiprocessing import parent_process
from typing import Any


def run(module: str, function: str, *given: Any) -> None:
    """Load a module and call its function, with an eye on the parent."""
    parent = parent_process()
    assert parent is not None

    def end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()
    getattr(import_module(module), function)(*given)
