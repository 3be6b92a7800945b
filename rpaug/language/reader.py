"""One clause as edits: the first way of changing a scene by whose words and values every token is accounted for."""

from rpaug.core.errors import RpaugError
from rpaug.language import lights, looks, placing, templates, viewing
from rpaug.language.messages import Meant, NotUnderstood, Wish
from rpaug.language.things import Namer
from rpaug.language.tokens import Clause, Token

WAYS = (
    placing.physics,
    lights.sensor,
    viewing.camera_pose,
    looks.replaced,
    looks.swapped,
    lights.light,
    placing.duplicate,
    placing.remove,
    placing.object_size,
    placing.spread,
    placing.distractors,
    placing.insert,
    placing.move,
    looks.shade,
    looks.painted,
)


def read(tokens: list[Token], wish: Wish, namer: Namer) -> Meant:
    """The edits of a clause. Raises RpaugError with what of it is not understood, and the nearest that would be."""
    reason: RpaugError | None = None
    for way in WAYS:
        clause, notes = Clause(list(tokens)), len(namer.notes)
        try:
            if (found := way(clause, wish, namer)) is not None:
                clause.done()
                return found
        except RpaugError as error:
            reason = reason or error
        del namer.notes[notes:]
    if reason is not None and not isinstance(reason, NotUnderstood):
        raise reason
    clause = Clause(list(tokens))
    unknown = next((one.text for one in tokens if one.kind in ("unknown", "thing")), clause.text)
    why = str(reason) if reason else f"{clause.text!r}: it is not clear what to do with {unknown!r}"
    named = next((f"the {one.value.words}" for one in tokens if one.kind == "thing" and not one.value.pronoun), None)
    raise NotUnderstood(f"{why}{templates.nearest(clause.text, named)}")
