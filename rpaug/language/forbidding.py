"""What a wish says must not happen: kept while its steps are gathered, and held against the edits at the end."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re

from rpaug.language import declared
from rpaug.language.calling import about, called
from rpaug.language.gathering import WishState, short
from rpaug.language.messages import Entry, NotUnderstood
from rpaug.language.operation import meant

NOT = re.compile(
    r"(?:do not|don't|dont|never|must not|should not|without|not|avoid) (?P<verb>[a-z]+)(?P<rest>[^,;]*)"
    r"|(?P<what>(?:the|all|every|its?) [^,;]*?) (?:must|should|may|shall|can) (?:not|never) be (?P<done>[a-z]+)"
)
KEEP = re.compile(
    r"(?:leave|keep) (?P<what>.+?) (?:alone|as (?:it is|it was|they are|is|recorded)|unchanged|untouched|the same|where (?:it is|they are))"
)
VAGUE = frozenset({"touch", "change", "alter", "edit", "modify", "move", "affect"})
ANY_WORK = frozenset({"anything", "nothing", "it", ""})


def barred(part: str, gathered: WishState) -> bool:
    """Is it a step that says what must not happen? It is kept, to be held against the edits at the end."""
    keep, negated = KEEP.fullmatch(part), NOT.fullmatch(part)
    if keep:
        gathered.barred.append(keep["what"])
        return True
    if negated is None:
        return False
    verb = negated["verb"] or negated["done"]
    rest = (negated["rest"] or negated["what"] or "").strip()
    stem = re.sub(r"(?:ing|ed)$", "", verb)
    known = VAGUE | {_base(word) for word in VAGUE}
    if stem in known or stem + "e" in known:
        gathered.barred.append(rest)
        return True
    for base in (verb, stem, stem + "e", stem[:-1]):
        try:
            found = meant(f"{base} {rest}".strip(), gathered.here())
        except NotUnderstood:
            continue
        gathered.barred += [about(edit) for edit in found.edits]
        return True
    raise NotUnderstood(f"{part!r}: it is not clear what must not happen")


def _base(word: str) -> str:
    return word.removesuffix("e")


def respect(gathered: WishState) -> None:
    """Hold what must not happen against the edits of this wish. Raises NotUnderstood."""
    for what in gathered.barred:
        words = re.sub(
            r"^(?:the|all|any|anything about|of) ", "", re.sub(r"^(?:all )?the ", "", what)
        ).strip()
        if words in ANY_WORK and gathered.fresh:
            raise NotUnderstood("the wish asks for edits and forbids all of them")
        for edit in gathered.fresh:
            own = declared.own_role(edit["op"]) if "op" in edit else None
            if called(words, edit) or _about_all(words, edit) or own == words:
                raise NotUnderstood(
                    f"{what!r} must not change, and the same wish asks for: {short(edit)}"
                )


def _about_all(words: str, edit: Entry) -> bool:
    return "op" in edit and about(edit) == words
