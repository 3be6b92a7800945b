"""Which language model is asked: what options say, else the environment, else a file of the user's own.

The file is `rpaug/llm.toml` in `$XDG_CONFIG_HOME` (`~/.config`), with `url`, `model` and `key`. A key is read from the
environment, or from the file if nobody else may read that; it goes only to the server that stands beside it there.
"""

import os
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import urlsplit

from rpaug.providers.language import Endpoint, LanguageError

URL, MODEL, KEY = "RPAUG_LLM_URL", "RPAUG_LLM_MODEL", "RPAUG_LLM_KEY"
OFF = "off"  # instead of a URL: no model, whatever environment and file say
NAMES = ("url", "model", "key")
KEYLIKE = re.compile(
    r"\b(?:(?:sk|rk|pk|xai|nvapi|pplx)-|(?:gsk|hf|r8|fw|gh[pousr]|github_pat)_|AIza|AKIA|eyJ)[\w-]{16,}"
    r"|(?i:\b(?:key|token|secret|password|bearer)\b)\W{0,3}(?=\S*\d)[\w.-]{20,}"
)
"""What keys of common servers begin with, and long words with digits after a word for a key."""


def path() -> Path:
    """Where the file is, if there is one."""
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(home) / "rpaug" / "llm.toml"


def endpoint(
    url: str | None,
    model: str | None,
    *,
    key_env: str = KEY,
    timeout: float = 60.0,
    price: tuple[float, float] | None = None,
) -> Endpoint | None:
    """The endpoint to ask; None where nothing names one, or `url` is "off".

    `url` and `model` are a command's options. Raises LanguageError where one is given without the other, and for a
    file that is no such file or shows its key to others.
    """
    if url == OFF:
        return None
    kept = _kept()
    found = url or os.environ.get(URL) or kept.get("url")
    named = model or os.environ.get(MODEL) or kept.get("model")
    if not found:
        if model is not None:
            raise LanguageError(f"--model needs the endpoint's URL: --llm, {URL} or {path()}")
        return None
    if not named:
        raise LanguageError(f"--llm needs the model's name: --model, {MODEL} or {path()}")
    key = os.environ.get(key_env) or ("" if _server(found) != _server(kept.get("url")) else None)
    key = kept.get("key", "") if key is None else key
    return Endpoint.of(found, named, key=key, timeout=timeout, price=price)


def refuse_keys(words: str, variables: Iterable[str] = (KEY,)) -> None:
    """Raises LanguageError where words that are kept (a wish) hold a key: one of ours, or what looks like anyone's."""
    keys = [os.environ.get(name, "").strip() for name in variables]
    with_file = [*keys, _kept().get("key", "")]
    if any(key and key in words for key in with_file) or KEYLIKE.search(words):
        raise LanguageError("the words hold a key: leave it out; nothing was asked or written")


def _kept() -> dict[str, str]:
    """What the file says; nothing where there is none."""
    place = path()
    try:
        with place.open("rb") as stream:
            open_to_others = os.name == "posix" and os.fstat(stream.fileno()).st_mode & 0o077
            given = tomllib.load(stream)
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except (OSError, ValueError) as error:  # a parser's words may repeat the key
        why = error.strerror if isinstance(error, OSError) else "no TOML"
        raise LanguageError(f"{place}: {why}") from None
    if set(given) - set(NAMES) or not all(isinstance(one, str) for one in given.values()):
        raise LanguageError(f"{place}: expected texts under {', '.join(NAMES)} alone")
    if "key" in given and open_to_others:
        raise LanguageError(f"{place}: others may read the key; run: chmod 600 {place}")
    return {name: one.strip() for name, one in given.items()}


def _server(url: str | None) -> tuple[str, str]:
    """The scheme and the host with its port."""
    try:
        parts = urlsplit(url or "")
    except ValueError:
        return "", ""
    return parts.scheme, parts.netloc
