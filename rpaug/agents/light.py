"""Rules for the lamps, and for what the sensor does to finished images."""
# ruff: noqa: E501  # patterns are easiest to read whole

from typing import Any

from rpaug.agents import slots
from rpaug.agents.grammar import Said, done, refuse, rule
from rpaug.agents.messages import Meant, Mention

RECORDED = 0.5  # the lamps' recorded brightness in `light_color`'s unit
DIM, BRIGHT = 0.3, 0.8
WARM, COOL = (0.5, 0.42, 0.32), (0.38, 0.44, 0.5)
LIGHT = Mention(kind="light")


@rule(r"(?:switch|turn) <LIGHT> off", r"(?:switch|turn) off <LIGHT>", r"(?:put|turn) out <LIGHT>")
def off(said: Said) -> Meant:
    raise refuse("without light there is no picture; dim the lights by a share instead")


@rule(r"(?:change|vary|randomi[sz]e|jitter) (?:the )?colou?r of <LIGHT>",
      r"(?:change|vary|randomi[sz]e|jitter) <LIGHT>(?:'s)?(?: colou?rs?)?",
      r"(?:a |use |use a )?(?:random|different|new|other|another) <LIGHT>(?:'s)?(?: colou?rs?)?",
      r"(?:give|make) <LIGHT> a (?:random|different|new) colou?r")  # fmt: skip
def any_light(said: Said) -> Meant:
    return done({"op": "light_color"}, mention=LIGHT)


@rule(
    r"(?:make|turn|paint|change|set) <LIGHT> (?:colou?r )?(?:to |into )?{tint}", r"{tint} <LIGHT>"
)
def tinted(said: Said) -> Meant:
    tint = slots.rgb(slots.colour(said["tint"]))
    return _lit(tuple(slots.rounded(RECORDED * (0.5 + 0.5 * v)) for v in tint))


@rule(r"(?:make|turn) <LIGHT> (?:a bit |a little |slightly |much )?(?P<way>warmer|warm|cooler|cool|colder|cold)",
      r"(?:use )?(?P<way>warmer|warm|cooler|cool|colder|cold) <LIGHT>")  # fmt: skip
def warm(said: Said) -> Meant:
    return _lit(WARM if said["way"].startswith("warm") else COOL)


@rule(r"(?:dim|darken|reduce|lower) <LIGHT>(?: by {share})?",
      r"(?:make|turn) <LIGHT> (?:{share} )?(?:dimmer|darker|dim|dark)",
      r"(?:make|turn) <LIGHT> (?:dimmer|darker) by {share}",
      r"turn down <LIGHT>(?: by {share})?",
      r"(?:use )?(?:dimmer|darker|dim|less) <LIGHT>")  # fmt: skip
def dim(said: Said) -> Meant:
    return _level(RECORDED * (1 - slots.share(said["share"])) if said.get("share") else DIM, said)


@rule(r"(?:brighten|increase|raise) <LIGHT>(?: by {share})?",
      r"(?:make|turn) <LIGHT> (?:{share} )?(?:brighter|bright|stronger)",
      r"(?:make|turn) <LIGHT> (?:brighter|stronger) by {share}",
      r"turn up <LIGHT>(?: by {share})?",
      r"(?:use )?(?:brighter|bright|more|stronger) <LIGHT>")  # fmt: skip
def brighten(said: Said) -> Meant:
    return _level(
        RECORDED * (1 + slots.share(said["share"])) if said.get("share") else BRIGHT, said
    )


@rule(r"(?:make )?<LIGHT> (?P<times>twice|half|{number} times) as (?:bright|strong|much)",
      r"(?P<times>twice|half|{number} times) as much light",
      r"(?P<times>double|halve) <LIGHT>")  # fmt: skip
def times(said: Said) -> Meant:
    fixed = {"twice": 2.0, "half": 0.5, "double": 2.0, "halve": 0.5}
    factor = fixed.get(said["times"]) or slots.number(said["number"])
    return _level(RECORDED * factor, said)


@rule(r"(?:move|turn|shift|relocate) <LIGHT>(?: (?:elsewhere|somewhere else|around))?",
      r"(?:light|illuminate) (?:it|the scene|everything|the table) from (?:another|a different|a new|a random) (?:direction|side|angle)",
      r"(?:vary|change|randomi[sz]e) the (?:direction|position) of <LIGHT>",
      r"(?:vary|change|randomi[sz]e) (?:the )?(?:light|lamp|lighting)(?:'s)? (?:direction|position|angle)",
      r"(?:move|turn|rotate) <LIGHT> by <UP_TO> {angle}", r"(?:move|turn|rotate) <LIGHT> <UP_TO> {angle}")  # fmt: skip
def elsewhere(said: Said) -> Meant:
    limit = {"turn": slots.angle(said["angle"])} if said.get("angle") else {}
    return done({"op": "light_direction", **limit}, mention=LIGHT)


@rule(r"(?:move|turn|rotate) <LIGHT> (?:by )?{angle}")
def exactly(said: Said) -> Meant:
    raise refuse(
        "a lamp turns by at most an angle, about any axis: say `up to`, or give the direction (x, y, z) to it"
    )


@rule(r"(?:light|illuminate) (?:it|the scene|everything|the table) from (?:straight |right )?(?P<above>above|overhead|the top)",
      r"(?:put|move|place|set) <LIGHT> (?:straight |right )?(?P<above>above|overhead|on top)(?: (?:the table|the scene|it))?",
      r"(?:put|move|place|set|turn) <LIGHT> (?:in|to|into|at|towards) (?:the )?(?:direction )?{triple}",
      r"(?:light|illuminate) (?:it|the scene|everything|the table) from (?:the )?(?:direction )?{triple}")  # fmt: skip
def towards(said: Said) -> Meant:
    to = slots.numbers(said["triple"]) if said.get("triple") else [0, 0, 1]
    return done({"op": "light_direction", "to": to}, mention=LIGHT)


@rule(r"(?:light|illuminate) (?:it|the scene|everything|the table) from .+",
      r"(?:put|move|place|set|turn) <LIGHT> (?:to|on|from) the .+")  # fmt: skip
def which_side(said: Said) -> Meant:
    raise refuse(
        "the lamp's directions are the world's: say `from above`, or give the direction (x, y, z) to it"
    )


NOISE = r"(?:some |more |a bit of |a little )?(?:sensor |camera |image )?noise"
SENSORS = r"(?:<IMAGES>|all cameras|the cameras|all the cameras|the camera)"


@rule(rf"(?:add|use|put on|introduce) {NOISE}(?: (?:to|on) {SENSORS})?",
      rf"make {SENSORS} (?:more )?(?:noisy|noisier|grainy)",
      rf"(?:add |use )?{NOISE} <UP_TO> {{share}}",
      rf"(?:add |use )?{NOISE} of {{share}}")  # fmt: skip
def noise(said: Said) -> Meant:
    if not said.get("share"):
        return done({"op": "sensor_noise"})
    most = slots.share(said["share"])
    return done(
        {"op": "sensor_noise", "read": [0, most]}, notes=(f"noise is drawn up to {most:g}",)
    )


@rule(rf"(?:blur|soften|defocus) {SENSORS}(?: (?:a bit|slightly|a little))?",
      rf"(?:put|make|have|get) {SENSORS} (?:slightly |a bit |a little )?(?:out of focus|blurry|blurred|defocused)",
      r"(?:add|use) (?:some |a bit of |lens )?blur",
      rf"(?:blur|soften|defocus) {SENSORS} by {{low}} (?:pixels?|px)",
      rf"(?:blur|soften|defocus) {SENSORS} <UP_TO> (?P<most>{slots.DIGITS}) (?:pixels?|px)",
      rf"(?:blur|soften|defocus) {SENSORS} (?:by )?between {{low}} and {{high}} (?:pixels?|px)")  # fmt: skip
def blur(said: Said) -> Meant:
    if said.get("most"):
        return done({"op": "sensor_blur", "sigma": [0.3, slots.numbers(said["most"])[0]]})
    return done({"op": "sensor_blur", **_interval("sigma", said)})


JPEG = r"jpe?g"


@rule(rf"(?:compress|encode|save|store) <IMAGES>(?: (?:as|with|by) {JPEG})?(?: (?:with|at|of) (?:a )?quality(?: of)? {{low}}(?: to {{high}})?)?",
      rf"(?:add |use |put on )?(?:some )?{JPEG}(?: (?:compression|artefacts|artifacts))?"
      r"(?: (?:with |at |of )?(?:a )?quality(?: of)? {low}(?: to {high})?)?",
      rf"(?:add |use )?(?:some )?{JPEG}(?: (?:compression|artefacts|artifacts))? (?:with |at |of )?(?:quality )?between (?:quality )?{{low}} and {{high}}")  # fmt: skip
def jpeg(said: Said) -> Meant:
    return done({"op": "sensor_jpeg", **_interval("quality", said)})


STOPS = r"(?P<stops>{NUMBER}) (?:of a )?(?:stops?|ev)".replace("{NUMBER}", slots.NUMBER)


@rule(rf"(?P<way>under|over)-?expose(?: {SENSORS})?(?: by {STOPS})?",
      rf"make {SENSORS} (?:by )?{STOPS} (?P<way>brighter|darker)",
      rf"make {SENSORS} (?P<way>brighter|darker)(?: by {STOPS})?",
      rf"(?P<way>brighten|darken) {SENSORS}(?: by {STOPS})?",
      rf"(?P<way>increase|reduce|decrease|raise|lower) the exposure(?: by {STOPS})?")  # fmt: skip
def exposure(said: Said) -> Meant:
    less = said["way"] in ("under", "darker", "darken", "reduce", "decrease", "lower")
    amount = slots.number(said["stops"]) if said.get("stops") else 1.0
    amount = int(amount) if amount == int(amount) else amount
    notes = () if said.get("stops") else ("one stop, since no amount was named",)
    value = -amount if less else amount
    return done({"op": "sensor_exposure", "stops": [value, value]}, notes=notes)


@rule(r"(?:vary|randomi[sz]e|change|jitter) the exposure(?: (?:by )?<UP_TO> (?P<most>{number}) (?:stops?|ev))?",
      r"(?:a |use |use a )?(?:random|varying|different) exposure")  # fmt: skip
def any_exposure(said: Said) -> Meant:
    if not said.get("most"):
        return done({"op": "sensor_exposure"})
    most = slots.number(said["most"])
    most = int(most) if most == int(most) else most
    return done({"op": "sensor_exposure", "stops": [-most, most]})


def _interval(name: str, said: Said) -> dict[str, Any]:
    """A field's low and high, the same if one number was said."""
    low = said.get("low")
    if low is None:
        return {}
    return {name: [slots.numbers(low)[0], slots.numbers(said.get("high") or low)[0]]}


def _level(value: float, said: Said) -> Meant:
    if not 0 < value <= 1:
        raise refuse(
            f"lamps can be from 0 to 2 times as bright as recorded, not {value / RECORDED:g}"
        )
    return _lit((slots.rounded(value),) * 3)


def _lit(colour: tuple[float, ...]) -> Meant:
    return done({"op": "light_color", "range": [list(colour), list(colour)]}, mention=LIGHT)
