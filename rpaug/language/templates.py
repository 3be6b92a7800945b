"""Operators' own phrases: as ways to ask for those of other packages, and as what would be understood of ours.

`core.phrases` says how they are written.
"""

import re
from collections.abc import Callable, Collection, Sequence
from functools import cache
from typing import Any

from rpaug.core import phrases, registry
from rpaug.core.interfaces import Operator
from rpaug.core.phrases import Group, Part, Slot
from rpaug.language import things, tokens, values
from rpaug.language.messages import Meant, Mention, NotUnderstood, Wish
from rpaug.language.things import Namer, Target

Rule = Callable[..., Meant | None]
KINDS = {
    "share": "share",
    "count": "number",
    "number": "number",
    "length": "length",
    "angle": "angle",
    "color": "color",
}
"""Each kind of slot that is one token, and the kind of that token."""
PLAIN_WORDS = frozenset(
    re.findall("[a-z]+", "the a of to by up in with and make change red block bowl cup degrees")
)
"""Words of the examples that say nothing of what is asked for."""
BY_PHRASES = frozenset({"shadows"})
"""Those of ours that nothing but their phrases asks for."""
OF_KIND = {"count": values.NUMBER, "number": values.NUMBER}


def fitting(stated: str, wish: Wish, namer: Namer, nouns: Collection[str]) -> Meant | None:
    """What some words mean by the phrases of other packages' operators; None if they fit none."""
    return next((found for one in _rules() if (found := one(stated, wish, namer, nouns))), None)


@cache
def _rules() -> tuple[Rule, ...]:
    return tuple(
        rule(name, registry.operator(name), text)
        for name in registry.operator_names()
        if not registry.shipped(name) or name in BY_PHRASES
        for text in registry.operator(name).phrases
    )


def fits(stated: str) -> bool:
    """Whether some words fit a phrase of ours that nothing else asks for."""
    kinds = [registry.operator(name) for name in sorted(BY_PHRASES)]
    patterns = (_pattern(phrases.parse(text, one), []) for one in kinds for text in one.phrases)
    return any(re.fullmatch(pattern, stated) for pattern in patterns)


def rule(op: str, operator: type[Operator], text: str) -> Rule:
    """The rule of one phrase: what some words mean if they fit it to the last one, else None.

    Raises RpaugError for a phrase that is not well-formed.
    """
    found: list[Slot] = []
    pattern = re.compile(_pattern(phrases.parse(text, operator), found))

    def make(
        stated: str, wish: Wish, namer: Namer | None = None, nouns: Collection[str] = ()
    ) -> Meant | None:
        fits = pattern.fullmatch(stated)
        namer = namer or Namer(None, wish.mention)
        if fits is None:
            return None
        values: list[tuple[str, Any]] = []
        each, every, mention = "", list[Target](), None
        for number, slot in enumerate(found):
            spoken = fits[f"slot{number}"]
            if spoken is None:
                continue
            if slot.kind in ("target", "targets"):
                things = _things(spoken, namer, nouns)
                if things is None or (
                    slot.kind == "target"
                    and slot.field not in operator.needs.targets
                    and len(things) > 1
                ):
                    return None
                if slot.kind == "target" and slot.field in operator.needs.targets:
                    each, every = slot.field, things
                    mention = Mention(kind="target", target=things[0]) if len(things) == 1 else None
                value: Any = things if slot.kind == "targets" else things[0]
            elif slot.choices:
                value = spoken
            else:
                value = _value(slot.kind, spoken, wish)
                if value is None:
                    return None
                if slot.kind == "camera":
                    mention = Mention(kind="camera", cameras=value)
            values.append((slot.field, value))
        edit = {"op": op, **phrases.fields(values)}
        return Meant(edits=tuple({**edit, each: one} for one in every) or (edit,), mention=mention)

    return make


def _things(spoken: str, namer: Namer, nouns: Collection[str]) -> list[Target] | None:
    """The targets that some words list; None if they are more than that."""
    read = tokens.tokens(tokens.split(spoken), (), nouns)
    named = [one.value for one in read if one.kind == "thing"]
    if not named or any(one.fresh for one in named):
        return None
    if any(one.kind not in ("and", "thing") and one.text != "the" for one in read):
        return None
    return [things.every(namer.target(one)) if one.several else namer.target(one) for one in named]


def _value(kind: str, spoken: str, wish: Wish) -> Any:
    """What the words of a slot come to; None if they are of another kind."""
    try:
        read = tokens.tokens(tokens.split(spoken), wish.setting.cameras, ())
    except NotUnderstood:
        if kind == "camera":
            raise
        return None
    wanted = "camera" if kind == "camera" else KINDS[kind]
    token = next((one for one in read if one.kind == wanted), None)
    if token is None or [one for one in read if one is not token and one.kind not in tokens.WEAK]:
        return None
    if kind == "camera":
        alone = isinstance(token.value, list) and len(token.value) == 1
        return token.value[0] if alone else token.value or None
    if kind == "color":
        return token.value[0] if len(token.value) == 1 else None
    return token.value.low if token.value.how == "exact" else None


def _pattern(part: Part, found: list[Slot]) -> str:
    """The pattern of a part with the space before it; slots are numbered as they are found."""
    if isinstance(part, str):
        return rf"(?:^| ){re.escape(part)}"
    if isinstance(part, Group):
        every = ("".join(_pattern(one, found) for one in parts) for parts in part.alternatives)
        return f"(?:{'|'.join(every)}){'' if part.needed else '?'}"
    name = f"slot{len(found)}"
    found.append(part)
    return rf"(?:^| )(?P<{name}>{_either(part.choices) if part.choices else OF_KIND.get(part.kind, '.+?')})"


def _either(choices: Sequence[str]) -> str:
    return "(?:" + "|".join(re.escape(one) for one in sorted(choices, key=len, reverse=True)) + ")"


def nearest(stated: str, thing: str | None) -> str:
    """What would be understood and shares most words with what was not; "" where none shares any."""
    said = set(re.findall(r"[a-z]+", stated)) - PLAIN_WORDS

    def shared(name: str) -> int:
        own = (name.replace("_", " "), *registry.operator(name).undone_as, *examples(name))
        return len(said & set(re.findall(r"[a-z]+", " ".join(own))))

    name = max(registry.operator_names(), key=shared)
    told = next(iter(examples(name)), "") if shared(name) else ""
    told = told.replace(phrases.EXAMPLES["target"][0], thing) if thing else told
    return f"; understood would be, for one: {told!r}" if told else ""


def examples(name: str) -> list[str]:
    """What may be said to ask for an operator: its phrases, filled in."""
    operator = registry.operator(name)
    return [phrases.example(phrases.parse(text, operator)) for text in operator.phrases]
