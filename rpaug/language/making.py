"""Asset management: new things are searched in the library, and what it lacks is made by a generator, if there is one.

The generator is a program or an HTTP endpoint of the user's (`rpaug.assets.generate`). What it makes joins the library
under a name of its own, and the recipe asks for that name: it runs again without the generator.
"""

import re
import shlex
import urllib.parse
from collections.abc import Iterator
from dataclasses import dataclass, field

from rpaug.assets import generate, library
from rpaug.assets.library import Asset
from rpaug.core import color_space
from rpaug.core.errors import RpaugError, TargetError
from rpaug.language.messages import Entry, Trace

MADE = "made"  # before the names of things that were made for a wish


class NotMade(RpaugError):
    """The generator gave nothing that can be used; the message says why."""


@dataclass(frozen=True)
class Maker:
    """Who makes things of words: a command with {text} and {out}, or the address of an endpoint.

    `scale` is metres to one unit of what is made, `up` its upward axis.
    """

    who: str
    scale: float = 1.0
    up: str = "z"
    limits: generate.Limits = field(default_factory=generate.Limits)

    @property
    def called(self) -> str:
        """The maker without what may be secret: a command's options, an address's user and query."""
        if not self._remote:
            words = shlex.split(self.who)
            plain = next((k for k, w in enumerate(words) if k and w[:1] in "-{"), len(words))
            return " ".join(words[:plain])
        parts = urllib.parse.urlsplit(self.who)
        port = f":{parts.port}" if parts.port else ""
        return f"{parts.scheme}://{parts.hostname}{port}{parts.path}"

    def __call__(self, text: str, name: str, category: str) -> Asset:
        """Make a thing and let it join the library. Raises NotMade; then nothing joined."""
        wish = generate.GenerationRequest(text)
        ask = generate.by_endpoint if self._remote else generate.by_command
        try:
            library.check_name(name)
            data = ask(self.who, wish, self.limits)
            return generate.keep(data, name, wish, self.called, category, self.scale, self.up)
        except RpaugError as error:
            reason = str(error).replace(self.who, self.called)
            raise NotMade(f"the library has no {text!r}, and making it failed: {reason}") from None

    @property
    def _remote(self) -> bool:
        return urllib.parse.urlsplit(self.who).scheme in ("http", "https")


def lacking(edit: Entry) -> bool:
    """Does an edit put in a kind of thing, or a color of it, that the library has not?"""
    if edit.get("op") != "insert" or edit.get("asset"):
        return False
    try:
        library.find(edit.get("category"), edit.get("color"))
    except TargetError:
        return True
    return False


def named(edit: Entry) -> tuple[str, str]:
    """What to make for such an edit, in words, and the name that it gets."""
    words = [word for word in (edit.get("color"), edit.get("category")) if isinstance(word, str)]
    slug = "_".join(re.findall(r"[a-z0-9]+", " ".join([*words[1:], *words[:1]]).lower()))
    first = color_space.canonical(words[0]) or words[0]
    article = "an" if first[:1] in "aeiou" else "a"
    return f"{article} {' '.join(words)}", f"{MADE}_{slug}"


def provided(edits: tuple[Entry, ...], maker: Maker | None) -> Iterator[tuple[Entry, Trace | None]]:
    """Every edit, where the library lacks its thing with one that was made, once for all that ask alike.

    Beside it stands what was done, None where the library had it. Raises NotMade.
    """
    wanted = [any(map(lacking, edit.get("one_of", [edit]))) for edit in edits]
    for edit, missing in zip(edits, wanted, strict=True):
        options = edit.get("one_of")
        if maker is None or not missing:
            yield edit, None
            continue
        if options is not None:
            text, _ = named(next(one for one in options if lacking(one)))
            raise NotMade(
                f"the library has no {text!r}; ask for it without `either`, so that it is made"
            )
        text, name = named(edit)
        known = [one for one in library.assets() if one.name == name]
        asset = known[0] if known else maker(text, name, str(edit.get("category")))
        rest = {key: value for key, value in edit.items() if key not in ("category", "color", "op")}
        output = {"asset": asset.name, "made": not known, "provenance": dict(asset.provenance)}
        by = maker.called
        yield (
            {"op": "insert", "asset": name, **rest},
            Trace(stage="assets", by=by, input=edit, output=output, prompt={"text": text}),
        )
