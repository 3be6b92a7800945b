"""What a clause says of how things look: a color, a texture or a style, one of several, or another one's."""

import colorsys
from typing import Any

from rpaug.assets.textures import shipped
from rpaug.core import color_space
from rpaug.language import things, values
from rpaug.language.lexicon import group
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood, Wish
from rpaug.language.placing import anything, asset, one_of
from rpaug.language.things import Named, Namer, Target, every
from rpaug.language.tokens import Clause, Token, said
from rpaug.scene.targets import roles
from rpaug.scene.targets.relations import GRIPS, PARTS, singular

TABLE, BACKGROUND = {"role": "table"}, {"role": "background"}
ANY = {"sample": "colosseum"}
SHAKEN = group("looks_shaken")
"""Ways to vary where something is, not how it looks."""
OTHER = frozenset(["other", "another", "different"])
"""Said of a look, that it is not the one that a thing is named by."""
LIST = ("color", "texture", "thing", "and", "or", "filler", "paint", "any")
FLAT = frozenset(["plain", "uniform"])
CLOSE = 1 / 6 + 1e-6  # of a turn: how near the hue of what is no other color may be
OWN = {str(TABLE): "table_texture", str(BACKGROUND): "background_texture"}


def replaced(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """A thing is gone, and a new one stands near where it was."""
    at = next((k for k, one in enumerate(clause.tokens) if one.text in ("by", "with", "for")), None)
    new = [one.value for one in clause.tokens[at or 0 :] if one.kind == "thing" and one.value.fresh]
    if (
        at is None
        or not new
        or not clause.says("replace", "exchange", "substitute", "swap")
        or clause.has("color", "texture")
    ):
        return None
    if [one.words for one in new] == [new[0].words] and new[0].words.split()[-1] == "one":
        return None
    (old, *others) = clause.things()
    clause.every("or", "thing", "swap")
    where, options, notes = namer.target(old), list[Entry](), list[str]()
    if others:
        raise NotUnderstood(f"{clause.text!r}: one thing at a time, please")
    for one in new:
        fields, told = asset(one.words, None, wish.setting.generates)
        options.append({"op": "insert", **fields, "near": where})
        notes += told
    notes.append(f"what takes the place of {old.words!r} stands near where that was")
    gone: Entry = {"op": "remove", "target": where}
    return Meant(edits=(one_of(options), gone), mention=Mention(kind="new"), notes=tuple(notes))


def swapped(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """Two things exchange their colors, as they are measured; or a thing's look is exchanged for another."""
    if not clause.has("swap") or not clause.has("thing") or clause.has("light"):
        return None
    clause.every("swap")
    _again(clause)
    if clause.has("color", "texture", "vary", "lay"):
        _of_the_new(clause)
        return painted(clause, wish, namer)
    if not clause.every("paint"):
        raise NotUnderstood(
            f"{clause.text!r}: only `swap the colors of ...` two things; for another look name it: `make ... walnut`"
        )
    named = [*clause.things(), *clause.things()]
    targets = [namer.target(one) for one in named]
    if len(targets) == 1 and isinstance(targets[0], str):
        targets = [{"text": singular(targets[0]), "all": True}]
    groups = [group for one in targets for group in namer.groups(one)]
    if len(groups) != 2:
        raise NotUnderstood(
            f"{clause.text!r}: {len(groups)} things; colors are swapped between two"
        )
    tints = {row["id"]: row["color"] for row in namer.rows}
    first, second = (sorted(group) for group in groups)
    return Meant(
        edits=(
            {"op": "recolor", "target": {"handle": first}, "color": tints[second[0]]},
            {"op": "recolor", "target": {"handle": second}, "color": tints[first[0]]},
        )
    )


def _again(clause: Clause) -> None:
    """ "turn the red can into a blue one", "make it a green can": the noun said once more only brings its new look."""
    at = [k for k, one in enumerate(clause.tokens) if one.kind == "thing"]
    if len(at) != 2:
        return
    old, new = (clause.tokens[k] for k in at)
    noun = new.value.words.split()[-1]
    alike = singular(noun) in ("one", *map(singular, old.value.words.split()[-1:]))
    led = any(
        one.kind == "to" or one.text in ("for", "with", "by")
        for one in clause.tokens[at[0] : at[1]]
    )
    pronoun = old.value.pronoun and new.value.fresh and at[1] == at[0] + 1
    if not ((alike and led) or pronoun):
        return
    words = new.value.words.split()
    size, fits = values.texture(words)
    color = values.color(words, 0)
    if len(words) == 1 or max(size, color[0] if color else 0) != len(words) - 1:
        return
    look = (
        Token("texture", new.text, fits)
        if size
        else Token("color", new.text, color[1] if color else [])
    )
    clause.tokens[at[1]] = look
    if pronoun and not alike:
        clause.tokens[at[0]] = Token("thing", noun, Named(noun))


def _alike(clause: Clause, namer: Namer) -> None:
    """ "the same color as the box": what the box was recorded in. Raises NotUnderstood for other likenesses."""
    at = next((k for k, one in enumerate(clause.tokens) if one.kind == "same"), len(clause.tokens))
    to = next(
        (k for k in range(at, len(clause.tokens)) if clause.tokens[k].text in ("as", "like", "of")),
        None,
    )
    if to is None or to + 1 == len(clause.tokens) or clause.tokens[to + 1].kind != "thing":
        return
    if [one.kind for one in clause.tokens[at + 1 : to]] not in (["paint"], ["paint", "to"]):
        raise NotUnderstood(f"{clause.text!r}: only a color can be the same as another thing's")
    other = clause.tokens[to + 1]
    tint = namer.color(namer.target(other.value))
    namer.notes.append(f"the color of {other.value.words!r} is {tint}")
    clause.tokens[at : to + 2] = [Token("color", said(clause.tokens[at : to + 2]), [tint])]


def _of_the_new(clause: Clause) -> None:
    """ "swap the floor planks for gray concrete": what stands before "for" only says what is there."""
    at = next((k for k, one in enumerate(clause.tokens) if one.text in ("for", "with", "by")), None)
    if at is None or not any(one.kind in ("color", "texture") for one in clause.tokens[at:]):
        return
    for one in [one for one in clause.tokens[:at] if one.kind in ("color", "texture")]:
        clause.take(one)


def shade(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """Darker or lighter than the color that was asked for before, or than the recorded one."""
    if not clause.has("darker", "brighter") or not clause.has("thing"):
        return None
    dark, light = bool(clause.every("darker")), bool(clause.every("brighter"))
    clause.every("little", "paint", "much")
    named = clause.things()
    if (dark and light) or len(named) > 1:
        raise NotUnderstood(f"{clause.text!r}: darker or lighter, one thing after the other")
    before = [edit["target"] for edit in wish.edits if edit.get("op") == "recolor"]
    mention = wish.mention
    alone = (
        named[0].pronoun
        and (mention is None or mention.kind in ("camera", "new"))
        and len(before) == 1
    )
    where = before[0] if alone else namer.target(named[0])
    notes = (f"'it' is taken to mean what was painted: {where}",) if alone else ()
    about, factor = Mention(kind="target", target=where), 0.6 if dark else -0.4
    for k, edit in reversed(list(enumerate(wish.edits))):
        if edit.get("op") == "recolor" and edit["target"] == where:
            tint = {"rgb": values.shaded(edit["color"], factor)}
            return Meant(
                edits=({**edit, "color": tint},), mention=about, notes=notes, replaces=(k,)
            )
    word = "darker" if dark else "lighter"
    if namer.recording is not None:
        ids = namer.ids(where)
        tints = {row["color"] for row in namer.rows if row["id"] in ids}
        if len(tints) == 1:
            tint = {"rgb": values.shaded(tints.pop(), factor)}
            note = f"{word} than the color that it was recorded in, as far as that has a name"
            return Meant(
                edits=({"op": "recolor", "target": where, "color": tint},),
                mention=about,
                notes=(note,),
            )
    raise NotUnderstood(
        f"{word} than what? name a color: only one that was asked for before has a darker one"
    )


def painted(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """A color, a texture or a style, or one of several, for what is named."""
    _other(clause)
    unnamed = not clause.has("thing", "all", "rest", "strangers")
    if unnamed and not (clause.has("on") and clause.has("texture", "lay")):
        return None
    _again(clause)
    _alike(clause, namer)
    apart, banned = _excepted(clause)
    notes = ["gloss stays as it was recorded"] if clause.every("gloss") else []
    several = _listed(clause) or clause.has("or")
    tints, pictures = clause.every("color"), clause.every("texture")
    clause.every("or")
    styled, laid, plain = (bool(clause.every(one)) for one in ("style", "lay", "paint"))
    at_table, anyhow = clause.every("on", "add") if unnamed else [], clause.every("vary", "any")
    tints = _not_its_own(clause, tints, anyhow)
    if anyhow and {one.text for one in anyhow} <= SHAKEN and not (laid or plain or tints):
        return None
    if plain and laid and anyhow:
        raise NotUnderstood(f"{clause.text!r}: one thing after the other, please")
    width = clause.single("length") if pictures else []
    clause.every("width")
    if not pictures and _counted(clause, notes):
        anyhow = anyhow or [Token("any", "any")]
    same, each = bool(clause.every("same")), bool(clause.every("each")) or _varied(anyhow)
    whole = clause.has("all") and not (tints or pictures or banned or laid or plain or styled)
    named, places_of = _meant(clause, namer, apart, at_table)
    pictures = _described(pictures, anyhow, laid)
    _told_apart(clause, tints, pictures, several)
    if len(named) == 1 and not (tints or pictures or banned or laid or plain or styled or anyhow):
        named, tints, pictures = _own_look(named[0], namer, bool(notes))
    if not (tints or pictures or anyhow or banned or laid or plain or styled):
        return None
    only, places_of = _on_handle(named, tints, places_of, namer, notes)
    each |= bool(anyhow) and any(one.text.startswith("each of") for one in clause.taken)
    places = places_of if places_of is not None else _places(namer, named, apart, each and not same)
    if not places:
        raise NotUnderstood(f"{clause.text!r}: which thing is meant?")
    if same and len(places) > 1 and not (tints or pictures or laid or styled):
        tints = [Token("color", "", [namer.color(places[0])])]
        notes.append(f"the color of the first that was named: {tints[0].value[0]}")
    if same and len(places) > 1:
        places = [{"handle": sorted(frozenset[int]().union(*map(namer.ids, places)))}]
    looks = _looks(tints, pictures, laid, styled, banned)
    if tints and not only and _flat(tints, clause):
        looks = [{"texture": _word(one["color"])} if "color" in one else one for one in looks]
    more = only | ({"scale": width[0].low} if width else {})
    edits = [
        one_of([{**_look(where, look), **(only if "color" in look else more)} for look in looks])
        for where in places
    ]
    if whole:
        edits.append({"op": "light_color"})
        notes.append("everything is taken as all colors and the light, cameras as they are")
    mention = Mention(kind="target", target=places[0]) if len(places) == 1 else None
    return Meant(edits=tuple(edits), mention=mention, notes=tuple(notes))


def _not_its_own(clause: Clause, tints: list[Token], anyhow: list[Token]) -> list[Token]:
    """The colors that are drawn without that which the thing is named by, where another is wished for."""
    words = {word for one in tints for word in one.text.split()} | {one.text for one in anyhow}
    spoken = [
        word for one in clause.tokens if one.kind == "thing" for word in one.value.words.split()
    ]
    own = [tint for word in spoken if (tint := color_space.canonical(word))]
    if not own or not words & OTHER:
        return tints
    return [
        Token("color", one.text, [left for tint in one.value for left in values.apart(tint, own)])
        for one in tints
    ]


def _on_handle(
    named: list[Named],
    tints: list[Token],
    places: list[Target] | None,
    namer: Namer,
    notes: list[str],
) -> tuple[Entry, list[Target] | None]:
    """Where a tool's handle gets a color: what of the tool is of the handle's color, and the tool."""
    part = _handle(named[0], namer) if tints and len(named) == 1 else None
    if part is None:
        return {}, places
    notes.append(f"the handle is taken as what is {part[1]} of the {part[2]}")
    return {"only": part[1]}, [part[0]]


def _word(tint: Any) -> str:
    """The nearest color word. Raises NotUnderstood for colors that are drawn."""
    return (
        tint
        if isinstance(tint, str)
        else color_space.nearest(color_space.np.array(values.rgb(tint)))
    )


def _flat(tints: list[Token], clause: Clause) -> bool:
    """Is a color to hide what is drawn on a thing: "plain white", "plain walls in white", "no pattern"?"""
    told = [one.text for one in tints]
    told += [
        one.text for one in clause.taken if one.kind == "thing" and not one.text.startswith("the ")
    ]
    return any(FLAT & set(one.split()) for one in told) or clause.says("no pattern")


def _other(clause: Clause) -> None:
    """ "another table" has another look. Raises NotUnderstood for "another cup in green", which may be a new one."""
    for one in [
        one for one in clause.tokens if one.kind == "thing" and one.text.startswith("another ")
    ]:
        if one.value.words not in (*things.ROLES, *roles.NAMES, *things.FLOOR, *things.WALL):
            raise NotUnderstood(
                f"{one.text!r}: a new one (`add {one.text}`), or another look (`the {one.value.words}`)?"
            )
        clause.tokens.append(Token("vary", "another"))


def _listed(clause: Clause) -> bool:
    """Are looks named side by side, of which each copy gets one: "in 3 colors: red, green, blue"?"""
    at = [k for k, one in enumerate(clause.tokens) if one.kind in ("color", "texture")]
    joined = {clause.tokens[k].text for k in range(at[0], at[-1]) if k not in at} if at else set()
    plural = all(  # "whites and reds"
        clause.tokens[k].kind == "color" and clause.tokens[k].text.split()[-1] not in values.TINTS
        for k in at
    )
    one_pair = len(at) == 2 and "," not in joined and not plural
    if len(at) < 2 or not joined <= {",", "and", "or"} or one_pair:
        return False
    counted = next((one for one in clause.tokens if one.kind == "number"), None)
    if counted and counted.value.low == len(at):
        clause.take(counted)
    return True


def _described(pictures: list[Token], anyhow: list[Token], laid: bool) -> list[Token]:
    """The textures that are asked for: "the wooden table" that is to vary is wooden already."""
    if not anyhow or laid:
        return pictures
    return [one for one in pictures if not one.text.startswith("the ")]


def _counted(clause: Clause, notes: list[str]) -> bool:
    """Is it said of how many colors one is drawn, "in 10 colors"? Then a note tells that each copy draws anew."""
    if not (clause.has("number") and clause.says("colors", "textures", "materials")):
        return False
    (count,) = clause.single("number")
    notes.append(f"drawn anew for each copy, not from {count.low:g} set ones")
    return True


def _told_apart(clause: Clause, tints: list[Token], pictures: list[Token], several: bool) -> None:
    """Raises NotUnderstood for two looks of one thing, and for colors of a pattern, "checkered, red/white"."""
    if len(tints) + len(pictures) > 1 and not several:
        raise NotUnderstood(f"{clause.text!r}: one look for each thing, please")
    told = [one.text for one in (*tints, *pictures)]
    drawn = any(isinstance(look, dict) for one in pictures for look in one.value)
    if len(set(told)) < len(told) or (drawn and tints and len(told) > 2):
        raise NotUnderstood(
            f"{clause.text!r}: a texture by its name, or colors, one after the other"
        )


def _varied(anyhow: list[Token]) -> bool:
    """Is each of several things to look different?"""
    return any(one.text in ("different", "various", "another") for one in anyhow)


def _meant(
    clause: Clause, namer: Namer, apart: list[Named], at_table: list[Token]
) -> tuple[list[Named], list[Target] | None]:
    """The things that are named, or the places of all things, or of all but some, if that was said."""
    strangers, rest, everything = (
        clause.every("strangers"),
        clause.every("rest"),
        clause.every("all"),
    )
    if not (strangers or rest or everything):
        return clause.things() or ([Named("table")] if at_table else []), None
    clause.every("thing")
    if strangers and not (rest or everything):
        return [], [{"handle": [one]} for one in sorted(namer.strangers())]
    if rest and not (apart or namer.kept):
        raise NotUnderstood(f"{clause.text!r}: the rest beside what?")
    return [], _all_but(namer, [*apart, *namer.kept])


def _all_but(namer: Namer, apart: list[Named]) -> list[Target]:
    """Everything in its parts: what plays a role by that, each other thing for itself, less what is kept."""
    kept = namer.all_ids(apart)
    out: list[Target] = []
    for role in ("background", "table", "receiver", "manipulated", "robot"):
        ids = frozenset(row["id"] for row in namer.rows if row.get("role") == role)
        if ids - kept and not (role == "robot" and ids & kept):
            out.append({"role": role} if not ids & kept else {"handle": sorted(ids - kept)})
    return [*out, *({"handle": [one]} for one in sorted(namer.strangers() - kept))]


def _excepted(clause: Clause) -> tuple[list[Named], list[Any]]:
    """The things, or else the colors, that a clause names as those that are not meant."""
    if not clause.has("not"):
        return [], []
    left_out = _behind_not(clause)
    banned = [one for one in left_out if one.kind == "color"]
    for one in (pictures := [one for one in left_out if one.kind == "texture"]):
        clause.take(one)
    if pictures:
        clause.every("not")
    tiled = [
        one.text for one in clause.tokens if one.kind == "thing" and one.text.endswith("tiles")
    ]
    if pictures and tiled:
        raise NotUnderstood(
            f"{clause.text!r}: which tiles? say it so: `make the floor tiles_white`"
        )
    if pictures and not clause.has("texture"):  # "another one, not wood"; else "marble, not wood"
        return [], [name for one in pictures for name in _named_textures(one)]
    apart = clause.things("not")
    clause.every("not")
    if apart or not banned:
        return apart, []
    if any(not isinstance(tint, str) for one in banned for tint in one.value):
        raise NotUnderstood(f"{clause.text!r}: colors are left out by their names")
    for one in banned:
        clause.take(one)
    if clause.has("color"):  # "blue, not red", "pastel, but no pink"
        _narrowed(clause, [tint for one in banned for tint in one.value])
        return [], []
    if not clause.has("any", "vary", "paint"):
        raise NotUnderstood(
            f"{clause.text!r}: which color then? `any color but ...` draws one of the others"
        )
    return [], [tint for one in banned for tint in one.value]


def _behind_not(clause: Clause) -> list[Token]:
    """The looks that stand behind a "not", as far as its list goes: "not red or pink, pick ...", "not red but blue"."""
    out, behind = list[Token](), False
    for one in clause.tokens:
        behind = one.kind == "not" or (behind and one.kind in LIST and one.text != "but")
        out += [one] if behind and one.kind in ("color", "texture") else []
    return out


def _narrowed(clause: Clause, banned: list[Any]) -> None:
    """Take colors out of those that are drawn by hue, saturation and value."""
    for k, one in enumerate(clause.tokens):
        if one.kind == "color":
            left = [part for tint in one.value for part in values.apart(tint, banned)]
            clause.tokens[k] = Token("color", one.text, left)


def _named_textures(token: Token) -> list[str]:
    """The names of the textures that a token means, those of a kind each."""
    return [
        name
        for one in token.value
        for name in (shipped.KINDS[one["sample"]] if isinstance(one, dict) else [one])
    ]


def _own_look(
    named: Named, namer: Namer, told: bool
) -> tuple[list[Named], list[Token], list[Token]]:
    """A thing and the look that was said before its noun, where nothing of that look is there: "a brick wall".

    `told`: the look is meant in any case.
    """
    spoken = named.words.split()
    size, fits = values.texture(spoken)
    color = values.color(spoken, 0)
    taken = size or (color[0] if color else 0)
    noun = Named(" ".join(spoken[taken:]), named.several)
    if not 0 < taken < len(spoken) or not _there(noun, namer):
        return [named], [], []
    if not told and noun.words not in (*things.ROLES, *roles.NAMES) and _there(named, namer):
        return [named], [], []
    if size:
        return [noun], [], [Token("texture", "", fits)]
    assert color is not None
    return [noun], [Token("color", "", color[1])], []


def _there(named: Named, namer: Namer) -> bool:
    """Is there such a thing in the recording? Without one only the roles are."""
    if namer.recording is None:
        return named.words in (*things.ROLES, *roles.NAMES)
    return namer.there(named)


def _handle(named: Named, namer: Namer) -> tuple[Target, str, str] | None:
    """The tool whose handle is named, the color of most of it and its name, where no mask shows the handle apart."""
    parts = named.words.split()
    if "of" in parts[1:-1] and parts[0] in GRIPS:
        parts = [*parts[parts.index("of") + 1 :], parts[0]]
    if (
        parts[-1] not in GRIPS
        or (parts[-2:-1] and parts[-2] in PARTS)
        or namer.recording is None
        or _there(named, namer)
    ):
        return None
    told = [one for one in parts[:-1] if one != "the" and not color_space.canonical(one)]
    tool = Named(" ".join(told)) if told else Named("manipulated")
    if not _there(tool, namer):
        return None
    ids = namer.ids(namer.target(tool))
    shown = [row for row in namer.rows if row["id"] in ids and "shows" in row]
    if len(shown) != 1:
        return None
    where = namer.target(tool) if len(ids) == 1 else {"handle": [shown[0]["id"]]}
    return where, shown[0]["shows"][0], tool.words


def _places(namer: Namer, named: list[Named], apart: list[Named], each: bool) -> list[Target]:
    """What gets a look: each thing that is named, less what is not meant."""
    if apart and anything(named):
        return [namer.but(apart)]
    if apart:
        kept = namer.all_ids(apart)
        return [namer.without(every(namer.counted(one)), kept) for one in named]
    targets = [every(namer.counted(one)) if one.several else namer.target(one) for one in named]
    if each and namer.recording:
        groups = [group for one in targets for group in namer.groups(every(one))]
        return [{"handle": sorted(group)} for group in groups] if len(groups) > 1 else targets
    return targets


def _looks(
    tints: list[Token], pictures: list[Token], laid: bool, styled: bool, banned: list[Any]
) -> list[Entry]:
    """The looks of which one is given."""
    if set(banned) & set(shipped.NAMES):
        return [{"texture": name} for name in shipped.NAMES if name not in banned]
    if banned:
        own = [
            name for name in color_space.RLBENCH if not any(_near(str(one), name) for one in banned)
        ]
        return [{"color": name} for name in own]
    if styled:
        return [{"style": one} for one in pictures[0].value] if pictures else [{"style": None}]
    if pictures or tints:
        kinds = (("texture", pictures), ("color", tints))
        sizes = {len(one.value) for one in (*pictures, *tints)}
        return [
            {kind: look} | ({"weight": values.tidy(1 / len(token.value))} if len(sizes) > 1 else {})
            for kind, every in kinds
            for token in every
            for look in token.value
        ]
    return [{"texture": None}] if laid else [{"color": ANY}]


def _near(banned: str, name: str) -> bool:
    """Could a color be taken for one that must not be: of its name, or a third of the way round the hues or less?"""
    (first, *one), (second, *other) = (
        colorsys.rgb_to_hsv(*color_space.rgb(each)) for each in (banned, name)
    )
    apart = abs(first - second)
    hued = one[0] > 0 and other[0] > 0
    return color_space.akin(banned, name) or (hued and min(apart, 1 - apart) <= CLOSE)


def _look(where: Target, look: Entry) -> Entry:
    """The edit that gives one thing one look."""
    if "color" in look:
        if look["color"] == ANY and where == TABLE:
            return {"op": "table_color"}
        return {"op": "recolor", "target": where, **look}
    given = {name: value for name, value in look.items() if value is not None}
    if "style" in look:
        return {"op": "stylize", "target": where, **given}
    own = OWN.get(str(where))
    return {"op": own, **given} if own else {"op": "retexture", "target": where, **given}
