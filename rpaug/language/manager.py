"""A whole wish into steps, each taken in turn: the longest beginning that means something, then the rest."""

import re
from collections.abc import Iterator, Sequence

from rpaug.language import phrasing
from rpaug.language.forbidding import barred, respect
from rpaug.language.gathering import WishState, take
from rpaug.language.grounding import ARTICLES
from rpaug.language.messages import Answer, Entry, Meant, NotUnderstood, Trace, Wish
from rpaug.language.operation import meant
from rpaug.language.settings import chance, settings
from rpaug.language.undoing import RESTART, UNDO, undo
from rpaug.language.verbs import POLITE, THANKS

MOST_STEPS = 30
FIRST = re.compile(rf"^(?:{POLITE}\b[, ]*)+")
AFTER = re.compile(rf"(?:[, ]+{THANKS})+$")
BREAK = re.compile(
    r"(?:\s*[;.]\s+|\s*;\s*|,? and then |, then | then |,? but |,? (?=without )"
    r"|,? while (?:also )?(?=[a-z]+ing )|, and |, | and (?:also )?)"
)


def answer(wish: Wish) -> Answer:
    """What a wish comes to, by the grammar. Raises NotUnderstood, and then nothing of the wish holds."""
    text = normal(wish.stated)
    if not text:
        raise NotUnderstood("nothing was said")
    text, found = settings(text)
    known = dict(wish.settings) | found
    gathered = WishState(wish, list(wish.edits), known, wish.mention, did=bool(found))
    if text:
        _run(text, gathered)
    respect(gathered)
    if not gathered.did or not (gathered.edits or gathered.wish.edits):
        raise NotUnderstood(f"{wish.stated!r}: that asks for no change, so there is nothing to do")
    steps = [one.input for one in gathered.trace if one.stage != "phrasing"]
    whole = Trace(
        stage="manager", by="grammar", input=wish.stated, output={"steps": steps, "settings": found}
    )
    return Answer(
        edits=tuple(gathered.edits),
        settings=gathered.settings,
        mention=gathered.mention,
        notes=tuple(gathered.notes),
        trace=(whole, *gathered.trace),
    )


def normal(stated: str) -> str:
    """Lower case, single spaces, no politeness, no mark at the end."""
    text = re.sub(r"[’`]", "'", stated.lower())
    text = re.sub(r"\s+", " ", text).strip().rstrip("?!. ")
    return phrasing.plain(AFTER.sub("", FIRST.sub("", text))).strip()


def _run(text: str, gathered: WishState) -> None:
    """Take the longest beginning that is one step, then go on with the rest. Raises NotUnderstood."""
    verb, steps = "", 0
    while text:
        steps += 1
        if steps > MOST_STEPS:
            raise NotUnderstood(f"more than {MOST_STEPS} steps: say them in several wishes")
        reason: NotUnderstood | None = None
        for part, rest in _beginnings(text):
            try:
                verb = _step(part, verb, gathered)
            except NotUnderstood as error:
                reason = error  # that of the shortest beginning tells most
                continue
            text = rest
            break
        else:
            assert reason is not None
            raise reason


def _beginnings(text: str) -> Iterator[tuple[str, str]]:
    """The text as a whole, and then every shorter beginning with what remains, the longest first."""
    yield FIRST.sub("", text), ""
    for match in reversed(list(BREAK.finditer(text))):
        part, rest = text[: match.start()].strip(" ,;."), text[match.end() :].strip(" ,;.")
        if part and rest:
            yield FIRST.sub("", part), FIRST.sub("", rest) if "but" not in match.group() else rest


def _step(part: str, verb: str, gathered: WishState) -> str:
    """One step; returns its verb, which the next may leave out. Raises NotUnderstood and then changes nothing."""
    if RESTART.fullmatch(part):
        gathered.edits, gathered.fresh, gathered.mention, gathered.did = [], [], None, True
        return ""
    for order in phrasing.orders(part):
        if back := UNDO.fullmatch(order):
            undo(back["what"], gathered)
            return ""
    if barred(part, gathered):
        return verb
    either = re.fullmatch(r"either (.+?),? or (.+)", part)
    if either:
        take(_alternatives([either[1], either[2]], gathered), None, gathered)
        return ""
    part, share = chance(part)
    try:
        found = meant(part, gathered.here())
    except NotUnderstood:
        if not verb or not re.match(r"(?:the|its?|all|every|both|a|an|\d+|object|handle)\b", part):
            raise
        found = meant(f"{verb} {part}", gathered.here())
    take(found, share, gathered)
    output = {"edits": list(found.edits), "notes": list(found.notes)}
    if found.order != part:
        put = Trace(stage="phrasing", by="grammar", input=part, output=found.order)
        gathered.trace.append(put)
    gathered.trace.append(Trace(stage=found.stage, by="grammar", input=part, output=output))
    own = found.order.split(" ")[0]
    return "" if own in ARTICLES else own


def _alternatives(parts: Sequence[str], gathered: WishState) -> Meant:
    options: list[Entry] = []
    for part in parts:
        found = meant(FIRST.sub("", part), gathered.here())
        if len(found.edits) != 1 or found.replaces:
            raise NotUnderstood(f"{part!r} is no single edit, and `either` draws one of two")
        options += found.edits[0].get("one_of", found.edits)
    return Meant(edits=({"one_of": options},))
