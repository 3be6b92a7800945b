"""What can go wrong, said in one line: where, what was found, and what would have been right."""

import errno
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

MACHINE = {
    errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE,
}  # fmt: skip
"""Numbers of system errors that are no file's fault: what is done next fails alike."""


def of_the_machine(error: BaseException | None) -> OSError | None:
    """What of the machine is behind an error, whatever that was made of on its way: a reader's words about a file that
    could not be opened say nothing of the file."""
    found = MACHINE
    while error is not None:
        if isinstance(error, OSError) and error.errno in found:
            return error
        error, found = error.__context__, MACHINE - {errno.EIO}  # a bad sector is the file's
    return None


def there_are(given: str, known: Iterable[str]) -> str:
    """As `did you mean blue? there are: red, blue`; names that are known, the one first that was meant."""
    names = list(known)
    listed = f"there are: {', '.join(names)}"
    return f"{meant}? {listed}" if (meant := did_you_mean(given, names)) else listed


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """As `did you mean blue`, empty where nothing is close."""
    lower = {name.lower(): name for name in known}
    close = get_close_matches(given.lower(), lower, 1, 0.6)
    return f"did you mean {lower[close[0]]}" if close else ""


class RpaugError(Exception):
    """Base of every error that is meant to be read by a user, never as a traceback."""


class BadInput(RpaugError):
    """A file or a field does not hold what it should.

    Reads as `FILE: FIELD: found FOUND; expected EXPECTED`.
    """

    def __init__(self, where: Path | str, field: str, *, found: object, expected: str) -> None:
        self.where, self.field, self.found, self.expected = str(where), field, found, expected
        super().__init__(f"{where}: {field}: found {found}; expected {expected}")

    def __reduce__(self):  # errors cross process borders
        return (_rebuild, (self.where, self.field, str(self.found), self.expected))


def _rebuild(where: str, field: str, found: str, expected: str) -> BadInput:
    return BadInput(where, field, found=found, expected=expected)


class BadRecipe(RpaugError):
    """A recipe cannot be used; the message names file, line and key."""


class TargetError(RpaugError):
    """A target names nothing, or several things where one was meant; the message lists them."""


class Unsupported(RpaugError):
    """What was asked for cannot be done on this input, with the reason."""


class SourceLacks(Unsupported):
    """What was asked for takes a kind of data that this source has not (depth, poses): no draw would do better."""


class Missing(RpaugError):
    """An episode lacks what an edit is made of, and the recipe says `on_missing: fail`: the run ends."""


class Rejected(RpaugError):
    """A copy is faulty: it fails its gates, its instruction cannot be kept true, or its actions no longer hold."""


class MissingExtra(RpaugError):
    """An optional package is not installed; the message says which extra brings it."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f"{package} is not installed: pip install 'rpaug[{extra}]' brings it")
