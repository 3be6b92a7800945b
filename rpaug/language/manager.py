"""A whole wish into clauses, each read in turn: the longest beginning that is understood to the last word, then the rest."""
# ruff: noqa: E501  # patterns and word lists are easiest to read whole

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from rpaug.assets import library
from rpaug.core import color_space, registry
from rpaug.core.errors import RpaugError
from rpaug.language import naming, reading, repair, templates, words
from rpaug.language.calling import called
from rpaug.language.declared import own_role, targets
from rpaug.language.meaning import ANY, MOST, Reader, asset
from rpaug.language.messages import Answer, Entry, Meant, Mention, NotUnderstood, Trace, Wish
from rpaug.language.naming import Namer
from rpaug.language.recording import Recording

PLAIN = (
    (r"[’`]", "'"), (r"[“”\"]|(?<!\w)'|'(?!\w)", " "), (r"[–—]", "-"), (r"→|=>|-+>|\bbecomes\b", " -> "), (r"≥|>=|(?<!-)>", " at least "), (r"≤|<=", " at most "),
    (r"≈|~", " about "), (r"\+ ?/ ?-|\+-|plus[ /-]minus|plus or minus", "±"), (r"°", " degrees "), (r"\bw/", "with "), (r"\bboth (?=the [^,;]+ and )", ""),
    (r"(?<=[a-z])'s\b(?<!it's)(?<!there's)(?<!that's)(?<!let's)(?<!what's)", ""), (r"\+(?=\d)", ""), (r"\+|&", " and "), (r"(?<=[a-z]) ?/ ?(?=[a-z])", " or "), (r"\bgrey", "gray"), (r"colour", "color"), (r"\bu\b", "you"), (r"\b(?:all )?(?:the )?(stuff|things|objects) (?:(?:what|that|which) (?:is|are) )?(?=not needed)", r"\1 "),
    (r"\bshd\b", "should"), (r"\b(?:diff|diffrent)\b", "different"), (r"\bsth\b", "something"), (r"(?<=\d)(?=[a-z%])", " "),
    (r"(\d+)/(\d+)(?= ?(?:inch|cm|of|the|m\b))", lambda m: f"{int(m[1]) / int(m[2]):.4g}"), (r"\(((?![^)]*\d ?,)[^)]*)\)", r" , \1 , "),
    (r"(?<!\d) \.|\.(?!\d)|[;!?]+", " ; "), (r"\n+", ", "), (r"\bphoto[- ]?graph", "photo"), (r"(?<=[a-z]):(?= )|(?<=[a-z]) -(?= )", " : "), (r" a?round(?= at random| by|$| ?[,;])", ""), (r" +", " "), (r" ?(?:[,;] ?)*; ?(?:[,;] ?)*", " ; "), (r" ?,(?: ?,)* ?", ", "),
)  # fmt: skip
BREAK = re.compile(
    r" ; |,? while (?:also )?|,? (?=without )|,? and then |,? then |,? but (?:also )?(?=leave|keep|far|nothing|only|no |not |don't|do not|never|without|make|paint|add|[a-z ]+ (?:must|should|stays?|untouched|unchanged))|,? and (?:also )?|, | so (?=that|the|we|it|they|there)| because | since "
)
REASON = re.compile(
    r"(?:so|because|since|in order|to (?:teach|test|see|simulate|check)|otherwise|i think|this is|we need to (?:see|test)|the policy|my policy|our|like that)\b[^,;]*"
    r"|(?:the )?[a-z ]+? (?:always|often|sometimes|usually) (?:gets?|is|are|moves?) [^,;]*"
    r"|(?:the )?[a-z ]+? (?:is|are|was|look|looks|blend|blends|have|has)(?: always)? (?:too|very|super|so|hard|already|now|ood|bad|boring|ugly|both|into|[a-z]+ here)\b[^,;]*"
)
CLEAR = re.compile(  # what holds of all that is put in
    r"(?:(?:but |and |just |somewhere )?(?:so (?:that )?)?(?:far|well away|away|out of|clear|nothing|not|never)\b.*\b(?:from|way|of|path|hits?|touch|collide)\b[^,;]*"
    r"|(?:so (?:that )?|somewhere |where )?(?:it|they|the [a-z]+) (?:won't|will not|doesn't|does not|don't|not|never|can't|cannot) [^,;]*)"
)
KEEP = re.compile(
    r"(?:please )?(?:leave|keep|hold|preserve)s? (?P<a>.+?)(?: (?:alone|in peace|as (?:it is|they are|it was|is|are|recorded|original|it|they)|unchanged|untouched|the same|fixed|constant|where (?:it is|they are)|white|red|out of it|though))?"
    r"|(?P<b>.+?) (?:stays?|remains?|must stay|should stay|must remain|must be kept|keeps?)(?: .*)?"
    r"|(?:do not|don't|dont|never|must not|without|not|avoid|hands off|and not)(?: (?:touch|touching|change|changing|edit|editing|move|moving|alter|altering|affect|affecting))? (?P<c>.+)"
    r"|(?P<d>.+?) (?:untouched|unchanged|fixed|constant|alone|as (?:it is|they are|is)|(?:must|should|may|shall) (?:not|never) (?:be )?(?:changed?|touched|moved?|altered|edited|affected|painted|recolored)|don't touch)"
    r"|(?P<e>nothing else|not the others?|only that)(?: .*)?"
)
ELSE = re.compile(
    r"(?:and )?(?:else|otherwise|(?:in |for )?(?:the )?(?:other|rest|remaining)(?: \d+ ?%)?(?: of (?:the )?(?:time|copies|them))?(?: copies)?),? (?:leave|keep|like|as|unchanged|untouched|the original|stays?)\b[^;]*"
)
OTHERS = re.compile(
    r"(?:the )?(?:others?|rest|rest of .*|other .*|everything else|all else|else|originals?|it|anything else)$"
)
SHARE = rf"(?:{words.NUMBER}|half|a half)"
CHANCES = (
    rf"(?:with |at )?(?:a |an )?(?:probability|prob|chance|p)\.?(?: of| is)? ?=? ?(?P<p1>{words.DIGITS}) ?(?P<c1>%|percent)?",
    rf"(?:with )?(?:a |an )?(?P<p2>{words.DIGITS}) ?(?P<c2>%|percent)? (?:probability|prob|chance|likelihood)",
    rf"(?:in |for |on )?(?:about |around |roughly )?(?P<p3>{words.NUMBER}) ?(?P<c3>%|percent)(?: of)?(?: the| all)? ?(?:copies|cases|time|episodes|runs|demos|recordings)?(?=$|,| ;)",
    rf"(?:in |for |on )?(?:about )?(?P<p4>{words.NUMBER}) ?(?P<c4>%|percent) of (?:the |all )?(?:copies|cases|time|episodes|runs|demos|recordings)",
    rf"(?:(?<=[a-z]), (?:in )?|(?<=[a-z]) in )(?P<p9>{words.DIGITS}) ?(?P<c9>%|percent)(?: of (?:them|the copies|copies|the time))?$",
    r"(?:in )?(?:every |each )(?P<n5>second|other|third|fourth|fifth|tenth|\d+) ?(?:th|rd|nd)? (?:copy|episode|case|time)(?: or so)?",
    r"(?:in )?(?P<k6>1|one|2|two) (?:in|of|out of) (?:every )?(?P<n6>two|three|four|five|ten|\d+) ?(?:copies|cases|times|episodes)?",
    r"(?:in |for )?(?:the )?(?P<w7>other half|half|a half|a third|a quarter|a fifth|a tenth|two thirds|three quarters|most)(?: of)?(?: the| all)? ?(?:copies|cases|time|episodes)(?: only)?|(?:in )?(?:the )?(?P<w8>sometimes|occasionally|half the time|other half)",
)  # fmt: skip
MEASURED = re.compile(
    r"\b(?:lights?|lamps?|lighting|bright\w*|dark\w*|dim\w*|size|scale|large\w*|small\w*|big\w*|noise|quality|taller|wider|blur|exposure)\b"
)
"""Where a bare percentage is no share of the copies."""
ORDINAL = {
    "second": 2,
    "other": 2,
    "third": 3,
    "fourth": 4,
    "fifth": 5,
    "tenth": 10,
    **{w: int(n) for w, n in words.WORDS.items() if n >= 1},
}
PARTS = {"half": 0.5, "a half": 0.5, "other half": 0.5, "sometimes": 0.5, "occasionally": 0.25, "half the time": 0.5, "a third": 0.3333,
         "a quarter": 0.25, "a fifth": 0.2, "a tenth": 0.1, "two thirds": 0.6667, "three quarters": 0.75, "most": 0.75}  # fmt: skip
SETTINGS = (
    ("copies", rf"(?:(?:make|write|give me|create|produce|generate|with|in|as|i need|i want|for) )*(?:a total of )?(?P<value>{words.NUMBER}) (?:augmented )?(?:copies|versions|variants|variations)(?: each)?(?: (?:of|per|for) (?:each |every |an |the )?episode)?(?: please)?(?! of)"),
    ("keep_originals", r"(?:(?:keep|keeping|write|with|include|retain|preserve)(?: all)?(?: of)?(?: the)? originals?(?: (?:episodes|recordings))?|(?:the )?originals?(?: should be| must be| are)? (?:kept|included|retained))(?: in| too| as well| also)?(?P<value>)"),
    ("seed", r"(?:with |use |using |set )*(?:the |a )?(?:random )?seed(?: number)?(?: of| to| is| as)? ?=? ?(?P<value>\d+)"),
    ("select", rf"(?:(?:only|in|for|on|of|from|using|do|take) )+(?:only |just )?(?:the )?first (?P<value>{words.NUMBER} )?(?:episodes?|recordings?|demonstrations?|demos?)(?: only)?"),
)  # fmt: skip
UNDO = re.compile(
    r"(?:no )?(?:undo|forget about|forget|revert|cancel|take back|roll back|drop|remove)(?: (?P<what>[a-z0-9_ ]+?))?(?: again)?"
    r"|(?P<passive>[a-z0-9_ ]+?) (?:should|must|has to) be (?:undone|reverted|taken back)"
)
UNDO_LAST = re.compile(
    r"(?:undo|revert|cancel|take back|scratch that)(?: (?:it|this|that|the last (?:step|edit|change|one)|last))?(?: again)?"
)
RESTART = re.compile(
    r"start (?:over|again|afresh|from scratch)|(?:forget|undo) everything|clear the recipe"
)
BACK = re.compile(
    r"(?:put|bring|give|add) (?P<a>.+?) back(?: in)?|keep (?P<b>.+?)(?: though| after all)"
)
SAME = re.compile(
    r"(?:the )?same (?:for|with|to|on|thing (?:for|with)) (?P<a>.+)|(?:and )?(?P<b>(?:the|that|this) .+?) (?:as well|too|also|likewise)|do that (?:for|to|with) (?P<c>.+)(?: too)?"
)
INSTEAD = re.compile(
    rf",? (?:and )?(?:instead of|rather than|not) (?:the |an? )?{words.COLOR}(?: ones?)?(?= |,|$)"
)
FROM = re.compile(rf",? from (?P<tint>{words.COLOR})(?= (?:in)?to )")
QUESTION = re.compile(
    r"(?:is|are|does|did|why|who|when|where|which|what(?! about\b)|how(?! about\b)|whatever happens)\b(?! the robot (?:moves|manipulates|holds))"
)
HEADING = re.compile(
    r"(?:make|so|to make) (?:it|this|things|the task) (?:harder|more difficult|tougher|more diverse|more robust) : "
)
FACT = re.compile(
    rf"(?P<what>[^,;]+?) (?:is|are) (?P<tint>{words.COLOR})(?P<now> here| now| already| at the moment)?"
)
HEADED = re.compile(r"(?P<what>[^,;:]+?) : (?P<rest>[^:]*\b(?:it|them)\b.*)")
EVEN = re.compile(
    rf"(?:with |at )?(?:(?:an? |the )?(?:equal|same) (?:chances?|probability|probabilities|shares?|odds|parts)|50 ?/ ?50|fifty[- ]fifty|half[ /-](?:and )?half|(?P<share>{words.NUMBER}(?: ?%| percent)?) each|one (?:per|for each|in each) copy|drawn? per copy|whichever)(?: of (?:them|these))?"
)
HARDER = re.compile(
    r"(?:make |please |somewhat |a bit |a little |much )*(?P<x>.*?) ?(?:be |look |a bit |a little |somewhat |much )*(?:harder|more difficult|more challenging|tougher|less visible|less obvious)(?: (?:to|for the policy to) (?:see|find|spot|detect|recogni[sz]e|make out|tell apart))?(?: (?P<y>.+?))?(?: (?:please|in the images?|for the policy|than now))?"
)
SIMILE = re.compile(
    r" (?:so (?:that )?(?:one|we|i|you|it|they|the|there|people|everybody)\b.*|like (?:an?|from|in|on|at|they|it|my|our|the one)\b.*|like [a-z]+|as (?:if|in|with|on|is usual)\b.*|for (?:better|more) [a-z ]+)$"
)
SETTLED = (
    "recolor",
    "retexture",
    "table_color",
    "table_texture",
    "background_texture",
    "object_size",
    "stylize",
)
LOOKS = ("recolor", "retexture", "table_color", "table_texture", "background_texture", "light_color", "light_direction",
         "sensor_noise", "sensor_blur", "sensor_jpeg", "sensor_exposure")  # fmt: skip
ATTRIBUTE = rf"(?:{words.COLOR}|{words.any_of(naming.relations.RANKS)}(?![a-z]))"
BOTH = re.compile(
    rf"(?P<lead>^|(?:the|both|of|remove|delete|paint|make|turn|recolor|give) )(?P<one>{ATTRIBUTE}) and (?:the )?(?P<two>{ATTRIBUTE}) (?P<noun>[a-z]+)(?= |,|$)"
)
REPLACE = re.compile(
    rf"(?:replace|exchange|substitute) (?P<what>(?:the )?.+?) (?:by|with|for) (?:an? )(?!{words.COLOR} one$)(?P<by>[a-z_ ,]+)"
)
AFTERTHOUGHT = frozenset(
    {"color", "texture", "gloss", "little", "much", "or", "vary", "each", "same", "any", "share", "number", "length", "angle", "kelvin", "stops", "pixels", "times",
     "size_of", "strangers", *reading.WEAK}
)  # fmt: skip
"""Kinds of words that only go on with what the clause before asks for."""
ALIKE = re.compile(
    r"(?<![a-z])(?:in |of |gets? |have |has |be |-> )*(?:exactly )?(?:the )?same colou?r (?:as|like|of) (?P<what>.+?)(?: has| is)?$"
)
ONLY = re.compile(
    r"(?:leave|keep) (?:only|just|nothing but|nothing except) (?P<a>.+?)(?: on the table| in the scene)?"
    r"|only (?P<b>.+?) (?:should |must |shall |may )?(?:be )?(?:left|stays?|remains?|visible|kept)(?: on the table)?"
)
AGAIN = re.compile(
    r"(?P<head>.*\b(?P<noun>[a-z]+)) (?:->|to|into|with|by|for|:) (?:an? |the |some )?(?P<value>.+) (?:(?P=noun)|one|ones)"
)
MOST_CLAUSES = 30
OWN = frozenset(
    re.findall(
        "[a-z]{3,}",
        " ".join(
            [
                *(
                    one.pattern
                    for one in (REASON, CLEAR, KEEP, ELSE, OTHERS, UNDO, BACK, SAME, RESTART)
                ),
                *CHANCES,
                *(one for _, one in SETTINGS),
            ]
        ),
    )
)
"""The words that this module knows."""


@dataclass
class WishState:
    """What has been gathered of one wish so far."""

    wish: Wish
    namer: Namer
    edits: list[Entry]
    settings: dict[str, Any]
    mention: Mention | None
    notes: list[str] = field(default_factory=list)
    fresh: list[Entry] = field(default_factory=list)  # edits of this wish
    kept: list[str] = field(default_factory=list)  # what must stay as it is
    did: bool = False
    trace: list[Trace] = field(default_factory=list)
    verb: str = ""
    last: tuple[str, list[Entry]] = ("", [])  # the clause before, and its edits
    about: str = ""  # the things that the clause before gave a look or a size, as they were named

    def clause(self, text: str) -> reading.Clause:
        """Some words of the wish as tokens."""
        return reading.clause(text, self.wish.setting.cameras, self.nouns)

    @cached_property
    def nouns(self) -> frozenset[str]:
        return _nouns(self.wish)

    def here(self) -> Wish:
        """The wish as the next clause sees it."""
        return self.wish.model_copy(update={"edits": tuple(self.edits), "mention": self.mention})


def answer(wish: Wish, recording: Recording | None = None) -> Answer:
    """What a wish comes to, offline. Raises NotUnderstood, and then nothing of the wish holds."""
    text = normal(wish.stated)
    mended, notes = repair.repaired(text, reading.known(wish.setting.cameras) | OWN | _nouns(wish))
    try:
        return _answer(wish, mended, notes, recording)
    except RpaugError:
        if mended == text:
            raise
        with contextlib.suppress(RpaugError):
            return _answer(wish, text, [], recording)
        raise


def _answer(wish: Wish, text: str, notes: list[str], recording: Recording | None) -> Answer:
    if QUESTION.match(text):
        raise NotUnderstood(f"{wish.stated!r}: a question; say what is to be changed")
    text, found = settings(text)
    state = WishState(
        wish,
        Namer(recording, wish.mention),
        list(wish.edits),
        dict(wish.settings) | found,
        wish.mention,
        did=bool(found),
    )
    state.notes += notes
    if text:
        _run(text, state)
    _respect(state)
    if not state.did or not (state.edits or state.wish.edits):
        raise NotUnderstood(f"{wish.stated!r}: that asks for no change, so there is nothing to do")
    whole = Trace(
        stage="manager", by="words", input=wish.stated, output={"read": text, "settings": found}
    )
    state.notes += state.namer.notes
    return Answer(
        edits=tuple(_drawn(state.edits)),
        settings=state.settings,
        mention=state.mention,
        notes=tuple(dict.fromkeys(state.notes)),
        trace=(whole, *state.trace),
    )


def normal(stated: str) -> str:
    """Lower case, one spelling of marks and units, no marks at the ends."""
    text = stated.lower()
    for pattern, other in PLAIN:
        text = re.sub(pattern, other, text)
    return text.strip(" ,;:")


def undone(stated: str) -> bool:
    """Does the wish ask for nothing but the round before to be undone?"""
    return bool(UNDO_LAST.fullmatch(normal(stated)))


def _nouns(wish: Wish) -> frozenset[str]:
    """The words of the instructions, and of what was asked for before."""
    stated = " ".join(
        (*wish.setting.instructions, *(str(one) for edit in wish.edits for one in edit.values()))
    )
    stated += " " + " ".join(f"{one.name} {one.category}" for one in library.assets())
    return frozenset(re.findall(r"[a-z]+", stated.lower())) | {one.name for one in library.assets()}


def _run(text: str, state: WishState) -> None:
    """Take the longest beginning that is one clause, then go on with the rest. Raises NotUnderstood."""
    for _ in range(MOST_CLAUSES):
        if not (text := text.strip(" ,;:")):
            return
        text = HEADING.sub("", text)
        if (
            (headed := HEADED.fullmatch(text))
            and _whole(headed["what"], state)
            and (named := naming.begins(headed["what"].split(), state.nouns))
        ):
            state.mention, text = (
                Mention(kind="target", target=state.namer.target(named[1])),
                headed["rest"],
            )
        reason: RpaugError | None = None
        for part, rest in _beginnings(text):
            try:
                _clause(part, state)
            except RpaugError as error:
                reason = error  # that of the shortest beginning tells most
                continue
            text = rest
            break
        else:
            assert reason is not None
            raise reason
    raise NotUnderstood(f"more than {MOST_CLAUSES} clauses: say them in several wishes")


def _beginnings(text: str) -> Iterator[tuple[str, str]]:
    """The text as a whole, and then every shorter beginning with what remains, the longest first."""
    yield text, ""
    for match in reversed(list(BREAK.finditer(text))):
        part, rest = text[: match.start()].strip(" ,;"), text[match.end() :].strip(" ,;")
        if part and rest:
            reason = re.match(r" (?:so|because|since) ", match.group())
            yield part, f"{match.group().strip()} {rest}" if reason else rest


def _clause(part: str, state: WishState) -> None:
    """One clause. Raises RpaugError and then changes nothing."""
    part = re.sub(
        r"^(?:(?:and|but|also|then|or|now|please|pls|plz|no|first|finally|next),? )+", "", part
    ).strip(" ,;:")
    part = BOTH.sub(_apart, part)
    if not part or all(one.kind in ("filler", "and") for one in state.clause(part).tokens):
        return
    if RESTART.fullmatch(part):
        state.edits, state.fresh, state.mention, state.did = [], [], None, True
    elif UNDO_LAST.fullmatch(part) and state.wish.edits:
        _undo("that", state)
    elif (
        (back := UNDO.fullmatch(part))
        and state.wish.edits
        and _undo(back["what"] or back["passive"], state, only=part.startswith(("drop", "remove")))
    ):
        return
    elif (back := BACK.fullmatch(part)) and any(edit.get("op") == "remove" for edit in state.edits):
        _back(back["a"] or back["b"], state)
    elif (same := SAME.fullmatch(part)) and state.edits and state.fresh == []:
        _same(same["a"] or same["b"] or same["c"], state)
    elif (even := EVEN.fullmatch(part)) and state.fresh and "one_of" in state.fresh[-1]:
        _evenly(even["share"], state)
    elif (harder := HARDER.fullmatch(part)) and _whole_or_it(
        [one for one in (harder["x"], harder["y"]) if one], state
    ):
        _take(_harder(part), None, state, part)
    elif (only := ONLY.fullmatch(part)) and any(one.get("op") == "remove" for one in state.fresh):
        _kept(f"keep {only['a'] or only['b']}", state)
    elif replaced := REPLACE.fullmatch(part):
        _replace(replaced["what"], replaced["by"], state, part)
    elif only or not (_kept(part, state) or _reason(part, state)):
        _edit(_in_full(part, state), state)


def _apart(found: re.Match[str]) -> str:
    """ "the red and blue bins" as "the red bin and the blue bin"."""
    noun = naming.singular(found["noun"])
    return (
        f"{found['lead'].removesuffix('both ')}{found['one']} {noun} and the {found['two']} {noun}"
    )


def _replace(what: str, by: str, state: WishState, part: str) -> None:
    """A thing is gone, and a new one stands near where it was. Raises NotUnderstood."""
    if not _whole(what, state) or (named := naming.begins(what.split(), state.nouns)) is None:
        raise NotUnderstood(f"{what!r}: which thing is meant?")
    where, options, notes = state.namer.target(named[1]), list[Entry](), list[str]()
    for one in re.split(r",? or (?:an? )?|, ", by):
        fields, told = asset(one, None, state.wish.setting.generates)
        options.append({"op": "insert", **fields, "near": where})
        notes += told
    notes.append(f"what takes the place of {what!r} stands near where that was")
    new = options[0] if len(options) == 1 else {"one_of": options}
    gone = {"op": "remove", "target": where}
    _take(
        Meant(edits=(new, gone), mention=Mention(kind="new"), notes=tuple(notes)), None, state, part
    )


def _in_full(part: str, state: WishState) -> str:
    """The clause with its nouns where they were said once for two: "the red and blue bins", "the red can to a blue one"."""
    part = re.sub(r" (?:that|which) (?:are|is) (?:no|not|not an?) (?=[a-z])", " except ", part)
    if alike := ALIKE.search(part):
        return f"{part[: alike.start()]} {_measured(alike['what'], state)}"
    if only := ONLY.fullmatch(part):
        return f"remove everything except {only['a'] or only['b']}"
    if again := AGAIN.fullmatch(part):
        kinds = {one.kind for one in state.clause(again["value"]).tokens}
        if kinds <= {"color", "texture", "gloss", "vary", "filler"}:
            return f"{again['head']} -> {again['value']}"
    return part


def _measured(what: str, state: WishState) -> str:
    """The color that something was recorded in. Raises NotUnderstood for several."""
    named = naming.begins(what.split(), state.nouns)
    if named is None or not _whole(what, state):
        raise NotUnderstood(f"{what!r}: the same color as what?")
    ids = state.namer.ids(state.namer.target(named[1]))
    tints = {row["color"] for row in state.namer.rows if row["id"] in ids}
    if len(tints) != 1:
        raise NotUnderstood(f"{what!r} has several colors: {', '.join(sorted(tints))}")
    state.notes.append(f"the color of {what!r} is {min(tints)}")
    return str(tints.pop())


def _evenly(share: str | None, state: WishState) -> None:
    """Each of the looks that were said gets its share of the copies. Raises NotUnderstood for more than all."""
    edit = state.fresh[-1]
    if share is None:
        return
    number = words.number(re.match(words.NUMBER, share)[0]) / (100 if share[-1] in "%t" else 1)  # type: ignore[index]
    whole = words.tidy(number * len(edit["one_of"]))
    if whole > 1.02:
        raise NotUnderstood(f"{share} each: {len(edit['one_of'])} looks are more than all copies")
    if whole < 0.98:
        edit["probability"] = whole


def _harder(part: str) -> Meant:
    edit = {"op": "light_color", "range": [[0.2, 0.2, 0.2], [0.4, 0.4, 0.4]]}
    note = f"{part!r} is taken as dimmer light, 0.4 to 0.8 times as bright; say what else: clutter, colors, cameras"
    return Meant(edits=(edit,), mention=Mention(kind="light"), notes=(note,))


def _whole_or_it(parts: Sequence[str], state: WishState) -> bool:
    """Are these the scene as a whole, or things of it that are there?"""
    for one in parts:
        if one in ("it", "this", "things", "everything", "the task", "the scene", "all"):
            continue
        named = naming.begins(one.split(), state.nouns)
        if not _whole(one, state) or named is None:
            return False
        if state.namer.recording:
            state.namer.ids(state.namer.target(named[1]))
    return True


def _edit(part: str, state: WishState) -> None:
    part, share = chance(part)
    recorded = FROM.search(part)
    part = FROM.sub("", part)
    part = (
        part
        if re.search(r"\b(?:any|random\w*|different|various|vary)\b", part)
        else INSTEAD.sub("", part).strip(" ,;:")
    )
    if re.search(r"\bor\b", part):
        part = re.sub(rf",? ?{EVEN.pattern}(?=$| )", "", part)
    options = re.split(r",? or (?:else )?(?=[a-z]+ )", re.sub(r"^either ", "", part))
    found = None
    try:
        found = _meant(part, state)
    except RpaugError:
        found = _gone_on(part, state) or (
            _alternatives(options, state) if len(options) > 1 else None
        )
        if found is None:
            raise
    if recorded:
        found = _of_that_color(found, recorded["tint"])
    _take(found, share, state, part)


def _gone_on(part: str, state: WishState) -> Meant | None:
    """What the clause before comes to with these words at its end, if that is the same edit with more said of it."""
    before, edits = state.last
    if not before or not {one.kind for one in state.clause(part).tokens} <= AFTERTHOUGHT:
        return None
    with contextlib.suppress(RpaugError):
        found = Reader(state.here(), state.namer).read(state.clause(f"{before} {part}"))
        if [_ops(one) for one in found.edits] == [
            _ops(one) for one in edits
        ] and not found.replaces:
            state.edits = [one for one in state.edits if all(one is not old for old in edits)]
            state.fresh = [one for one in state.fresh if all(one is not old for old in edits)]
            return found
    return None


def _ops(edit: Entry) -> set[str]:
    return {one["op"] for one in edit.get("one_of", [edit])}


def _of_that_color(found: Meant, tint: str) -> Meant:
    """The edits, painting only what was recorded in a color. Raises NotUnderstood for other edits than a new color."""
    word = color_space.canonical(tint)
    plain = [one for edit in found.edits for one in edit.get("one_of", [edit])]
    if word is None or any(edit["op"] != "recolor" for edit in plain):
        raise NotUnderstood(f"'from {tint}': only a new color can be for what has that color now")
    edits = tuple(
        {"one_of": [{**one, "only": word} for one in edit["one_of"]]}
        if "one_of" in edit
        else {**edit, "only": word}
        for edit in found.edits
    )
    return found.model_copy(update={"edits": edits})


def _meant(part: str, state: WishState) -> Meant:
    wish = state.here()
    state.namer.mention = state.mention
    reader = Reader(wish, state.namer)
    if (fits := templates.fitting(part, wish, state.namer, state.nouns)) is not None:
        return fits
    try:
        return reader.read(state.clause(part))
    except RpaugError as error:
        why = error
    if (plain := SIMILE.sub("", part)) != part:
        with contextlib.suppress(RpaugError):
            found = reader.read(state.clause(plain))
            if all(
                one["op"] in LOOKS for edit in found.edits for one in edit.get("one_of", [edit])
            ):
                note = f"{part[len(plain) :].strip()!r} is taken as a reason, not as an edit"
                return found.model_copy(update={"notes": (*found.notes, note)})
    read = state.clause(part)
    about = [state.verb] if state.verb and not read.has("remove", "add", "move", "copy") else []
    about += [] if read.has("thing") or not state.about else [state.about]
    for before in about:
        with contextlib.suppress(RpaugError):
            return reader.read(state.clause(f"{before} {part}"))
    raise why


def _alternatives(parts: Sequence[str], state: WishState) -> Meant:
    options: list[Entry] = []
    for part in parts:
        found = _meant(part, state)
        if len(found.edits) != 1 or found.replaces:
            raise NotUnderstood(f"{part!r} is no single edit, and `or` draws one of several")
        options += found.edits[0].get("one_of", found.edits)
        if found.mention and found.mention.kind == "target":
            state.namer.mention = state.mention = found.mention
    return Meant(edits=({"one_of": options},))


def _reason(part: str, state: WishState) -> bool:
    """Is it why somebody wants it, or how things are? It asks for nothing, and that is told."""
    if any(
        edit.get("op") in ("insert", "distractors", "duplicate") for edit in state.fresh
    ) and CLEAR.fullmatch(part):
        state.notes.append(
            f"{part!r}: what is put in stands clear of other things and of all that moves"
        )
        return True
    fact = None if part.startswith(("our", "my ")) else FACT.fullmatch(part)
    named = naming.begins((fact["what"] if fact else part).split(), state.nouns)
    camera = next((one for one in state.clause(part).tokens[:1] if one.kind == "camera"), None)
    if camera and camera.value and REASON.fullmatch(part):
        names = camera.value
        names = names[0] if isinstance(names, list) and len(names) == 1 else names
        state.mention = Mention(kind="camera", cameras=names)
    if fact and (named is None or not _true(fact, named[1], state)):
        return False
    if not fact and not REASON.fullmatch(part):
        return False
    if (
        named
        and not named[1].fresh
        and (fact or not part.startswith(("so", "this", "that", "i ", "we ", "our")))
    ):
        state.mention = Mention(kind="target", target=state.namer.target(named[1]))
    state.notes.append(f"{part!r} is taken as a reason, not as an edit")
    return True


def _true(fact: re.Match[str], named: naming.Named, state: WishState) -> bool:
    """Is the thing of that color as it was recorded?"""
    if fact["now"] or state.namer.recording is None:
        return bool(fact["now"])
    ids, tint = state.namer.ids(state.namer.target(named)), words.colors(fact["tint"])[0]
    seen = [row["color"] for row in state.namer.rows if row["id"] in ids]
    return isinstance(tint, str) and any(color_space.means(tint, one) for one in seen)


def _kept(part: str, state: WishState) -> bool:
    """Does it say what must stay as it is? That is held against the edits at the end."""
    if ELSE.fullmatch(part):
        return True
    found = KEEP.fullmatch(part)
    if found is None:
        return False
    what = next(value for value in found.groups() if value is not None).strip(" ,")
    what = re.sub(r"^(?:(?:all|any|anything about|of|never|a) )+", "", what)
    if OTHERS.match(what) or found["e"]:
        return True
    parts = [
        re.sub(r"^(?:the|a|an|its|your) ", "", one)
        for one in re.split(r",? and (?:the )?|, (?:the )?", what)
    ]
    if not all(_whole(one, state) for one in parts):
        if " but " not in part and (found["a"] or found["c"]):
            raise NotUnderstood(f"{part!r}: it is not clear what must stay as it is")
        return False
    state.kept += parts
    state.namer.kept += [
        named[1] for one in parts if (named := naming.begins(one.split(), state.nouns))
    ]
    return True


def _whole(what: str, state: WishState) -> bool:
    """Is it a thing, a camera or the light, and no word more?"""
    read = state.clause(what)
    kinds = {token.kind for token in read.tokens} - {"filler"}
    return len(kinds) == 1 and kinds <= {"thing", "camera", "light", "lit", "image"}


def _respect(state: WishState) -> None:
    """Take what must stay as it is out of the edits of this wish. Raises NotUnderstood where that is not possible."""
    for what in state.kept:
        for edit in list(state.fresh):
            for option in edit.get("one_of", [edit]):
                if _touched(what, option, state):
                    _spare(what, edit, option, state)


def _touched(what: str, edit: Entry, state: WishState) -> bool:
    if called(what, edit):
        return True
    named = naming.begins(what.split(), state.nouns)
    role = own_role(edit["op"])
    about = targets(edit) or ([{"role": role}] if role else [])
    if not about or named is None:
        return False
    where = state.namer.target(named[1])
    if state.namer.recording is None:
        return where in about
    ids = state.namer.ids(where)
    return any(ids & state.namer.ids(one) for one in about)


def _spare(what: str, edit: Entry, option: Entry, state: WishState) -> None:
    named = naming.begins(what.split(), state.nouns)
    place = next(
        (
            name
            for name in registry.operator(option["op"]).needs.targets
            if option.get(name) is not None
        ),
        None,
    )
    if (
        state.namer.recording is None
        or named is None
        or place is None
        or isinstance(option[place], list)
    ):
        raise NotUnderstood(
            f"{what!r} must not change, and the same wish asks for: {_short(option)}"
        )
    where = state.namer.target(named[1])
    ids = state.namer.ids(where)
    option[place] = state.namer.without(option[place], ids)
    state.notes.append(f"{what!r} is left out of {_short(edit)}")


def chance(part: str) -> tuple[str, float | None]:
    """A clause without the share of copies that it is meant for, and that. Raises NotUnderstood for no share."""
    for pattern in CHANCES:
        bare = "p9" in pattern
        lead = "" if bare else r"(?:(?<=, )|(?<= )|^)"
        found = re.search(rf"{lead}(?:{pattern})(?= |,|$)", part)
        if found is None or (bare and MEASURED.search(part)):
            continue
        given = {name: value for name, value in found.groupdict().items() if value}
        if word := given.get("w7") or given.get("w8"):
            share = PARTS[word]
        elif n := given.get("n5") or given.get("n6"):
            share = words.tidy(
                float(ORDINAL.get(given.get("k6", "1"), given.get("k6", 1)))
                / float(ORDINAL.get(n, n))
            )
        else:
            value = next(value for name, value in given.items() if name.startswith("p"))
            share = words.tidy(
                words.number(value) / (100 if any(name.startswith("c") for name in given) else 1)
            )
        if "c3" in given and not re.search(
            "copies|cases|time|episodes|runs|demos|recordings", found.group()
        ):
            continue
        if not 0 <= share <= 1:
            raise NotUnderstood(f"{found.group()!r} is no probability")
        rest = f"{part[: found.start()]} {part[found.end() :]}"
        return re.sub(r" +", " ", re.sub(r" ?,(?: ?,)*", ",", rest)).strip(" ,:"), share
    return part, None


def settings(text: str) -> tuple[str, dict[str, Any]]:
    """The wish without what it says about the whole recipe, and that."""
    found: dict[str, Any] = {}
    for name, pattern in SETTINGS:
        match = re.search(
            rf"(?:^|[,;] |(?<= )and |(?<= ))(?:{pattern})(?=$| ?[,;:]| (?:with|where|in which|and)\b)",
            text,
        )
        if match is None or (
            name == "copies" and re.match(r"(?:in|for) (?:half|most)", match.group())
        ):
            continue
        value = (match["value"] or "").strip()
        if name == "keep_originals":
            found[name] = True
        elif name == "select":
            found[name] = {"limit": int(words.number(value)) if value else 1}
        else:
            number = words.number(value)
            if number != int(number) or (number < 1 and name == "copies"):
                raise NotUnderstood(f"{value!r} is no number of copies")
            found[name] = int(number)
        rest = (
            re.sub(r"^ ?(?:with|where|in which) ", "make ", text[match.end() :])
            if name == "copies"
            else text[match.end() :]
        )
        text = (
            re.sub(r"(?:,|;| and| but|:)*$", "", text[: match.start()].strip())
            + " ; "
            + rest.strip(" ,;:")
        )
        text = re.sub(r"^(?:and|but) ", "", text.strip(" ,;:"))
    return text, found


def _undo(what: str | None, state: WishState, only: bool = False) -> bool:
    """Take earlier edits back. With `only` it may be no undoing after all, and False says so."""
    what = re.sub(r"^(?:the|that|my) ", "", what or "").strip()
    left = [edit for edit in state.edits if not called(what, edit)]
    if what in ("", "this", "that", "it"):
        left = list(state.edits[:-1])
    if len(left) == len(state.edits) or (
        only
        and not all(
            edit.get("op") in ("insert", "distractors", "duplicate")
            for edit in state.edits
            if edit not in left
        )
    ):
        if only:
            return False
        there = "; ".join(map(_short, state.edits))
        raise NotUnderstood(f"nothing that was asked for is called {what!r}; there is: {there}")
    state.edits, state.did, state.mention = left, True, None
    return True


def _back(what: str, state: WishState) -> None:
    """Things that were removed stay after all."""
    named = naming.begins(what.split(), state.nouns)
    if named is None:
        raise NotUnderstood(f"{what!r}: which thing is meant?")
    where, kept = state.namer.target(named[1]), list[Entry]()
    for edit in state.edits:
        if edit.get("op") != "remove" or edit["target"] != where:
            ids = (
                state.namer.ids(where)
                if edit.get("op") == "remove" and state.namer.recording
                else frozenset[int]()
            )
            if ids and ids & state.namer.ids(edit["target"]):
                edit = {**edit, "target": state.namer.without(edit["target"], ids)}
            kept.append(edit)
    if kept == state.edits:
        raise NotUnderstood(f"{what!r} was not removed")
    state.edits, state.did = kept, True


def _same(what: str, state: WishState) -> None:
    """The last edit once more, for another thing."""
    named, last = naming.begins(what.split(), state.nouns), state.edits[-1]
    place = (
        next((name for name in registry.operator(last["op"]).needs.targets if name in last), None)
        if "op" in last
        else None
    )
    if named is None or named[0] != len(what.split()) or place is None:
        raise NotUnderstood(f"the same for {what!r}: the edit before has no thing that it is about")
    where = state.namer.target(named[1])
    _take(
        Meant(edits=({**last, place: where},), mention=Mention(kind="target", target=where)),
        None,
        state,
        what,
    )


def _take(found: Meant, share: float | None, state: WishState, part: str) -> None:
    """Add what a clause means. A later look, size or light of the same thing takes the place of an earlier one's."""
    state.did = True
    state.mention = found.mention or state.mention
    told = [one.text for one in state.clause(part).tokens if one.kind == "thing"]
    given = all(one["op"] in SETTLED for edit in found.edits for one in edit.get("one_of", [edit]))
    state.about = (
        " and ".join(told)
        if given and len(told) == len(found.edits)
        else state.about
        if given
        else ""
    )
    state.verb = next(
        (
            word
            for word in part.split()[:3]
            if reading.CLASSES.get(word) in ("remove", "add", "move", "copy", "vary")
        ),
        state.verb,
    )
    state.notes += found.notes
    kept = len(state.fresh)
    for k in found.replaces:
        state.fresh = [one for one in state.fresh if one is not state.edits[k]]
        state.edits[k] = found.edits[0]
    for edit in () if found.replaces else found.edits:
        group = _key(edit)
        edit = {**edit, "probability": share} if share is not None else edit
        same = [k for k, other in enumerate(state.edits) if group and _key(other) == group]
        if _merged(edit, state):
            continue
        if same and _unsaid(state.edits[same[0]]):
            state.fresh = [one for one in state.fresh if one is not state.edits[same[0]]]
        if same and any(state.edits[same[0]] is one for one in state.fresh):
            if state.edits[same[0]] == edit:  # said twice
                continue
            if share is None or state.edits[same[0]].get("probability") is None:
                raise NotUnderstood(
                    f"two edits of one wish give one thing a {group[0] if group else ''}: {_short(edit)}"
                )
            same = []
        if same:
            state.notes.append(f"takes the place of: {_short(state.edits[same[0]])}")
            state.edits[same[0]] = edit
        else:
            state.edits.append(edit)
        state.fresh.append(edit)
    state.last = (part, state.fresh[kept:] if share is None and not found.replaces else [])
    if len(state.edits) > MOST * 4:
        raise NotUnderstood("too many edits: say them in several wishes")
    output = {"edits": list(found.edits), "notes": list(found.notes)}
    state.trace.append(Trace(stage=found.stage, by="words", input=part, output=output))


def _unsaid(edit: Entry) -> bool:
    """Does an edit give a look without saying which?"""
    return edit.get("color") == ANY or (edit["op"].endswith("texture") and "texture" not in edit)


def _merged(edit: Entry, state: WishState) -> bool:
    """Does an edit go on with the one before, of the same camera: where it looks then, how far it turns as well?"""
    if edit.get("op") != "camera_pose" or not state.fresh or "probability" in edit:
        return False
    before = state.fresh[-1].get("one_of", [state.fresh[-1]])
    if any(one["op"] != "camera_pose" or one["camera"] != edit["camera"] for one in before):
        return False
    exact = {"by", "turned", "toward"}
    if "toward" in edit and not exact & edit.keys() - {"toward"}:
        more = {"toward": edit["toward"]}
    elif (
        exact & {*edit, *(key for one in before for key in one)}
        or "turn" not in edit
        or edit.get("shift")
    ):
        return False
    else:
        more = {"turn": edit["turn"]}
    for one in before:
        one.update(more)
    return True


def _drawn(edits: list[Entry]) -> Iterator[Entry]:
    """Edits that give one thing one of several looks, each to a share of the copies, as one draw."""
    for edit in edits:
        alike = [
            one
            for one in edits
            if "probability" in one and "op" in one and _key(one) and _key(one) == _key(edit)
        ]
        if len(alike) < 2 or "probability" not in edit:
            yield edit
        elif edit is alike[0]:
            whole = words.tidy(sum(one["probability"] for one in alike))
            if whole > 1:
                raise NotUnderstood(f"shares of {whole:g} in all: {_short(edit)}")
            options = [
                {
                    **{n: v for n, v in one.items() if n != "probability"},
                    "weight": one["probability"],
                }
                for one in alike
            ]
            yield {"one_of": options, **({"probability": whole} if whole < 1 else {})}


def _key(edit: Entry) -> tuple[str, str] | None:
    """What an edit settles, and of what."""
    if "op" not in edit:
        return None
    group, role, named = (
        registry.operator(edit["op"]).settles,
        own_role(edit["op"]),
        registry.operator(edit["op"]).needs.targets,
    )
    if not group or (named and not role and not targets(edit)):
        return None  # without a target one is drawn
    return group, repr(targets(edit) or [{"role": role}])


def _short(edit: Entry) -> str:
    return ", ".join(f"{name} {value}" for name, value in edit.items())
