"""What a clause says of lamps, their brightness, color and direction, and of what a sensor does to images."""

import math

from rpaug.core import color_space
from rpaug.language.lexicon import group
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood, Wish
from rpaug.language.things import Namer
from rpaug.language.tokens import WEAK, Clause, Token
from rpaug.language.values import Amount, rgb, tidy
from rpaug.language.viewing import excepted

RECORDED = 0.5  # the lamps' recorded brightness in `light_color`'s unit
WARM, COOL = (0.5, 0.42, 0.32), (0.38, 0.44, 0.5)
EVENING = 0.8  # times as bright as recorded
NEUTRAL = 6500  # kelvin, of sRGB's white
LIFT = 0.64  # radians: how high a lamp stands at a side, where no angle was named
LIGHT = Mention(kind="light")
LEVELS = group("lights_levels")
TURNED = group("lights_turned")
PLACES = ("else", "elsewhere", "sides", "directions")
"""How words end by which a lamp stands somewhere else."""
VARIED = ("color", "intensity", "brightness", "temperature")
SENSED: dict[str, tuple[str, tuple[str, ...], float]] = {
    "noise": ("read", ("share", "number"), 0.0),
    "blur": ("sigma", ("pixels", "number"), 0.3),
    "jpeg": ("quality", ("number", "share"), 30),
}
"""What of a sensor's fault an amount says, in which units, and from where on "up to" goes."""

TIMES = "contrast", "saturation"
"""What of what is displayed is so many times as recorded."""

AFTER = {
    *SENSED,
    "little",
    "much",
    "and",
    "filler",
    "to",
    "pixels",
    "number",
    "share",
    "stops",
    "darker",
    "brighter",
}
"""Kinds of tokens of a sensor's fault that goes on with the cameras of the one before."""


def light(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """The lamps' direction, their strength and color, or both."""
    lamp, lit = clause.has("light"), clause.has("lit")
    toned = clause.has("darker", "brighter", "warm", "cool", "kelvin")
    ours = wish.mention is None or wish.mention.kind == "light"
    things = [one for one in clause.tokens if one.kind == "thing"]
    sided = lamp and clause.has("left", "right")
    spoken = [
        one
        for one in things
        if (one.value.pronoun and ours) or (sided and one.value.words == "robot")
    ]
    if _of_paint(clause, wish):
        return None
    if lamp:
        _tinted(clause, things)
    everything = clause.every("all", "image") or spoken
    if not (lamp or lit) and not (
        toned and (everything or not things) and not clause.has("texture", "color")
    ):
        return None
    clause.tokens = [
        one
        for one, after in zip(clause.tokens, [*clause.tokens[1:], None], strict=True)
        if not any(one is other for other in spoken)
        and not (one.text == "one" and after and after.kind == "light")
    ]
    colored = any(
        word in one.text for one in clause.tokens if one.kind == "light" for word in VARIED
    )
    clause.every("light", "much", "size_of", "on", "all", "swap", "add")
    edits, notes, varied = (
        list[Entry](),
        list[str](),
        [one for one in clause.tokens if one.kind in ("vary", "any")],
    )
    turned = clause.has(*TURNED) or (
        clause.has("up") and (clause.says("above") or not clause.has("share", "more", "brighter"))
    )
    moved = any(one.kind == "vary" and one.text.endswith(PLACES) for one in clause.tokens)
    if turned or moved:
        clause.every("lit", "move", "rotate", "pan", "tilt")
        edits.append(_direction(clause, namer, notes))
        clause.tokens += varied if colored else []
    if not edits or clause.has(*LEVELS, "color") or (colored and clause.has("vary", "any")):
        found = _level(clause, wish)
        if found.replaces:
            return found
        edits += found.edits
        notes += found.notes
    clause.every("vary", "any", "from")
    return Meant(edits=tuple(edits), mention=LIGHT, notes=tuple(notes))


def _of_paint(clause: Clause, wish: Wish) -> bool:
    """Is a bare "darker" said of the thing that was painted last?"""
    bare = {one.kind for one in clause.tokens} <= {"darker", "brighter", "little", "much", *WEAK}
    mention = wish.mention
    if not bare or mention is None or mention.kind != "target":
        return False
    return any(one.get("op") == "recolor" and one["target"] == mention.target for one in wish.edits)


def _tinted(clause: Clause, things: list[Token]) -> None:
    """ "swap the lamps for cyan ones": the color of what is called by nothing else is the light's."""
    for one in things:
        tint = one.value.words.removesuffix("s").removesuffix(" one")
        if tint != one.value.words and color_space.canonical(tint):
            clause.tokens[clause.tokens.index(one)] = Token("color", one.text, [tint])


def _level(clause: Clause, wish: Wish) -> Meant:
    """How strong the lamps are, and of what color."""
    mild, compared = bool(clause.every("little")), clause.has("less", "more")
    darker, brighter = clause.every("darker"), clause.every("brighter")
    less, more = (
        bool([*darker, *clause.every("down", "less")]),
        bool([*brighter, *clause.every("up", "more")]),
    )
    warm, cool, kelvin = clause.every("warm"), clause.every("cool"), clause.single("kelvin")
    color = clause.one("color")
    if warm and cool:
        raise NotUnderstood(f"{clause.text!r}: warm or cold? `either ... or ...` draws one")
    if kelvin and ((cool and kelvin[0].low <= NEUTRAL) or (warm and kelvin[0].high >= NEUTRAL)):
        raise NotUnderstood(
            f"{clause.text!r}: {NEUTRAL} K is the recorded light's white here; warm light has less, cold light more"
        )
    shares = clause.amounts("share", "times", "number")
    factor = 2.0 if clause.every("twice") else 0.5 if clause.every("halve") else None
    before = next(
        (
            k
            for k, one in enumerate(wish.edits)
            if one.get("op") == "light_color"
            and one.keys() & {"range", "temperature", "brightness"}
        ),
        None,
    )
    if before is not None and not (shares or kelvin or color) and _compared(clause):
        return _relative(wish.edits[before], before, less, more, bool(warm), bool(cool), mild)
    if not (shares or less or more or warm or cool or kelvin or color or factor):
        if clause.every("vary", "any", "paint"):
            return Meant(edits=({"op": "light_color"},), mention=LIGHT)
        raise NotUnderstood(f"{clause.text!r}: what about the light?")
    clause.every("paint")
    ends = [[RECORDED * one for one in _unit(warm, cool)]]
    if color:
        ends = [[RECORDED * (0.5 + 0.5 * v) for v in rgb(one)] for one in color.value]
        if clause.has("color"):
            raise NotUnderstood(f"{clause.text!r}: one color of light, or `either ... or ...`")
    if less and more and clause.every("or") and len(shares) == 1:  # "brighter or darker by 30%"
        shares, less, more = [Amount(shares[0].high, shares[0].high, "about")], False, False
    low, high = (factor, factor) if factor else _factors(clause, shares, less, more, mild)
    if shares and compared and shares[0].high < 1:
        low, high = sorted(1 + (-one if less else one) for one in (shares[0].low, shares[0].high))
    if kelvin:
        edit: Entry = {"op": "light_color", "temperature": [kelvin[0].low, kelvin[0].high]}
        edit |= {"brightness": [tidy(low), tidy(high)]} if (low, high) != (1, 1) else {}
        return Meant(edits=(edit,), mention=LIGHT)
    if (
        not shares
        and not more
        and any(word in one.text for one in warm for word in ("evening", "sunset", "afternoon"))
    ):
        low = high = EVENING
    if not (color or warm or cool):
        return _bright(low, high)
    return _lit([tidy(v * low) for v in ends[0]], [tidy(v * high) for v in ends[-1]])


def _compared(clause: Clause) -> bool:
    """Is it said against what was asked for before: "darker", "a bit less dark"?"""
    return any(word.endswith("er") or word in ("less", "more") for word in clause.text.split())


def _unit(warm: list[Token], cool: list[Token]) -> tuple[float, ...]:
    tone = WARM if warm else COOL if cool else (RECORDED,) * 3
    return tuple(one / RECORDED for one in tone)


def _lit(low: list[float], high: list[float]) -> Meant:
    _see(2 * max(low), 2 * max(high))
    told = "each channel of the light is drawn by itself, so its tint varies"
    notes = () if low == high else (told,)
    return Meant(edits=({"op": "light_color", "range": [low, high]},), mention=LIGHT, notes=notes)


def _bright(low: float, high: float) -> Meant:
    """All channels alike: of a `range` each would be drawn by itself."""
    _see(low, high)
    edit: Entry = {"op": "light_color", "brightness": [tidy(low), tidy(high)]}
    return Meant(edits=(edit,), mention=LIGHT)


def _see(low: float, high: float) -> None:
    """Raises NotUnderstood for times the recorded brightness that lamps cannot have."""
    if low <= 0 or high > 1 / RECORDED:
        wrong = low if low <= 0 else high
        raise NotUnderstood(
            f"lamps can be from above 0 to 2 times as bright as recorded, not {tidy(wrong):g}"
        )


def _relative(
    edit: Entry, number: int, less: bool, more: bool, warm: bool, cool: bool, mild: bool
) -> Meant:
    """Darker, brighter, warmer or cooler than the light that was asked for before."""
    step = 1.15 if mild else 1.35
    level = 1 / step if less else step if more else 1.0
    note = "compared with the light that was asked for before"
    if "range" not in edit:
        tint = 0.85 if warm else 1.18 if cool else 1.0
        before = edit.get("brightness", (1.0, 1.0))
        new: Entry = {
            "brightness": [tidy(min(max(one, 1 / RECORDED), level * one)) for one in before]
        }
        if "temperature" in edit or tint != 1:
            given = edit.get("temperature", (NEUTRAL, NEUTRAL))
            new["temperature"] = [tidy(tint * one) for one in given]
    else:
        tone = (1.06, 1.0, 0.85) if warm else (0.9, 1.0, 1.06) if cool else (1.0, 1.0, 1.0)
        new = {
            "range": [
                [tidy(min(1.0, v * level * t)) for v, t in zip(end, tone, strict=True)]
                for end in edit["range"]
            ]
        }
    return Meant(edits=({**edit, **new},), mention=LIGHT, notes=(note,), replaces=(number,))


def _factors(
    clause: Clause, shares: list[Amount], less: bool, more: bool, mild: bool
) -> tuple[float, float]:
    """Between which factors the lamps' brightness lies."""
    if len(shares) > 1:
        raise NotUnderstood(f"{clause.text!r}: one amount of light, please")
    if not shares:
        strong = clause.says("very", "extremely", "really")
        down, up = (0.75, 1.25) if mild else (0.35, 1.9) if strong else (0.6, 1.6)
        factor = down if less else up if more else 1.0
        return factor, factor
    low, high, how = shares[0].low, shares[0].high, shares[0].how
    if how == "about" or (how == "upto" and not (less or more)):
        return 1 - high, 1 + high
    if how == "upto":
        return (1 - high, 1) if less else (1, 1 + high)
    absolute = clause.absolute() or (how == "range" and high >= 1)
    if (less or more) and not absolute and high < 1:
        return (1 - high, 1 - low) if less else (1 + low, 1 + high)
    if less and not more and low > 1:
        raise NotUnderstood(f"{clause.text!r}: darker, and {tidy(low):g} times as bright?")
    return low, high


def _direction(clause: Clause, namer: Namer, notes: list[str]) -> Entry:
    """Where the lamp stands: straight above, at a side as the robot sees it, towards a point, or anywhere."""
    angles, point = clause.single("angle"), clause.one("point")
    side, above = clause.one("left", "right", "ahead", "back"), clause.one("up")
    clause.every("vary", "any", "from", "to", "further", "little")
    if point or (above and not side):
        return {"op": "light_direction", "to": point.value if point else [0, 0, 1]}
    if side is None:
        if angles and angles[0].how == "exact":
            raise NotUnderstood(
                "a lamp turns by at most an angle, about any axis: say `up to`, or give the direction (x, y, z) to it"
            )
        return {"op": "light_direction", **({"turn": angles[0].high} if angles else {})}
    if namer.recording is None or (angles and angles[0].how == "range"):
        raise NotUnderstood(
            "the lamp's directions are the world's: say `from above`, or give the direction (x, y, z) to it"
        )
    axis, sign = (
        "left" if side.kind in ("left", "right") else "ahead",
        1 if side.kind in ("left", "ahead") else -1,
    )
    height = angles[0].low if angles else LIFT
    to = [tidy(sign * math.cos(height) * v) for v in namer.recording.axes[axis]]
    notes.append(f"{side.kind} is the robot's {side.kind}")
    return {"op": "light_direction", "to": [*to[:2], tidy(math.sin(height))]}


def sensor(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """Noise, blur, compression and exposure of the images: of all cameras, or of those that are named."""
    exposed = clause.has("stops", "exposure", "gamma", "flicker", *TIMES) or "expos" in clause.text
    exposed |= clause.has("darker", "brighter") and clause.has("image")
    kind = next((one for one in SENSED if clause.has(one)), "exposure" if exposed else None)
    surface = kind in ("blur", "noise") and clause.has("color", "texture", "lay")
    if (
        kind is None
        or surface
        or any(one.kind == "thing" and not one.value.pronoun for one in clause.tokens)
    ):
        return None
    order = [one.kind for one in clause.tokens]
    if (
        "vary" in order
        and "and" in order[order.index("vary") :]
        and order[-1] != "vary"
        and kind in SENSED
    ):
        raise NotUnderstood(f"{clause.text!r}: one thing after the other, please")
    edit: Entry = {"op": f"sensor_{kind}"}
    apart = excepted(clause)
    cameras_told = clause.every("camera")
    named = [one.value for one in cameras_told if isinstance(one.value, list)]
    if 0 < len(named) < len(cameras_told):
        raise NotUnderstood(f"{clause.text!r}: all cameras, or those that are named?")
    if apart and not named:
        named = [[one for one in wish.setting.cameras if one not in apart]]
    cameras = sorted({name for some in named for name in some})
    if cameras and cameras != sorted(wish.setting.cameras):
        edit["cameras"] = cameras
    if clause.every("each") and clause.says(
        "separately", "individually", "independently", "each camera", "every camera", "per camera"
    ):
        edit["each"] = True
    told = _same_cameras(clause, wish, edit)
    mild = bool(clause.every("little"))
    if kind == "exposure":
        found = _exposed(clause, edit, mild)
        return found.model_copy(update={"notes": (*found.notes, *told)})
    clause.every("thing", "image", "all", "add", "lay", "much", "scale", "vary", kind)
    if kind == "noise":  # new in every frame
        clause.every("flicker")
    name, kinds, least = SENSED[kind]
    notes = list[str]()
    if kind == "blur" and clause.says("motion"):
        name, least, edit["sigma"] = "motion", 0.0, [0, 0]
        edit["motion"] = [1, 3] if mild else [2, 6]
        notes.append(
            "a smear of {} to {} pixels, since no length was named".format(*edit["motion"])
        )
    if amounts := clause.single(*kinds):
        one = amounts[0]
        factor: float = 100 if kind == "jpeg" and one.high <= 1 else 1
        factor = 1 / 255 if kind == "noise" and one.high >= 1 else factor
        start = least if one.how == "upto" or (kind == "noise" and one.how == "exact") else one.low
        edit[name], notes = [tidy(start * factor), tidy(one.high * factor)], []
    return Meant(edits=(edit,), notes=(*notes, *told))


def _same_cameras(clause: Clause, wish: Wish, edit: Entry) -> list[str]:
    """Go on with the cameras of the edit before, "the wrist camera darker, and noisy", and a note that says so."""
    last = wish.edits[-1] if wish.edits else {}
    bare = {one.kind for one in clause.tokens} <= AFTER and str(last.get("op")).startswith("sensor")
    if not bare or "cameras" in edit or "cameras" not in last:
        return []
    edit["cameras"] = last["cameras"]
    return [f"{clause.text!r} is taken as said of {', '.join(last['cameras'])}"]


def _exposed(clause: Clause, edit: Entry, mild: bool) -> Meant:
    """What is displayed: its contrast or saturation, how frames flicker, or how long they are exposed."""
    times = next((one for one in TIMES if clause.has(one)), None)
    if times and not clause.has("stops", "exposure", "gamma"):
        return _times(clause, edit, times, mild)
    return (_flicker if clause.has("flicker") else _exposure)(clause, edit, mild)


def _times(clause: Clause, edit: Entry, name: str, mild: bool) -> Meant:
    """Contrast or saturation, by how much it changes or what it becomes, as recorded being 1."""
    varied = clause.has("vary")
    clause.every("thing", "image", "all", "add", "much", "vary", "light", name)
    less = bool(clause.every("less", "down")) or clause.says("less", "desaturate", "desaturated")
    more = bool(clause.every("more", "up")) or clause.says("more", "stronger")
    reached = any(one.kind == "to" and one.text == "to" for one in clause.tokens)
    told, times = clause.single("share"), clause.single("number")
    if (less and more) or (told and times) or (times and clause.says("by")):
        raise NotUnderstood(f"{clause.text!r}: more or less {name}, and by how much?")
    amount = (told or times or [Amount(*((0.1, 0.2) if mild else (0.2, 0.5)))])[0]
    low, high = (0.0 if amount.how == "upto" else amount.low), amount.high
    if times or reached or (told and amount.how == "range" and not (less or more)):
        ends = [amount.low, amount.high]
    elif less or more:
        ends = [1 - high, 1 - low] if less else [1 + low, 1 + high]
    elif not told or varied or amount.how in ("about", "upto"):
        ends = [1 - high, 1 + high]
    else:
        raise NotUnderstood(f"{clause.text!r}: to that share of what is recorded, or by it?")
    if ends[0] < 0 or (less and ends[1] > 1) or (more and ends[0] < 1):
        raise NotUnderstood(f"{clause.text!r}: {name} of {ends[0]:g} to {ends[1]:g} times?")
    ends = [tidy(one) for one in ends]
    notes = (
        () if told or times else (f"{ends[0]:g} to {ends[1]:g} times, since no amount was named",)
    )
    return Meant(edits=(edit | {"stops": [0, 0], name: ends},), notes=notes)


def _flicker(clause: Clause, edit: Entry, mild: bool) -> Meant:
    """Frames that are off by up to so many stops, or so large a share of their light, and nothing else."""
    clause.every("flicker", "light", "thing", "image", "all", "add", "much", "vary", "exposure")
    stops, shares = clause.single("stops"), clause.single("share")
    if stops and shares:
        raise NotUnderstood(f"{clause.text!r}: stops, or a share of the light?")
    usual = 0.2 if mild else 0.5
    amount = (stops or shares or [Amount(0.1, usual)])[0]
    ends = [math.log2(1 + one) if shares else one for one in (amount.low, amount.high)]
    ends[0] = 0.0 if amount.how == "upto" else ends[0]
    notes = () if stops or shares else (f"frames up to {usual} stops off, as no amount was named",)
    return Meant(
        edits=(edit | {"stops": [0, 0], "flicker": [tidy(one) for one in ends]},), notes=notes
    )


def _exposure(clause: Clause, edit: Entry, mild: bool) -> Meant:
    """Stops up or down, and with them factors of each channel and a gamma."""
    clause.every("thing", "image", "all", "add", "much", "vary", "exposure")
    for name in ("gain", "gamma"):
        if one := clause.after(name, "share", "number"):
            low, high = one.value.ends
            edit[name] = (
                [tidy(1 + low), tidy(1 + high)] if one.value.how == "about" else [low, high]
            )
    stops = clause.single("stops")
    less = clause.every("darker", "down", "less") or clause.says("underexpose", "underexposed")
    more = clause.every("brighter", "up", "more") or clause.says("overexpose", "overexposed")
    if not stops and not (less or more):
        return Meant(edits=(edit,))
    usual = 0.5 if mild else 1
    shares = clause.single("share") if less or more else []
    if shares and not stops and shares[0].high < 1:
        ends = sorted(
            abs(math.log2(1 - v if less else 1 + v)) for v in (shares[0].low, shares[0].high)
        )
        stops = [Amount(ends[0], ends[1])]
    amount = stops[0] if stops else Amount(usual, usual)
    if less or more:
        ends = [-one if less and one > 0 else one for one in (amount.low, amount.high)]
    else:
        ends = (
            [-amount.high, amount.high]
            if amount.how in ("upto", "about")
            else [amount.low, amount.high]
        )
    notes = () if stops else (f"{amount.high:g} stops, since no amount was named",)
    return Meant(edits=(edit | {"stops": [tidy(one) for one in sorted(ends)]},), notes=notes)
