"""One clause as edits: the first way of changing a scene by whose words and values every token is accounted for."""

from rpaug.language import lights, looks, placing, templates, viewing
from rpaug.language.messages import Meant, NotUnderstood, Wish
from rpaug.language.things import Namer
from rpaug.language.tokens import Clause, Token, said

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
    for way in WAYS:
        clause = Clause(list(tokens))
        try:
            if (found := way(clause, wish, namer)) is not None:
                clause.done()
                return found
        except NotUnderstood as error:
            raise NotUnderstood(f"{error}{_nearest(tokens)}") from None
    unknown = next((one.text for one in tokens if one.kind in ("unknown", "thing")), said(tokens))
    why = f"{said(tokens)!r}: it is not clear what to do with {unknown!r}"
    raise NotUnderstood(f"{why}{_nearest(tokens)}")


def _nearest(tokens: list[Token]) -> str:
    """What of a clause would be understood, said of its first thing."""
    named = (one.value.words for one in tokens if one.kind == "thing" and not one.value.pronoun)
    return templates.nearest(said(tokens), next((f"the {one}" for one in named), None))
