"""One step in words into operators with their fields, by the rules of the grammar."""

import re

from rpaug.core.errors import MissingExtra, TargetError
from rpaug.language import arrange, assets, light, paint, phrasing, renderer, spelling, templates
from rpaug.language.grammar import RULES, Rule
from rpaug.language.messages import Meant, NotUnderstood, Wish
from rpaug.providers.words import synonym

# Cameras and lamps are told from things by their own words, so they come first.
_ORDER = [module.__name__ for module in (renderer, light, assets, arrange, paint)]
_LATE = ("insert", "elsewhere")  # "put the mug next to the plate" is about a thing that is there
ORDERED: list[Rule] = sorted(
    RULES,
    key=lambda rule: (
        rule.make.__module__ == assets.__name__ and rule.make.__name__ in _LATE,
        _ORDER.index(rule.make.__module__),
    ),
)
STAGES = {renderer.__name__: "renderer", assets.__name__: "assets"}
VERBS = (
    "make", "paint", "remove", "add", "duplicate", "move", "rearrange", "enlarge", "shrink", "cover", "dim", "brighten",
    "raise", "lower", "jitter", "tilt", "blur",
)  # fmt: skip
# Embeddings put a word beside its opposite ("darken" is nearest to "brighten"), so none of these is ever guessed.
OPPOSED = frozenset({"enlarge", "shrink", "dim", "brighten", "raise", "lower"})


def meant(step: str, wish: Wish) -> Meant:
    """What a step means, in the words in which it was said or in others of the same meaning. Raises NotUnderstood."""
    reasons: list[str] = []
    for order in phrasing.orders(step):
        for rule in (*templates.rules(), *ORDERED):  # others' words are closer than {thing}
            try:
                found = rule(order, wish)
            except (NotUnderstood, TargetError) as error:
                reasons.append(str(error))
                continue
            if found is not None:
                stage = STAGES.get(rule.make.__module__, "operation")
                return found.model_copy(update={"stage": stage, "order": order})
    if reasons:
        raise NotUnderstood(reasons[0])
    try:
        other = _other_verb(step)
    except MissingExtra:
        hint = spelling.hint(step) or " (the extra rpaug[words] brings synonyms)"
        raise NotUnderstood(f"{step!r}: no rule fits{hint}") from None
    if other is None:
        raise NotUnderstood(f"{step!r}: no rule fits{spelling.hint(step)}")
    verb, known = other
    found = meant(f"{known}{step[len(verb) :]}", wish)
    note = f"{verb!r} is taken to mean {known!r}"
    return found.model_copy(update={"notes": (*found.notes, note)})


def _other_verb(step: str) -> tuple[str, str] | None:
    """The step's first word and a known verb that means about the same. Raises MissingExtra."""
    verb = re.match(r"[a-z]{3,}", step)
    if verb is None or verb.group() in VERBS or " " not in step:
        return None
    known = synonym(verb.group(), VERBS)
    return None if known is None or known in OPPOSED else (verb.group(), known)
