"""What a wish says about the whole recipe, and how likely a step is to be taken."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re
from typing import Any

from rpaug.agents import slots
from rpaug.agents.messages import NotUnderstood

CHANCE = (
    r"(?:with (?:a )?(?:probability|chance)(?: of)? (?P<p1>{n} ?(?:%|percent)?)|with (?:a )?(?P<p2>{n} ?(?:%|percent)) (?:probability|chance)"
    r"|(?P<p3>half) (?:of )?the time|in (?P<p4>{n} ?(?:%|percent)|half) of (?:the |all )?(?:copies|cases|episodes)|(?P<p5>sometimes))"
).replace("{n}", slots.DIGITS)
EPISODE = r"(?: (?:of|per|for) (?:each |every |an |the )?episode)?"
SETTINGS = (
    ("copies", rf"(?:and )?(?:make |write |give me |create |produce |with |in )?(?P<value>{slots.NUMBER}) (?:augmented )?(?:copies|versions|variants){EPISODE}"),
    ("keep_originals", r"(?:and |but |also )?(?:keep|keeping|write|with) (?:all )?(?:the )?originals?(?: too| as well)?(?P<value>)"),
    ("seed", r"(?:and |with |use |using )*(?:the |a )?(?:random )?seed (?:of |= ?)?(?P<value>\d+)"),
    ("select", r"(?:and )?(?:only )?(?:in|for|on|of|from|using) (?:only )?(?:the )?first (?P<value>{n} )?episodes?(?: only)?".replace("{n}", slots.NUMBER)),
)  # fmt: skip


def settings(text: str) -> tuple[str, dict[str, Any]]:
    """The wish without what it says about the whole recipe, and that."""
    found: dict[str, Any] = {}
    for name, pattern in SETTINGS:
        match = re.search(
            rf"(?:^|(?P<before>[,;]? )){pattern}(?P<after>$|[,;:]? ?)(?![a-z]* of )", text
        )
        if match is None:
            continue
        if name == "copies" and re.match(r" ?of ", text[match.end() :]):
            continue
        value = match["value"]
        if name == "keep_originals":
            found[name] = True
        elif name == "select":
            found[name] = {"limit": slots.count(value.strip()) if value else 1}
        else:
            found[name] = int(value) if name == "seed" else slots.count(value)
        rest = text[match.end() :]
        if name == "copies" and (
            led := re.match(r"(?:with|where|in which|that have) (?=[a-z])", rest)
        ):
            rest = f"make {rest[led.end() :]}"
        text = f"{text[: match.start()].strip(' ,;')}, {rest.strip(' ,;')}".strip(" ,;")
        text = re.sub(r"^(?:and|but) | (?:and|but)$", "", text)
    return text, found


def chance(part: str) -> tuple[str, float | None]:
    for pattern in (rf"^{CHANCE},? (?P<rest>.+)$", rf"^(?P<rest>.+?),? {CHANCE}$"):
        match = re.search(pattern, part)
        if match:
            value = next(v for v in (match[f"p{k}"] for k in range(1, 6)) if v)
            share = 0.5 if value in ("half", "sometimes") else slots.share(value)
            if not 0 <= share <= 1:
                raise NotUnderstood(f"{value!r} is no probability")
            return match["rest"], share
    return part, None
