"""What the tokens of a clause come to: an edit for each way of changing a scene, or none of its tokens is left over."""
# ruff: noqa: E501  # patterns and word lists are easiest to read whole

import itertools
import math
import re
from typing import Any

from rpaug.assets import library
from rpaug.core import color_space
from rpaug.core.errors import MissingExtra, RpaugError, TargetError
from rpaug.language import naming, templates, words
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood, Wish
from rpaug.language.naming import Named, Namer, Target
from rpaug.language.reading import Clause
from rpaug.language.words import Amount, shaded, tidy
from rpaug.physics import materials
from rpaug.providers.words import synonym
from rpaug.scene.targets.relations import ANYTHING, GRIPS, PARTS, singular

TABLE, BACKGROUND = {"role": "table"}, {"role": "background"}
ANY = {"sample": "colosseum"}
RECORDED = 0.5  # the lamps' recorded brightness in `light_color`'s unit
WARM, COOL = (0.5, 0.42, 0.32), (0.38, 0.44, 0.5)
STEP, WRIST_STEP, TURN = 0.1, 0.02, 0.1745  # metres and radians, where no amount was named
MOST = 30
NEUTRAL = 6500  # kelvin, of sRGB's white
SENSED: dict[str, tuple[str, tuple[str, ...], float]] = {
    "noise": ("read", ("share", "number"), 0.0),
    "blur": ("sigma", ("pixels", "number"), 0.3),
    "jpeg": ("quality", ("number", "share"), 30),
}
"""What of a sensor's fault an amount says, in which units, and from where on "up to" goes."""
COUNTS = 5  # different numbers of new things that one wish may draw from
LIFT = 0.64  # radians: how high a lamp stands at a side, where no angle was named
COMPARED = re.compile(r"\b(?:\w+er|less|more)\b")
SHAKEN = {
    "jitter",
    "shake",
    "bump",
    "wobble",
    "wiggle",
    "jiggle",
    "nudge",
    "a bit off",
    "slightly off",
}
"""Ways to vary where something is, not how it looks."""
EACH = re.compile(
    r"\b(?:independently|individually|each|every|all different|(?:different|random|various) (?:colors|textures|materials|patterns))\b(?! (?:copy|episode|time))"
)
MIDDLE = (
    "midpoint",
    "the midpoint",
    "middle",
    "the middle",
    "center",
    "the center",
    "between",
    "halfway",
    "of",
)
VIEWED = re.compile(r"\b(?:look|view|see|film|watch)\b.* from\b")
LIGHT = Mention(kind="light")
WAYS = {
    "up": (0, -1, 0),
    "down": (0, 1, 0),
    "left": (-1, 0, 0),
    "right": (1, 0, 0),
    "ahead": (0, 0, 1),
    "back": (0, 0, -1),
}
SIDES = {
    "left": (0, 1),
    "right": (0, -1),
    "ahead": (1, 0),
    "back": (-1, 0),
    "off": (1, 0),
    "close": (-1, 0),
}
TURNS = {"up": (1, 0, 0), "down": (-1, 0, 0), "left": (0, -1, 0), "right": (0, 1, 0)}


class Reader:
    """Reads one clause after the other; what a clause leaves out may be said before it."""

    def __init__(self, wish: Wish, namer: Namer) -> None:
        self.wish, self.namer = wish, namer

    def read(self, clause: Clause) -> Meant:
        """The edits of a clause. Raises NotUnderstood with what of it is not understood."""
        for way in (
            self.physics,
            self.sensor,
            self.camera,
            self.swap,
            self.light,
            self.copy,
            self.remove,
            self.size,
            self.spread,
            self.add,
            self.move,
            self.shade,
            self.paint,
        ):
            tokens = list(clause.tokens)
            found = way(clause)
            if found is not None:
                try:
                    clause.done()
                except NotUnderstood as error:
                    raise NotUnderstood(f"{error}{self._nearest(clause)}") from None
                return found.model_copy(
                    update={"stage": "renderer" if way == self.camera else "operation"}
                )
            clause.tokens = tokens
        unknown = next(
            (one.text for one in clause.tokens if one.kind in ("unknown", "thing")), clause.text
        )
        why = f"{clause.text!r}: it is not clear what to do with {unknown!r}"
        raise NotUnderstood(f"{why}{self._nearest(clause)}")

    def _nearest(self, clause: Clause) -> str:
        """What of this clause would be understood, said of its first thing."""
        every = [one for one in (*clause.taken, *clause.tokens) if one.kind == "thing"]
        named = next((f"the {one.value.words}" for one in every if not one.value.pronoun), None)
        return templates.nearest(clause.text, named)

    # Cameras: x right, y down, z into the scene; a positive turn about x looks up, about y right, about z clockwise.

    def camera(self, clause: Clause) -> Meant | None:
        """Cameras at an exact motion, at one drawn along a direction or within bounds, or looking at something."""
        if (names := self._cameras(clause)) is None:
            return None
        mention, notes = Mention(kind="camera", cameras=names), list[str]()
        edit: Entry = {"op": "camera_pose", "camera": names}
        order = [one.kind for one in clause.tokens if one.kind in ("length", "angle")]
        lengths, angles = _amounts(clause, "length"), _amounts(clause, "angle")
        if any(one.how == "least" for one in (*lengths, *angles)):
            raise NotUnderstood(f"{clause.text!r}: at most how far?")
        rolled = clause.one("roll", "unroll")
        tilts = any(
            one.kind in ("tilt", "pan", "rotate") or one.text == "turn" for one in clause.tokens
        )
        clause.every("tilt", "pan")
        if clause.every("aim"):
            clause.tokens = [one for one in clause.tokens if one.text not in MIDDLE]
            edit["toward"] = self.namer.middle(clause.things())
        axes, ways = clause.every("axes"), clause.every(*WAYS)
        if (
            len(order) == len(ways) and angles
        ):  # each amount goes with the way that is said with it; the angle's last
            ways.append(ways.pop(order.index("angle")))
        clause.every("move", "rotate", "remove", "pose", "from")
        if axes:
            if len(lengths) != 1 or lengths[0].how != "exact":
                raise NotUnderstood(f"{clause.text!r}: how far along each axis?")
            edit["by"] = [lengths[0].low, lengths[0].low, 0]
        elif rolled:
            if ways or lengths:
                raise NotUnderstood(f"{clause.text!r}: roll the camera, or move it")
            sign = -1 if rolled.kind == "unroll" else 1
            edit |= {"by": [0, 0, 0]} | _motion(
                "turned", [((0, 0, sign), angles[0] if angles else Amount(TURN, TURN))]
            )
        elif ways:
            edit |= self._posed(clause, names, ways, lengths, angles, tilts, notes)
        elif "toward" not in edit:
            edit |= self._jittered(clause, lengths, angles, tilts, notes)
        return _done(edit, mention=mention, notes=tuple(notes))

    def _cameras(self, clause: Clause) -> Any:
        """The cameras that a clause is about; None where it is about none."""
        token, mention = clause.one("camera"), self.wish.mention
        known = mention is not None and mention.kind == "camera"
        if token is None and known and clause.has("thing"):
            spoken = clause.one("thing")
            token = words.Token("camera", "it", []) if spoken and spoken.value.pronoun else None
        if token is None and VIEWED.search(clause.text) and clause.has(*WAYS):
            clause.every("all", "thing", "image")
            token = words.Token("camera", "the camera", "static")
        if token is None:
            return None
        if token.value != []:
            return (
                token.value[0]
                if isinstance(token.value, list) and len(token.value) == 1
                else token.value
            )
        if mention is not None and known:
            return mention.cameras
        self.namer.notes.append(f"{token.text!r} is taken as all cameras that stand still")
        return "static"

    def _jittered(
        self,
        clause: Clause,
        lengths: list[Amount],
        angles: list[Amount],
        tilts: bool,
        notes: list[str],
    ) -> Entry:
        """A motion of any direction within bounds."""
        vague = not clause.every("vary", "little", "any") and not lengths
        if (
            vague
            and (tilts or not angles)
            and not (len(angles) == 1 and clause.taken[1:])
            and not clause.taken[1:]
        ):
            raise NotUnderstood(f"{clause.text!r}: what about the camera?")
        if vague and len(angles) == 1 and angles[0].how == "exact":
            notes.append(
                "which way it turns was not said: it turns about any axis, up to that angle"
            )
        elif vague and any(one.how == "exact" for one in (*lengths, *angles)):
            raise NotUnderstood(f"{clause.text!r}: which way, and how far?")
        edit: Entry = {"shift": lengths[0].high if lengths else 0} if lengths or angles else {}
        if angles or (lengths and lengths[0].how == "about"):
            edit["turn"] = angles[0].high if angles else 0
        return edit

    def _posed(
        self,
        clause: Clause,
        names: Any,
        ways: list[words.Token],
        lengths: list[Amount],
        angles: list[Amount],
        tilts: bool,
        notes: list[str],
    ) -> Entry:
        """A motion along directions: those that lengths go with, and the one that an angle goes with."""
        little = 0.5 if clause.every("little") else 2.0 if clause.every("much") else 1.0
        turning = bool(angles) or (tilts and not lengths)
        turns, moves = (ways[-1:], ways[:-1]) if turning else ([], ways)
        if len(lengths) not in (0, len(moves)) or len(angles) > 1:
            raise NotUnderstood(f"{clause.text!r}: which way, and how far?")
        if len([one for one in (*lengths, *angles) if one.how != "exact"]) > 1:
            raise NotUnderstood(f"{clause.text!r}: one range at a time along a direction")
        carried = any(part in str(names).lower() for part in ("wrist", "hand", "gripper"))
        usual = (WRIST_STEP if carried else STEP) * little
        if moves and not lengths:
            notes.append(f"{100 * usual:g} cm, since no length was named")
            lengths = [Amount(usual, usual)] * len(moves)
        edit = _motion(
            "by", [(WAYS[way.kind], far) for way, far in zip(moves, lengths, strict=True)]
        )
        if turns:
            if turns[0].kind not in TURNS:
                raise NotUnderstood(f"{clause.text!r}: a camera turns up, down, left or right")
            if not angles:
                notes.append("10 degrees, since no angle was named")
            edit |= _motion(
                "turned", [(TURNS[turns[0].kind], angles[0] if angles else Amount(TURN, TURN))]
            )
        return edit

    def physics(self, clause: Clause) -> Meant | None:
        """A thing behaves as if it were of a material, and may fall from some height."""
        material = re.search(
            rf"\b(?:like|as if it were|as|into) (?:made )?(?:of )?(?:an? )?(?P<what>{words.any_of(materials.shipped())})\b",
            clause.text,
        )
        falls = re.search(r"\b(?:drop|dropped|fall|falls|falling)\b", clause.text)
        turned = re.search(r"\bturn\b.* into\b", clause.text) and material
        if not (clause.has("physics") or turned or (falls and clause.has("length"))):
            return None
        if material is None:
            raise NotUnderstood(
                f"{clause.text!r}: what is it made of? `like` one of {', '.join(materials.shipped())}"
            )
        height = _amounts(clause, "length")
        clause.every("physics", "down", "from", "not")
        named = clause.things()
        rest = (
            material.group(),
            "if",
            "it",
            "were",
            "height",
            "drop",
            "dropped",
            "fall",
            "falls",
            "a height",
            "a height of",
        )
        clause.tokens = [
            one for one in clause.tokens if not (one.text in rest or material["what"] in one.text)
        ]
        fields: Entry = {
            "material": material["what"],
            **({"height": [height[0].low, height[0].high]} if height else {}),
        }
        return self._each(named, {"op": "physics"}, fields)

    # Light, and what the sensor does to finished images.

    def light(self, clause: Clause) -> Meant | None:
        lamp, lit = clause.has("light"), clause.has("lit")
        toned = clause.has("darker", "brighter", "warm", "cool", "kelvin")
        spoken = [
            one
            for one in clause.tokens
            if one.kind == "thing"
            and (
                (one.value.pronoun and self._is_light())
                or (one.value.words == "robot" and clause.has("left", "right"))
            )
        ]
        for one in [one for one in clause.tokens if one.kind == "thing" and lamp]:
            tint = one.value.words.removesuffix("s").removesuffix(" one")
            if tint != one.value.words and color_space.canonical(tint):
                clause.tokens[clause.tokens.index(one)] = words.Token(
                    "color", one.text, words.colors(tint)
                )
                clause.every("swap")
        everything = clause.every("all", "image") or spoken
        if not (lamp or lit) and not (toned and (everything or not clause.has("thing"))):
            return None
        clause.tokens = [one for one in clause.tokens if one not in spoken]
        clause.every("light", "much", "size_of", "on", "all", "swap")
        edits, notes = list[Entry](), list[str]()
        aside = any(one.text in ("somewhere else", "elsewhere") for one in clause.tokens)
        if (
            clause.every("lit", "move", "rotate", "pan", "tilt")
            or aside
            or clause.has("angle")
            or clause.has("left", "right", "ahead", "back", "point")
            or (clause.has("up") and not clause.has("share"))
        ):
            edits.append(self._direction(clause, notes))
        if not edits or clause.has(
            "darker",
            "brighter",
            "warm",
            "cool",
            "kelvin",
            "color",
            "share",
            "times",
            "twice",
            "halve",
            "number",
        ):
            color = self._color(clause)
            if color.replaces:
                return color
            edits += color.edits
        clause.every("vary", "any", "from")
        return _done(*edits, mention=LIGHT, notes=tuple(notes))

    def _color(self, clause: Clause) -> Meant:
        """How strong the lamps are, and of what color."""
        mild = bool(clause.every("little"))
        less, more = clause.every("darker", "down", "less"), clause.every("brighter", "up", "more")
        warm, cool, kelvin = clause.every("warm"), clause.every("cool"), _amounts(clause, "kelvin")
        color = clause.one("color")
        evening = any(
            word in one.text for one in warm for word in ("evening", "sunset", "afternoon")
        )
        if warm and cool:
            raise NotUnderstood(f"{clause.text!r}: warm or cold? `either ... or ...` draws one")
        ends = [list(WARM if warm else COOL if cool else (RECORDED,) * 3)]
        if kelvin and ((cool and kelvin[0].low <= NEUTRAL) or (warm and kelvin[0].high >= NEUTRAL)):
            raise NotUnderstood(
                f"{clause.text!r}: {NEUTRAL} K is the recorded light's white here; warm light has less, cold light more"
            )
        if kelvin:
            ends = [_kelvin(one) for one in (kelvin[0].low, kelvin[0].high)]
        elif color:
            ends = [[RECORDED * (0.5 + 0.5 * v) for v in words.rgb(one)] for one in color.value]
            if len(ends) > 1:
                return _done(
                    {"one_of": [_lit([tidy(v) for v in one]) for one in ends]}, mention=LIGHT
                )
        shares = [
            *_amounts(clause, "share"),
            *_amounts(clause, "times"),
            *_amounts(clause, "number"),
        ]
        before = next(
            (
                k
                for k, one in enumerate(self.wish.edits)
                if one.get("op") == "light_color" and "range" in one
            ),
            None,
        )
        if before is not None and not (shares or kelvin or color) and COMPARED.search(clause.text):
            return self._relative(before, bool(less), bool(more), bool(warm), bool(cool), mild)
        factor = 2.0 if clause.every("twice") else 0.5 if clause.every("halve") else None
        if not (shares or less or more or warm or cool or kelvin or color or factor):
            if clause.every("vary", "any", "paint"):
                return _done({"op": "light_color"}, mention=LIGHT)
            raise NotUnderstood(f"{clause.text!r}: what about the light?")
        clause.every("paint")
        low, high = (
            (factor, factor)
            if factor
            else self._level(clause, shares, bool(less), bool(more), mild)
        )
        if evening and not shares and not more:
            low = high = 0.8
        edit = _lit([tidy(v * low) for v in ends[0]], [tidy(v * high) for v in ends[-1]])
        if max(edit["range"][1]) > 1 or max(edit["range"][0]) <= 0:
            raise NotUnderstood(
                f"lamps can be from 0 to 2 times as bright as recorded, not {2 * max(edit['range'][1]):g}"
            )
        return _done(edit, mention=LIGHT)

    def _relative(
        self, before: int, less: bool, more: bool, warm: bool, cool: bool, mild: bool
    ) -> Meant:
        """Darker, brighter, warmer or cooler than the light that was asked for before."""
        step = 1.15 if mild else 1.35
        level = 1 / step if less else step if more else 1.0
        tone = (1.06, 1.0, 0.85) if warm else (0.9, 1.0, 1.06) if cool else (1.0, 1.0, 1.0)
        edit = self.wish.edits[before]
        drawn = [
            [tidy(min(1.0, v * level * t)) for v, t in zip(end, tone, strict=True)]
            for end in edit["range"]
        ]
        return Meant(
            edits=({**edit, "range": drawn},),
            mention=LIGHT,
            notes=("compared with the light that was asked for before",),
            replaces=(before,),
        )

    def _is_light(self) -> bool:
        mention = self.wish.mention
        return mention is None or mention.kind == "light"

    def _level(
        self, clause: Clause, shares: list[Amount], less: bool, more: bool, mild: bool
    ) -> tuple[float, float]:
        """Between which factors the lamps' brightness lies."""
        if len(shares) > 1:
            raise NotUnderstood(f"{clause.text!r}: one amount of light, please")
        if not shares:
            factor = (0.75 if mild else 0.6) if less else (1.25 if mild else 1.6) if more else 1.0
            return factor, factor
        low, high, how = shares[0].low, shares[0].high, shares[0].how
        if how in ("about", "upto"):
            return (
                (1 - high, 1 + high)
                if how == "about" or not (less or more)
                else (1 - high, 1)
                if less
                else (1, 1 + high)
            )
        absolute = re.search(r"\bto\b|\bas\b|like|of the", clause.text) or (
            how == "range" and high > 1
        )
        if (less or more) and not absolute and high < 1:
            return (1 - high, 1 - low) if less else (1 + low, 1 + high)
        return low, high

    def _direction(self, clause: Clause, notes: list[str]) -> Entry:
        """Where the lamp stands: straight above, at a side as the robot sees it, towards a point, or anywhere."""
        angles, point = _amounts(clause, "angle"), clause.one("point")
        side, above = clause.one("left", "right", "ahead", "back"), clause.one("up")
        clause.every("vary", "any", "from", "to", "further", "little")
        if point or (above and not side):
            return {"op": "light_direction", "to": point.value if point else [0, 0, 1]}
        if side is None:
            if angles and angles[0].how not in ("upto", "about", "range"):
                raise NotUnderstood(
                    "a lamp turns by at most an angle, about any axis: say `up to`, or give the direction (x, y, z) to it"
                )
            return {"op": "light_direction", **({"turn": angles[0].high} if angles else {})}
        if self.namer.recording is None or (angles and angles[0].how == "range"):
            raise NotUnderstood(
                "the lamp's directions are the world's: say `from above`, or give the direction (x, y, z) to it"
            )
        axis, sign = (
            ("left" if side.kind in ("left", "right") else "ahead"),
            (1 if side.kind in ("left", "ahead") else -1),
        )
        height = angles[0].low if angles else LIFT
        to = [tidy(sign * math.cos(height) * v) for v in self.namer.recording.axes[axis]]
        notes.append(f"{side.kind} is the robot's {side.kind}")
        return {"op": "light_direction", "to": [*to[:2], tidy(math.sin(height))]}

    def sensor(self, clause: Clause) -> Meant | None:
        """Noise, blur, compression and exposure of the images: of all cameras, or of those that are named."""
        spoken = [one.text for one in clause.tokens]
        exposed = clause.has("stops") or any("expos" in one for one in spoken)
        exposed |= clause.has("darker", "brighter") and bool(
            {"image", "images", "pictures"} & {*spoken}
        )
        kind = next((one for one in SENSED if clause.has(one)), "exposure" if exposed else None)
        surface = kind in ("blur", "noise") and clause.has("color", "texture", "lay")
        things = [one for one in clause.tokens if one.kind == "thing" and not one.value.pronoun]
        if kind is None or surface or things:
            return None
        edit: Entry = {"op": f"sensor_{kind}"}
        named = [one.value for one in clause.every("camera") if isinstance(one.value, list)]
        if cameras := sorted({name for some in named for name in some}):
            edit["cameras"] = cameras
        if clause.every("each"):
            edit["each"] = True
        clause.every("thing", "image", "all", "add", "lay", "much", "scale", "vary", kind)
        mild = bool(clause.every("little"))
        if kind == "exposure":
            return self._exposure(clause, edit, mild)
        name, kinds, least = SENSED[kind]
        if amounts := _amounts(clause, *kinds):
            one = amounts[0]
            factor = 100 if kind == "jpeg" and one.high <= 1 else 1
            start = (
                least if one.how == "upto" or (kind == "noise" and one.how == "exact") else one.low
            )
            edit[name] = [tidy(start * factor), tidy(one.high * factor)]
        return _done(edit)

    def _exposure(self, clause: Clause, edit: Entry, mild: bool) -> Meant:
        stops = _amounts(clause, "stops")
        less, more = clause.every("darker", "down", "less"), clause.every("brighter", "up", "more")
        usual = 0.5 if mild else 1
        amount = stops[0] if stops else Amount(usual, usual)
        if not (less or more):
            ends = (
                amount.ends
                if amount.how == "range" or amount.low == amount.ends[0]
                else (-amount.high, amount.high)
            )
            return _done(edit | ({"stops": [tidy(one) for one in ends]} if stops else {}))
        signed = sorted(-one if less and one > 0 else one for one in (amount.low, amount.high))
        notes = () if stops else (f"{amount.high:g} stops, since no amount was named",)
        return _done(edit | {"stops": [tidy(one) for one in signed]}, notes=notes)

    # Things: in, out, elsewhere, larger.

    def copy(self, clause: Clause) -> Meant | None:
        if not clause.has("copy") or not clause.has("thing"):
            return None
        clause.every("copy", "add")
        count = self._count(clause)
        return self._each(
            clause.things(),
            {"op": "duplicate"},
            {"count": count} if count > 1 else {},
            mention=Mention(kind="new"),
        )

    def remove(self, clause: Clause) -> Meant | None:
        """Things are gone: those that are named, what the task does not need, or all but what is named."""
        if not clause.has("remove", "clear"):
            return None
        clearing = clause.every("clear") or (clause.has("on") and clause.every("all"))
        clause.every("on", "remove")
        if clause.has("not"):
            apart = clause.things("not")
            named, every = clause.things(), clause.every("not", "all", "strangers", "rest")
            if not apart or not (len(every) > 1 or _anything(named)):
                raise NotUnderstood(
                    f"{clause.text!r}: all but what? `remove everything except ...`"
                )
            return _done({"op": "remove", "target": self.namer.but(apart)})
        if clearing or clause.has("strangers", "rest"):
            named = clause.things()
            if [one.words for one in named] not in ([], ["table"], ["desk"], ["scene"]):
                raise NotUnderstood(
                    f"{clause.text!r}: clear what? `clear the table` takes away all that the task does not need"
                )
            random = bool(clause.every("vary")) or " of the " in clause.text
            clause.every("strangers", "rest", "all")
            if (numbers := _amounts(clause, "number")) and random:
                return self._some(_whole(numbers[0]))
            if not (ids := self.namer.strangers()):
                raise NotUnderstood(f"{clause.text!r}: the task needs all that is there")
            return _done({"op": "remove", "target": {"handle": sorted(ids)}})
        return self._each(clause.things(), {"op": "remove"}, {}) if clause.has("thing") else None

    def _some(self, count: int) -> Meant:
        """So many of the things that the task does not need are gone, others in each copy."""
        every = {"handle": sorted(self.namer.strangers())}
        chosen = list(itertools.combinations(self.namer.groups(every), count))
        if not 0 < len(chosen) <= MOST:
            raise NotUnderstood(
                f"{count} of them: there are {len(chosen)} ways, and at most {MOST} can be drawn from"
            )
        gone = [sorted(frozenset[int]().union(*group)) for group in chosen]
        return _done(_one([{"op": "remove", "target": {"handle": ids}} for ids in gone]))

    def size(self, clause: Clause) -> Meant | None:
        sized = re.search(r"\b(?:tall|high|wide|long)\b", clause.text) and clause.has("length")
        if sized and clause.has("thing") and not clause.has("add", "texture", "lay", "move", "up"):
            raise NotUnderstood(
                "sizes are factors of the recorded one: say `20% larger`, or `half its size`"
            )
        if not clause.has("bigger", "smaller", "scale", "size_of") or not clause.has("thing"):
            return None
        bigger, smaller = clause.every("bigger", "more"), clause.every("smaller", "less")
        verbs = clause.every("scale")
        down = bool(smaller) or any(
            one.text in ("shrink", "downsize", "halve the size of") for one in verbs
        )
        grows = any(
            one.text in ("enlarge", "grow", "magnify", "upscale") for one in verbs
        ) or clause.has("up")
        bigger = bigger or [one for one in verbs if grows]
        down = down or clause.has("down")
        clause.every("size_of", "little", "down", "up", "to")
        shares = _amounts(clause, "share", "times", "number")
        if down and clause.has("twice"):
            raise NotUnderstood(f"{clause.text!r}: say `half its size`")
        if clause.every("twice") or any(one.text == "double the size of" for one in verbs):
            shares.append(Amount(2, 2, "of"))
        if clause.every("halve") or any(one.text == "halve the size of" for one in verbs):
            shares.append(Amount(0.5, 0.5, "of"))
        if clause.has("length"):
            raise NotUnderstood(
                "sizes are factors of the recorded one: say `20% larger`, or `half its size`"
            )
        varied, notes = clause.every("vary", "any"), tuple[str, ...]()
        if bigger and smaller and len(shares) == 1 and clause.every("or"):
            shares, down, bigger = [Amount(shares[0].high, shares[0].high, "about")], False, []
        if len(shares) > 1 or (bigger and smaller):
            raise NotUnderstood(f"{clause.text!r}: one factor, please")
        if shares:
            low, high = self._factors(clause, shares[0], down, bool(bigger))
            fields: Entry = {"range": [tidy(low), tidy(high)]}
            if not 0.1 <= low <= high <= 10:
                raise NotUnderstood(
                    f"{low:g} to {high:g} times its size: factors are within 0.1..10"
                )
        elif bigger or down:
            fields = {"range": [0.8, 0.9] if down else [1.1, 1.25]}
            notes = (
                f"between {fields['range'][0]:g} and {fields['range'][1]:g} times its size, since no factor was named",
            )
        elif varied or verbs:
            fields = {}
        else:
            return None
        return self._each(clause.things(), {"op": "object_size"}, fields, notes=notes)

    def _factors(
        self, clause: Clause, one: Amount, down: bool, bigger: bool
    ) -> tuple[float, float]:
        if one.how in ("about", "upto") and one.high < 1:
            return (
                (1 - one.high, 1.0)
                if down and one.how == "upto"
                else (1.0, 1 + one.high)
                if bigger and one.how == "upto"
                else (1 - one.high, 1 + one.high)
            )
        absolute = (
            one.how == "of"
            or (one.high >= 0.5 and down)
            or " to " in clause.text
            or "its size" in clause.text
            or "times" in clause.text
        )
        if absolute or not (down or bigger):
            return one.low, one.high
        return (1 - one.high, 1 - one.low) if down else (1 + one.low, 1 + one.high)

    def spread(self, clause: Clause) -> Meant | None:
        if not clause.has("spread"):
            return None
        clause.every("spread", "on", "vary")
        far = _amounts(clause, "length")
        edit: Entry = {"op": "spread"}
        every = clause.every("all", "strangers", "rest")
        named = clause.things()
        if not every and not named:
            return None
        if named and [one.words for one in named] not in (["objects"], ["things"]):
            edit["targets"] = [self.namer.target(one) for one in named]
        if far:
            edit["shift"] = far[0].high
        return _done(edit)

    def add(self, clause: Clause) -> Meant | None:
        putting = any(one.text in ("put", "placed", "use", "throw") for one in clause.tokens)
        things = [one.value for one in clause.tokens if one.kind == "thing"]
        fresh = [one for one in things if one.fresh]
        firsts = [one.words.split()[0] for one in things if not one.several]
        listed = [name for name in firsts if name in library_names() and "_" in name]
        if clause.has("strangers") and not clause.has(
            "spread",
            *(() if clause.has("add", "number") else ("color",)),
            "texture",
            "paint",
            "bigger",
            "smaller",
            "move",
        ):
            return self._clutter(clause)
        counted = clause.has("number") and clause.has("thing")
        stands = clause.has("on", "near") and not clause.has(
            "vary",
            "paint",
            "lay",
            "texture",
            "move",
            "scale",
            "bigger",
            "smaller",
            "remove",
            "copy",
        )
        putting = putting or stands
        if _anything(things) and clause.has("add") and not clause.has("color", "texture", "paint"):
            for one in [one for one in clause.tokens if one.kind == "thing"]:
                clause.tokens[clause.tokens.index(one)] = words.Token("strangers", one.text)
            return self._clutter(clause)
        if not (clause.has("add") or listed or (putting and (fresh or counted))) or not clause.has(
            "thing"
        ):
            return None
        clause.every("add", "on")
        return self._inserted(clause)

    def _clutter(self, clause: Clause) -> Meant:
        if clause.has("thing") and not clause.has("near") and not clause.every("table"):
            named = clause.things()
            if [one.words for one in named] not in (["table"], ["desk"], ["scene"]):
                raise NotUnderstood(f"{clause.text!r}: where is the clutter to be?")
        clause.every("strangers", "add", "on", "all", "vary", "little", "any")
        edit: Entry = {"op": "distractors"}
        numbers = _amounts(clause, "number")
        counts = (
            [_whole(Amount(n, n)) for n in range(int(numbers[0].low), int(numbers[0].high) + 1)]
            if numbers
            else []
        )
        if len(counts) > COUNTS or (numbers and numbers[0].low != int(numbers[0].low)):
            raise NotUnderstood(f"{clause.text!r}: how many?")
        if color := clause.one("color"):
            edit["color"] = color.value[0]
        sizes = _amounts(clause, "length")
        if clause.one("near"):
            near = [self.namer.target(one) for one in clause.things()]
            if near and near[0] != {"role": "manipulated"} and not self._task(near[0]):
                raise NotUnderstood(
                    f"{clause.text!r}: clutter stands near the target or the robot's path; `add a mug near ...` puts one thing"
                )
            edit["near"] = "target"
        if sizes:
            edit["size"] = [sizes[0].low, sizes[0].high]
        return _done(
            _one([{**edit, "count": count} for count in counts] or [edit]),
            mention=Mention(kind="new"),
        )

    def _task(self, target: Target) -> bool:
        return self.namer.recording is not None and self.namer.ids(target) <= self.namer.ids(
            {"role": "manipulated"}
        )

    def _inserted(self, clause: Clause) -> Meant:
        numbers, at, far = (
            _amounts(clause, "number"),
            clause.one("point"),
            _amounts(clause, "length"),
        )
        near = clause.every("near") or re.search(r"\bwithin .+ of ", clause.text)
        color = clause.one("color")
        named = clause.things()
        place: Entry = {}
        beside: list[Named] = []
        if near:
            beside = clause.things() or named[-1:]
            named = named[: len(named) - (beside == named[-1:])]
        if any(_parted(one.words)[1] for one in named[:-1]):
            raise NotUnderstood(f"{clause.text!r}: one place at a time, please")
        first, relation, anchor = _parted(named[-1].words) if named else ("", "", "")
        if relation:
            if relation != "closest to" and anchor not in ("table", "desk", "tabletop", "counter"):
                raise NotUnderstood(
                    "new things stand on the table: `near` something, `within` a length of it, or `at` (x, y)"
                )
            named = [*named[:-1], Named(first, named[-1].several, named[-1].fresh)]
            beside = beside or (
                [Named(anchor, pronoun=anchor in naming.PRONOUNS)]
                if relation == "closest to"
                else []
            )
        if beside:
            place["near"] = self.namer.target(beside[0])
        if at:
            place["at"] = at.value
        if far:
            place |= (
                {"within": far[0].high} if "near" in place else {"size": [far[0].low, far[0].high]}
            )
        if not named:
            raise NotUnderstood(f"{clause.text!r}: add what?")
        edits, notes = list[Entry](), list[str]()
        tint = color.value[0] if color else None
        count = _whole(numbers[0]) if numbers else 1
        if len(edits) + count * len(named) > MOST or (at and count * len(named) > 1):
            raise NotUnderstood(
                f"{clause.text!r}: at most {MOST} things at once, and one at a place"
            )
        for one in named:
            if not (one.fresh or numbers or one.words in library_names()) and one.words == singular(
                one.words
            ):
                raise NotUnderstood(
                    f"{one.words!r}: is it there already, or a new one? say `a {one.words}`, or `move` it"
                )
            fields, note = asset(one.words, tint, self.wish.setting.generates)
            notes += note
            edits += [
                {"op": "insert", **fields, **place} for _ in range(count if one is named[0] else 1)
            ]
        return _done(*edits, mention=Mention(kind="new"), notes=tuple(notes))

    def move(self, clause: Clause) -> Meant | None:
        put = any(
            one.text in ("put", "set", "bring", "place", "lay", "set down", "put down")
            for one in (*clause.tokens, *clause.taken)
        )
        if not (clause.has("move") or put) or not clause.has("thing"):
            return None
        if clause.has("lay", "texture", "color", "paint"):
            return None
        shifts = bool(clause.every("move"))
        clause.every("add")
        named = clause.things()
        far, at = _amounts(clause, "length"), clause.one("point")
        near, ways = (
            clause.every("near") or re.search(r"\bwithin .+ of ", clause.text),
            [one for one in clause.every(*WAYS, "off", "close") if not put or one.text != "down"],
        )
        named = named or (clause.things() if not near else [])
        beside = clause.things() if near else []
        first, relation, anchor = _parted(named[-1].words) if named else ("", "", "")
        if relation == "closest to" and not ways and not at:
            named, beside = (
                [*named[:-1], Named(first)],
                [Named(anchor, pronoun=anchor in naming.PRONOUNS)],
            )
        clause.every("vary", "from", "on")
        fields: Entry = {}
        if beside:
            fields["near"] = self.namer.target(beside[0])
            fields |= {"within": far[0].high} if far else {}
        elif at:
            fields["to"] = at.value[:2]
        elif ways:
            if len(far) != len(ways) or any(one.how != "exact" for one in far):
                raise NotUnderstood(f"{clause.text!r}: how far? say a length, such as 5 cm")
            if any(one.kind not in SIDES for one in ways):
                raise NotUnderstood("things move ahead, back, left and right, as the robot sees it")
            fields["by"] = [
                tidy(sum(f.low * SIDES[w.kind][k] for f, w in zip(far, ways, strict=True))) or 0
                for k in (0, 1)
            ]
        elif far:
            if far[0].how == "exact":
                raise NotUnderstood(f"{clause.text!r}: which way? or say `by up to`")
            fields["shift"] = far[0].high
        elif not shifts:
            return None
        return self._each(named, {"op": "move"}, fields)

    # Looks.

    def swap(self, clause: Clause) -> Meant | None:
        """Two things exchange their colors, as they are measured."""
        if not clause.has("swap") or not clause.has("thing") or clause.has("light"):
            return None
        clause.every("swap")
        if clause.has("color", "texture", "vary", "lay"):
            things = [one for one in clause.tokens if one.kind == "thing"]
            if len(things) > 1 and not clause.has("vary"):
                raise NotUnderstood(f"{clause.text!r}: colors are swapped, not textures")
            return self.paint(clause)
        if not clause.every("paint"):
            raise NotUnderstood(
                f"{clause.text!r}: only `swap the colors of ...` two things; for another look name it: `make ... walnut`"
            )
        named = clause.things()
        targets = [self.namer.target(one) for one in named]
        if len(targets) == 1 and isinstance(targets[0], str):
            targets = [{"text": singular(targets[0]), "all": True}]
        groups = [group for one in targets for group in self.namer.groups(one)]
        if len(groups) != 2:
            raise NotUnderstood(
                f"{clause.text!r}: {len(groups)} things; colors are swapped between two"
            )
        tints = {row["id"]: row["color"] for row in self.namer.rows}
        first, second = (sorted(group) for group in groups)
        return _done(
            {"op": "recolor", "target": {"handle": first}, "color": tints[second[0]]},
            {"op": "recolor", "target": {"handle": second}, "color": tints[first[0]]},
        )

    def shade(self, clause: Clause) -> Meant | None:
        """Darker or lighter than the color that was asked for before."""
        if not clause.has("darker", "brighter") or not clause.has("thing"):
            return None
        dark, light = bool(clause.every("darker")), bool(clause.every("brighter"))
        clause.every("little", "paint", "much")
        named = clause.things()
        if (dark and light) or len(named) > 1:
            raise NotUnderstood(f"{clause.text!r}: darker or lighter, one thing after the other")
        painted = [edit["target"] for edit in self.wish.edits if edit.get("op") == "recolor"]
        mention = self.wish.mention
        alone = (
            named[0].pronoun
            and (mention is None or mention.kind in ("camera", "new"))
            and len(painted) == 1
        )
        where = painted[0] if alone else self.namer.target(named[0])
        notes = (f"'it' is taken to mean what was painted: {where}",) if alone else ()
        for k, edit in reversed(list(enumerate(self.wish.edits))):
            if edit.get("op") == "recolor" and edit["target"] == where:
                tint = {"rgb": shaded(edit["color"], 0.6 if dark else -0.4)}
                return Meant(
                    edits=({**edit, "color": tint},),
                    mention=Mention(kind="target", target=where),
                    notes=notes,
                    replaces=(k,),
                )
        if self.namer.recording is not None:
            ids = self.namer.ids(where)
            tints = {row["color"] for row in self.namer.rows if row["id"] in ids}
            if len(tints) == 1:
                tint = {"rgb": shaded(tints.pop(), 0.6 if dark else -0.4)}
                note = f"{'darker' if dark else 'lighter'} than the color that it was recorded in, as far as that has a name"
                return _done(
                    {"op": "recolor", "target": where, "color": tint},
                    mention=Mention(kind="target", target=where),
                    notes=(note,),
                )
        raise NotUnderstood(
            f"{'darker' if dark else 'lighter'} than what? name a color: only one that was asked for before has a darker one"
        )

    def paint(self, clause: Clause) -> Meant | None:
        """A color, a texture or a style, or one of several, for what is named."""
        named_none = not clause.has("thing", "all", "rest", "strangers")
        if named_none and not (clause.has("on") and clause.has("texture", "lay")):
            return None
        apart, banned = _excepted(clause)
        tints, pictures = clause.every("color"), clause.every("texture")
        notes = ["gloss stays as it was recorded"] if clause.every("gloss") else []
        styled = bool(clause.every("style"))
        at_table = clause.every("on", "add") if named_none else []
        laid, painted, anyhow = (
            clause.every("lay"),
            clause.every("paint"),
            clause.every("vary", "any"),
        )
        if anyhow and {one.text for one in anyhow} <= SHAKEN and not (laid or painted or tints):
            return None
        width = _amounts(clause, "length") if pictures else []
        clause.every("width")
        every, rest = clause.every("all"), clause.every("rest", "strangers")
        if rest and not any(one.kind == "strangers" for one in clause.taken):
            if not self.namer.kept:
                raise NotUnderstood(f"{clause.text!r}: the rest beside what?")
            every, apart = rest, self.namer.kept
        named = clause.things() or ([Named("table")] if at_table else [])
        same = bool(clause.every("same"))
        each = bool(clause.every("each")) or (bool(EACH.search(clause.text)) and not same)
        several = bool(clause.every("or"))
        if len(tints) + len(pictures) > 1 and not several:
            raise NotUnderstood(f"{clause.text!r}: one look for each thing, please")
        if (
            not (tints or pictures or banned or laid or painted or styled or anyhow)
            and len(named) == 1
        ):
            named, tints, pictures = self._own_look(named[0])
        if not (tints or pictures or anyhow or banned or laid or painted or styled):
            return None
        only: Entry = {}
        if tints and len(named) == 1 and (part := self._handle(named[0])):
            named, only = [part[0]], {"only": part[1]}
            notes.append(f"the handle is taken as what is {part[1]} of the {part[0].words}")
        places = self._places(named, apart, bool(every), bool(rest), each)
        if same and len(places) > 1:
            ids = frozenset[int]().union(*map(self.namer.ids, places))
            places = [{"handle": sorted(ids)}]
        looks = self._looks(tints, pictures, bool(laid), styled, banned)
        more = only | ({"scale": width[0].low} if width else {})
        edits = [
            _one([{**_look(where, look), **(only if "color" in look else more)} for look in looks])
            for where in places
        ]
        return _done(
            *edits,
            mention=Mention(kind="target", target=places[0]) if len(places) == 1 else None,
            notes=tuple(notes),
        )

    def _own_look(self, named: Named) -> tuple[list[Named], list[words.Token], list[words.Token]]:
        """A thing and the look that was said before its noun, where nothing of that look is there: "a brick wall"."""
        spoken = named.words.split()
        size, fits = words.texture(spoken)
        color = words.COLORS.match(named.words)
        taken = size or (len(color.group().split()) if color else 0)
        noun = Named(" ".join(spoken[taken:]), named.several)
        if not 0 < taken < len(spoken) or not self._there(noun):
            return [named], [], []
        if noun.words not in (*naming.ROLES, *naming.roles.NAMES) and self._there(named):
            return [named], [], []
        if size:
            return [noun], [], [words.Token("texture", "", fits)]
        assert color is not None
        return [noun], [words.Token("color", "", words.colors(color.group()))], []

    def _there(self, named: Named) -> bool:
        """Is there such a thing in the recording? Without one only the roles are."""
        if self.namer.recording is None:
            return named.words in (*naming.ROLES, *naming.roles.NAMES)
        try:
            return bool(self.namer.ids(self.namer.target(named)))
        except RpaugError:
            return False

    def _handle(self, named: Named) -> tuple[Named, str] | None:
        """The tool whose handle is named, and the color of most of it, where the masks do not show the handle apart."""
        parts = re.sub(r"^(\w+) of (?:the )?(.+)$", r"\2 \1", named.words).split()
        if parts[-1] not in GRIPS or len(parts) < 2 or parts[-2] in PARTS or self._there(named):
            return None
        tool = Named(" ".join(parts[:-1]))
        if not self._there(tool):
            return None
        ids = self.namer.ids(self.namer.target(tool))
        shown = [row["shows"] for row in self.namer.rows if row["id"] in ids and "shows" in row]
        return (tool, shown[0][0]) if len(shown) == 1 else None

    def _places(
        self, named: list[Named], apart: list[Named], every: bool, rest: bool, each: bool
    ) -> list[Target]:
        """What gets a look: what is named, or everything but that."""
        if rest and not named:
            return [{"handle": [one]} for one in sorted(self.namer.strangers())]
        if not every:
            if apart:
                if _anything(named):
                    return [self.namer.but(apart)]
                kept = self.namer.all_ids(apart)
                return [
                    self.namer.without(naming.every(self.namer.counted(one)), kept) for one in named
                ]
            targets = [
                naming.every(self.namer.counted(one)) if one.several else self.namer.target(one)
                for one in named
            ]
            if each and self.namer.recording:
                groups = [
                    group for one in targets for group in self.namer.groups(naming.every(one))
                ]
                return (
                    [{"handle": sorted(group)} for group in groups] if len(groups) > 1 else targets
                )
            return targets
        kept = self.namer.all_ids(apart)
        out: list[Target] = []
        for role in ("background", "table", "receiver", "manipulated"):
            ids = frozenset(row["id"] for row in self.namer.rows if row.get("role") == role)
            if ids - kept:
                out.append({"role": role} if not ids & kept else {"handle": sorted(ids - kept)})
        robot = frozenset(row["id"] for row in self.namer.rows if row.get("role") == "robot")
        if robot and not robot & kept:
            out.append({"role": "robot"})
        return [*out, *({"handle": [one]} for one in sorted(self.namer.strangers() - kept))]

    def _looks(
        self,
        tints: list[words.Token],
        pictures: list[words.Token],
        laid: bool,
        styled: bool,
        banned: list[Any],
    ) -> list[Entry]:
        if banned:
            own = [
                name
                for name in color_space.RLBENCH
                if not any(
                    name == one or name in color_space.SHADES.get(str(one), ()) for one in banned
                )
            ]
            return [{"color": name} for name in own]
        if styled:
            return [{"style": one} for one in pictures[0].value] if pictures else [{"style": None}]
        if pictures or tints:
            found = [{"texture": one} for token in pictures for one in token.value]
            return found + [{"color": one} for token in tints for one in token.value]
        return [{"texture": None}] if laid else [{"color": ANY}]

    def _each(
        self,
        named: list[Named],
        head: Entry,
        fields: Entry,
        mention: Mention | None = None,
        notes: tuple[str, ...] = (),
    ) -> Meant:
        """The edit for each thing."""
        if not named:
            raise NotUnderstood("which thing is meant?")
        targets = [
            naming.every(self.namer.counted(one)) if one.several else self.namer.target(one)
            for one in named
        ]
        last = Mention(kind="target", target=targets[0]) if len(targets) == 1 else None
        return _done(
            *({**head, "target": one, **fields} for one in targets),
            mention=mention or last,
            notes=notes,
        )

    def _count(self, clause: Clause) -> int:
        numbers = _amounts(clause, "number", "times")
        twice = clause.every("twice")
        return 2 if twice else _whole(numbers[0]) if numbers else 1


def _parted(text: str) -> tuple[str, str, str]:
    """A phrase up to its first relation, the relation and what it is to."""
    spoken = text.split()
    for k in range(1, len(spoken)):
        name, size = naming.relations.relation_at(spoken, k)
        if size:
            return " ".join(spoken[:k]), name, " ".join(spoken[k + size :]).removeprefix("the ")
    return text, "", ""


def _anything(named: list[Named]) -> bool:
    """Are no things in particular meant: "all objects"?"""
    return bool(named) and all(one.words in ANYTHING for one in named)


def _motion(name: str, parts: list[tuple[Any, Amount]]) -> Entry:
    """A camera's motion or turn: the sum of parts along axes, or the low and high of what is drawn."""
    ends = [
        [sum(axis[k] * one.ends[end] for axis, one in parts) for k in range(3)] for end in (0, 1)
    ]
    low, high = ([tidy(pick(pair)) or 0 for pair in zip(*ends, strict=True)] for pick in (min, max))
    return {name: low if low == high else [low, high]}


def _look(where: Target, look: Entry) -> Entry:
    """The edit that gives one thing one look."""
    if "color" in look:
        if look["color"] == ANY and where == TABLE:
            return {"op": "table_color"}
        return {"op": "recolor", "target": where, **look}
    given = {name: value for name, value in look.items() if value is not None}
    if "style" in look:
        return {"op": "stylize", "target": where, **given}
    own = {str(TABLE): "table_texture", str(BACKGROUND): "background_texture"}.get(str(where))
    return {"op": own, **given} if own else {"op": "retexture", "target": where, **given}


def _one(options: list[Entry]) -> Entry:
    return options[0] if len(options) == 1 else {"one_of": options}


def _lit(low: list[float], high: list[float] | None = None) -> Entry:
    return {"op": "light_color", "range": [low, high or low]}


def _kelvin(kelvin: float) -> list[float]:
    """The lamps' color at a color temperature: Krystek 1985 gives the chromaticity, linear sRGB of the same brightness.

    Raises NotUnderstood outside 1000 to 15000 K, where the formula holds.
    """
    if not 1000 <= kelvin <= 15000:
        raise NotUnderstood(f"{kelvin:g} K: color temperatures are within 1000..15000")
    u = (0.860117757 + 1.54118254e-4 * kelvin + 1.28641212e-7 * kelvin**2) / (
        1 + 8.42420235e-4 * kelvin + 7.08145163e-7 * kelvin**2
    )
    v = (0.317398726 + 4.22806245e-5 * kelvin + 4.20481691e-8 * kelvin**2) / (
        1 - 2.89741816e-5 * kelvin + 1.61456053e-7 * kelvin**2
    )
    x, y = 3 * u / (2 * u - 8 * v + 4), 2 * v / (2 * u - 8 * v + 4)
    linear = color_space.FROM_XYZ @ [x / y, 1.0, (1 - x - y) / y]
    white = [max(float(one), 0.0) for one in linear / linear.max()]
    return [
        tidy(RECORDED * float(one)) for one in color_space.from_linear(color_space.np.array(white))
    ]


def _alike(kind: str, categories: list[str]) -> str | None:
    """The category that means about the same; none without the extra `words`."""
    try:
        return synonym(kind, categories)
    except MissingExtra:
        return None


def library_names() -> frozenset[str]:
    """What the library's assets are called."""
    return frozenset(one.name for one in library.assets())


def asset(text: str, tint: Any, generates: bool) -> tuple[Entry, list[str]]:
    """The fields of `insert` that find a thing in the library. Raises NotUnderstood if nobody has or makes it."""
    parts = [singular(word) for word in text.split()]
    known = library.assets()
    categories = sorted({one.category for one in known})
    tints = [one for word in parts if (one := color_space.canonical(word))]
    plain = [word for word in parts if not color_space.canonical(word) or len(parts) == 1]
    plain = [word for word in plain if word not in ("small", "big", "coffee", "new")]
    kind, tint = " ".join(plain), (tints[0] if tints else tint)
    exact = [
        one.name
        for one in known
        if sorted(one.name.split("_")) == sorted(parts) or one.name == text.replace(" ", "_")
    ]
    if exact and not (tints and kind in categories):
        return {"asset": exact[0]}, []
    if kind == "cube":
        kind = "block"
    notes, said = list[str](), kind
    if kind not in categories and plain[-1] in categories and len(plain) == 2 and not generates:
        notes.append(f"{kind!r} is taken to mean a {plain[-1]}")
        kind = plain[-1]
    if kind not in categories and not generates and (other := _alike(kind, categories)):
        notes.append(f"{kind!r} is taken to mean {other!r}")
        kind = other
    if kind not in categories and not generates:
        names = ", ".join(one.name for one in known)
        raise NotUnderstood(
            f"the library has no {kind!r}; kinds are: {', '.join(categories)}; names are: {names}. "
            "`rpaug assets add` adds one, and --generator has one made"
        )
    if tint and not generates:
        try:
            library.find(kind, tint)
        except TargetError as error:
            why = f"the library has no {said!r}: " if said != kind else ""
            raise NotUnderstood(
                f"{why}{error}. `rpaug assets add` adds one, and --generator has one made"
            ) from None
    return {"category": kind, **({"color": tint} if tint else {})}, notes


def _excepted(clause: Clause) -> tuple[list[Named], list[Any]]:
    """The things, or else the colors, that a clause names as those that are not meant."""
    if not clause.has("not"):
        return [], []
    colored = any(one.kind == "color" for one in clause.tokens)
    apart = clause.things("not")
    clause.every("not")
    if colored and not apart and clause.has("any", "paint"):
        return [], clause.every("color")[-1].value
    return apart, []


def _amounts(clause: Clause, *kinds: str) -> list[Amount]:
    return [one.value for one in clause.every(*kinds)]


def _whole(amount: Amount) -> int:
    if amount.low != int(amount.low) or amount.low < 1 or amount.low != amount.high:
        raise NotUnderstood(f"{amount.low:g} to {amount.high:g} things: say one whole number")
    if amount.low > MOST:
        raise NotUnderstood(f"{amount.low:g} things are too many: at most {MOST} at once")
    return int(amount.low)


def _done(*edits: Entry, mention: Mention | None = None, notes: tuple[str, ...] = ()) -> Meant:
    return Meant(edits=edits, mention=mention, notes=notes)
