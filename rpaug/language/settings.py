"""What a wish says about the whole recipe, and how likely a step is to be taken."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re
from typing import Any

from rpaug.language import slots
from rpaug.language.messages import NotUnderstood

CHANCE = (
    (
        r"(?:with (?:a )?(?:probability|chance)(?: of)? (?P<p1>{n} ?(?:%|percent|per cent)?|{part})|(?:with |at )?(?:a |an )?(?P<p2>{n} ?(?:%|percent|per cent)|fifty-fifty) (?:probability|chance|likelihood)(?: of)?"
        r"|(?:for |in |on )?(?P<p3>{part}|{n} ?(?:%|percent|per cent)) (?:of )?the time|(?:in|for|on) (?:only )?(?P<p4>{n} ?(?:%|percent|per cent)|{part}) (?:of )?(?:the |all |all the )?(?:copies|cases|episodes)|(?P<p5>sometimes)"
        r"|(?:in )?(?:every (?P<p6>second|third|fourth|other) (?:copy|case|episode)|one (?:in|out of) (?P<p7>two|three|four|five|ten) (?:copies|cases|times)))"
    )
    .replace("{n}", slots.NUMBER)
    .replace(
        "{part}", r"(?:a half|half|a third|a quarter|a fifth|a tenth|two thirds|three quarters)"
    )
)
ONE_IN = {
    "second": 2,
    "other": 2,
    "third": 3,
    "fourth": 4,
    "two": 2,
    "three": 3,
    "four": 4,
    "five": 5,
    "ten": 10,
}
PARTS = {"half": 0.5, "a half": 0.5, "sometimes": 0.5, "fifty-fifty": 0.5, "a third": 0.3333, "a quarter": 0.25, "a fifth": 0.2, "a tenth": 0.1, "two thirds": 0.6667, "three quarters": 0.75}  # fmt: skip
EPISODE = r"(?: (?:of|per|for) (?:each |every |an |the )?episode)?"
SETTINGS = (
    ("copies", rf"(?:and )?(?:make |write |give me |create |produce |generate |with |in |as |i (?:need|want|would like) |i'd like |for )*(?:a total of )?(?P<value>{slots.NUMBER}) (?:augmented )?(?:copies|versions|variants|variations)(?: each)?{EPISODE}(?: please)?"),
    ("keep_originals", r"(?:and |but |also )*(?:(?:keep|keeping|write|with|include|retain|preserve|leave in)(?: all)?(?: of)?(?: the)? originals?(?: (?:episodes|recordings|demonstrations))?|(?:all )?(?:the )?originals?(?: (?:episodes|recordings))? (?:(?:should|must|shall|are to) be |are )?(?:kept|included|written|retained))(?: in| too| as well| also)*(?P<value>)"),
    ("seed", r"(?:and |with |use |using |set |take )*(?:the |a )?(?:random )?seed(?: number)?(?: (?:of|to|is|as))?(?: ?= ?| )(?P<value>\d+)"),
    ("select", r"(?:and )?(?:but )?(?:only )?(?:in|for|on|of|from|using|do|take|to) (?:only |just )?(?:the )?first (?P<value>{n} )?(?:episodes?|recordings?|demonstrations?|demos?)(?: only)?".replace("{n}", slots.NUMBER)),
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
            value = next(v for v in (match[f"p{k}"] for k in range(1, 8)) if v)
            if match["p6"] or match["p7"]:
                share = slots.rounded(1 / ONE_IN[value])
            else:
                share = PARTS[value] if value in PARTS else slots.share(value)
            if not 0 <= share <= 1:
                raise NotUnderstood(f"{value!r} is no probability")
            return match["rest"], share
    return part, None
