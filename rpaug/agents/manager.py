"""A whole wish into steps, and what holds for all of them: settings, chances, what must not change, what to undo."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from rpaug.agents import slots
from rpaug.agents.messages import Answer, Entry, Meant, Mention, NotUnderstood, Trace, Wish
from rpaug.agents.operation import meant

MOST_STEPS = 30
POLITE = re.compile(
    r"^(?:(?:please|kindly|ok|okay|hey|hi|now|then|also|and|next|finally|lastly|first|firstly|second|secondly|afterwards|"
    r"after that|could you|can you|would you|will you|i want you to|i would like you to|i'd like you to|i want to|"
    r"i would like to|i'd like to|let us|let's|just|in addition|additionally|so)\b[, ]*)+"
)
AFTER = re.compile(r"(?:[, ]+(?:please|too|as well|now|thanks|thank you|for me))+$")
BREAK = re.compile(
    r"(?:\s*[;.]\s+|\s*;\s*|,? and then |, then | then |,? but |,? (?=without )|, | and )"
)
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
UNDO = re.compile(r"(?:undo|forget|revert|cancel|take back)(?: (?P<what>[a-z0-9_ ]+))?")
UNDO_LAST = frozenset(
    f"{verb}{what}"
    for verb in ("undo", "revert", "cancel", "take back")
    for what in (
        "",
        " it",
        " that",
        " the last step",
        " the last edit",
        " the last change",
        " the last one",
        " last",
    )
)  # the whole round before, whatever it was
RESTART = re.compile(
    r"(?:start (?:over|again|afresh|from scratch)|forget everything|undo everything|clear the recipe)"
)
NOT = re.compile(
    r"(?:do not|don't|dont|never|must not|should not|without|not) (?P<verb>[a-z]+)(?P<rest>.*)"
)
KEEP = re.compile(
    r"(?:leave|keep) (?P<what>.+?) (?:alone|as (?:it is|it was|they are|is|recorded)|unchanged|untouched|the same|where (?:it is|they are))"
)
VAGUE = frozenset({"touch", "change", "alter", "edit", "modify", "move", "affect"})
ANY_WORK = frozenset({"anything", "nothing", "it", ""})
# What people call the edits they want undone, or left out.
CALLED = {
    **dict.fromkeys(("light", "lights", "lighting", "lamp", "lamps", "illumination"), ("light_color", "light_direction")),
    **dict.fromkeys(("camera", "cameras", "viewpoint", "view", "camera pose"), ("camera_pose",)),
    **dict.fromkeys(("noise",), ("sensor_noise",)), **dict.fromkeys(("blur",), ("sensor_blur",)),
    **dict.fromkeys(("jpeg", "compression"), ("sensor_jpeg",)), **dict.fromkeys(("exposure",), ("sensor_exposure",)),
    **dict.fromkeys(("distractor", "distractors", "clutter"), ("distractors",)),
    **dict.fromkeys(("background", "walls", "floor"), ("background_texture",)),
    **dict.fromkeys(("table", "table color", "table colour"), ("table_color", "table_texture")),
    **dict.fromkeys(("texture", "textures"), ("retexture", "table_texture", "background_texture", "stylize")),
    **dict.fromkeys(("color", "colour", "colors", "colours", "paint"), ("recolor", "table_color")),
    **dict.fromkeys(("size", "resizing"), ("object_size",)), **dict.fromkeys(("spread", "shuffle"), ("spread",)),
}  # fmt: skip
# Only one edit of such a group can hold for one target.
GROUPS = {
    **dict.fromkeys(("recolor", "table_color", "retexture", "table_texture", "background_texture", "stylize"), "look"),
    "object_size": "size", "light_color": "light colour", "light_direction": "light direction",
    **{f"sensor_{name}": f"sensor {name}" for name in ("noise", "blur", "jpeg", "exposure")},
    "remove": "removal", "move": "place", "physics": "material",
}  # fmt: skip
OWN_TARGET = {"table_color": "table", "table_texture": "table", "background_texture": "background"}


@dataclass
class _Round:
    """What has been gathered of one wish so far."""

    wish: Wish
    edits: list[Entry]
    settings: dict[str, Any]
    mention: Mention | None
    notes: list[str] = field(default_factory=list)
    fresh: list[Entry] = field(default_factory=list)  # edits of this wish
    barred: list[str] = field(default_factory=list)
    did: bool = False
    trace: list[Trace] = field(default_factory=list)

    def here(self) -> Wish:
        """The wish as the next step sees it."""
        return self.wish.model_copy(update={"edits": tuple(self.edits), "mention": self.mention})


def answer(wish: Wish) -> Answer:
    """What a wish comes to, by the grammar. Raises NotUnderstood, and then nothing of the wish holds."""
    text = normal(wish.said)
    if not text:
        raise NotUnderstood("nothing was said")
    settings = dict(wish.settings)
    text, found = _settings(text)
    settings.update(found)
    gathered = _Round(wish, list(wish.edits), settings, wish.mention, did=bool(found))
    if text:
        _run(text, gathered)
    _respect(gathered)
    if not gathered.did or not (gathered.edits or gathered.wish.edits):
        raise NotUnderstood(f"{wish.said!r}: that asks for no change, so there is nothing to do")
    steps = [one.input for one in gathered.trace]
    whole = Trace(
        stage="manager", by="grammar", input=wish.said, output={"steps": steps, "settings": found}
    )
    return Answer(
        edits=tuple(gathered.edits),
        settings=gathered.settings,
        mention=gathered.mention,
        notes=tuple(gathered.notes),
        trace=(whole, *gathered.trace),
    )


def normal(said: str) -> str:
    """Lower case, single spaces, no politeness, no mark at the end."""
    text = re.sub(r"[’`]", "'", said.lower())
    text = re.sub(r"\s+", " ", text).strip().rstrip("?!. ")
    text = text.replace("colour by", "color by")
    return AFTER.sub("", POLITE.sub("", text)).strip()


def _settings(text: str) -> tuple[str, dict[str, Any]]:
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


def _run(text: str, gathered: _Round) -> None:
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
    yield POLITE.sub("", text), ""
    for match in reversed(list(BREAK.finditer(text))):
        part, rest = text[: match.start()].strip(" ,;."), text[match.end() :].strip(" ,;.")
        if part and rest:
            yield POLITE.sub("", part), POLITE.sub("", rest) if "but" not in match.group() else rest


def _step(part: str, verb: str, gathered: _Round) -> str:
    """One step; returns its verb, which the next may leave out. Raises NotUnderstood and then changes nothing."""
    if RESTART.fullmatch(part):
        gathered.edits, gathered.fresh, gathered.mention, gathered.did = [], [], None, True
        return ""
    undo = UNDO.fullmatch(part)
    if undo:
        _undo(undo["what"], gathered)
        return ""
    if _barred(part, gathered):
        return verb
    either = re.fullmatch(r"either (.+?),? or (.+)", part)
    if either:
        _take(_alternatives([either[1], either[2]], gathered), None, gathered)
        return ""
    part, chance = _chance(part)
    own = part.split(" ")[0]
    try:
        found = _meant(part, gathered)
    except NotUnderstood:
        if not verb or not re.match(r"(?:the|its?|all|every|both|a|an|\d+|object|handle)\b", part):
            raise
        found, own = meant(f"{verb} {part}", gathered.here()), verb
    _take(found, chance, gathered)
    output = {"edits": list(found.edits), "notes": list(found.notes)}
    gathered.trace.append(Trace(stage=found.stage, by="grammar", input=part, output=output))
    return own


def _meant(part: str, gathered: _Round) -> Meant:
    """As it was said, or without the "instead" of a second thought."""
    try:
        return meant(part, gathered.here())
    except NotUnderstood:
        shorter = re.sub(
            rf" (?:instead|rather)(?: of {slots.ONE_COLOUR})?$|^(?:instead|rather),? ", "", part
        )
        if shorter == part or not gathered.edits:
            raise
        return meant(shorter, gathered.here())


def _chance(part: str) -> tuple[str, float | None]:
    for pattern in (rf"^{CHANCE},? (?P<rest>.+)$", rf"^(?P<rest>.+?),? {CHANCE}$"):
        match = re.search(pattern, part)
        if match:
            value = next(v for v in (match[f"p{k}"] for k in range(1, 6)) if v)
            share = 0.5 if value in ("half", "sometimes") else slots.share(value)
            if not 0 <= share <= 1:
                raise NotUnderstood(f"{value!r} is no probability")
            return match["rest"], share
    return part, None


def _alternatives(parts: Sequence[str], gathered: _Round) -> Meant:
    options: list[Entry] = []
    for part in parts:
        found = meant(POLITE.sub("", part), gathered.here())
        if len(found.edits) != 1 or found.replaces:
            raise NotUnderstood(f"{part!r} is no single edit, and `either` draws one of two")
        options += found.edits[0].get("one_of", found.edits)
    return Meant(edits=({"one_of": options},))


def _take(found: Meant, chance: float | None, gathered: _Round) -> None:
    """Add what a step means. A later look, size or light of the same thing takes the place of an earlier one's."""
    gathered.did = True
    gathered.mention = found.mention if found.mention else gathered.mention
    gathered.notes += found.notes
    for number in found.replaces:
        (edit,) = found.edits
        _forget_fresh(gathered, gathered.edits[number])
        gathered.edits[number] = edit
        gathered.fresh.append(edit)
        return
    taken = [_key(edit) for edit in gathered.fresh]
    for edit in found.edits:
        key = _key(edit)
        if key and key in taken:
            raise NotUnderstood(f"two edits of one wish give one thing a {key[0]}: {_short(edit)}")
        taken.append(key)
    for edit in found.edits:
        edit = {**edit, "probability": chance} if chance is not None else edit
        key = _key(edit)
        same = [k for k, other in enumerate(gathered.edits) if key and _key(other) == key]
        if same:
            gathered.notes.append(f"takes the place of: {_short(gathered.edits[same[0]])}")
            gathered.edits[same[0]] = edit
        else:
            gathered.edits.append(edit)
        gathered.fresh.append(edit)


def _forget_fresh(gathered: _Round, edit: Entry) -> None:
    gathered.fresh = [other for other in gathered.fresh if other is not edit]


def _key(edit: Entry) -> tuple[str, str] | None:
    """What an edit settles, and of what."""
    group = GROUPS.get(edit.get("op", ""))
    if group is None:
        return None
    if edit["op"] in OWN_TARGET:
        return group, repr({"role": OWN_TARGET[edit["op"]]})
    return group, repr(edit.get("target"))


def _short(edit: Entry) -> str:
    return ", ".join(f"{name} {value}" for name, value in edit.items())


def _undo(what: str | None, gathered: _Round) -> None:
    if not gathered.edits:
        raise NotUnderstood("there is nothing to undo")
    what = re.sub(r"^(?:the|that|my) ", "", what or "").strip()
    left = [edit for edit in gathered.edits if not called(what, edit)]
    if len(left) == len(gathered.edits):
        there = "; ".join(map(_short, gathered.edits))
        raise NotUnderstood(f"nothing that was asked for is called {what!r}; there is: {there}")
    gathered.edits = left
    gathered.did, gathered.mention = True, None


def called(what: str, edit: Entry) -> bool:
    """Do the words mean that edit: its kind, what it is about, or its operator's name?"""
    if "one_of" in edit:
        return any(called(what, option) for option in edit["one_of"])
    if edit["op"] in CALLED.get(what, ()) or what.replace(" ", "_") == edit["op"]:
        return True
    words = {_plain(word) for word in what.split()} - {"new", "extra", "added"}
    about = " ".join(
        str(value)
        for name in (
            "target",
            "targets",
            "category",
            "asset",
            "color",
            "near",
            "camera",
            "texture",
            "style",
            "material",
        )
        if name != "near" and (value := edit.get(name)) is not None
    )
    return bool(words) and words <= {
        _plain(word) for word in re.findall(r"[a-z0-9]+", about.lower())
    }


def _plain(word: str) -> str:
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word


def _barred(part: str, gathered: _Round) -> bool:
    """Is it a step that says what must not happen? It is kept, to be held against the edits at the end."""
    keep, negated = KEEP.fullmatch(part), NOT.fullmatch(part)
    if keep:
        gathered.barred.append(keep["what"])
        return True
    if negated is None:
        return False
    verb, rest = negated["verb"], negated["rest"].strip()
    stem = re.sub(r"ing$", "", verb)
    known = VAGUE | {_base(word) for word in VAGUE}
    if stem in known or stem + "e" in known:
        gathered.barred.append(rest)
        return True
    for base in (verb, stem, stem + "e", stem[:-1]):
        try:
            found = meant(f"{base} {rest}".strip(), gathered.here())
        except NotUnderstood:
            continue
        gathered.barred += [_about(edit) for edit in found.edits]
        return True
    raise NotUnderstood(f"{part!r}: it is not clear what must not happen")


def _base(word: str) -> str:
    return word.removesuffix("e")


def _about(edit: Entry) -> str:
    """The target of an edit in words, or what its operator is called."""
    target = edit.get("target")
    if isinstance(target, str):
        return target
    if isinstance(target, dict):
        return str(target.get("role") or target.get("text") or target.get("handle"))
    return str(OWN_TARGET.get(edit["op"], edit["op"]))


def _respect(gathered: _Round) -> None:
    """Hold what must not happen against the edits of this wish. Raises NotUnderstood."""
    for what in gathered.barred:
        words = re.sub(
            r"^(?:the|all|any|anything about|of) ", "", re.sub(r"^(?:all )?the ", "", what)
        ).strip()
        if words in ANY_WORK and gathered.fresh:
            raise NotUnderstood("the wish asks for edits and forbids all of them")
        for edit in gathered.fresh:
            own = OWN_TARGET.get(edit.get("op", ""))
            if called(words, edit) or _about_all(words, edit) or own == words:
                raise NotUnderstood(
                    f"{what!r} must not change, and the same wish asks for: {_short(edit)}"
                )


def _about_all(words: str, edit: Entry) -> bool:
    return "op" in edit and _about(edit) == words
