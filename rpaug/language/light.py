"""Rules for the lamps, and for what the sensor does to finished images."""
# ruff: noqa: E501  # patterns are easiest to read whole

from typing import Any

from rpaug.language import slots
from rpaug.language.grammar import Said, done, refuse, rule
from rpaug.language.messages import Meant, Mention

RECORDED = 0.5  # the lamps' recorded brightness in `light_color`'s unit
DIM, BRIGHT = 0.3, 0.8
WARM, COOL = (0.5, 0.42, 0.32), (0.38, 0.44, 0.5)
LIGHT = Mention(kind="light")
LEVEL = r"(?:(?:the )?(?:brightness|intensity|level|strength|power) of <LIGHT>|<LIGHT>(?:(?:'s|')? (?:brightness|intensity|level|levels|strength|power))?)"
DIM_VERB, BRIGHT_VERB = (
    r"(?:dim|darken|reduce|lower|decrease|weaken)",
    r"(?:brighten|increase|raise|boost|strengthen|amplify)",
)
SCENE = r"(?:it|the scene|everything|the table|the workspace|the room|the desk|things)"
ABOVE = r"(?:straight |right |directly )?(?P<above>above|overhead|the top|up above|the ceiling)"


@rule(r"(?:switch|turn) <LIGHT> off", r"(?:switch|turn) off <LIGHT>", r"(?:put|turn) out <LIGHT>")
def off(stated: Said) -> Meant:
    raise refuse("without light there is no picture; dim the lights by a share instead")


@rule(r"<VARY> (?:the )?(?:colou?r|tint|hue)s? of <LIGHT>",
      r"<VARY> <LIGHT>(?:'s|')?(?: (?:colou?rs?|tints?|hues?))?",
      r"(?:a |use |use a |some )?(?:random|different|new|other|another) <LIGHT>(?:'s|')?(?: colou?rs?)?",
      r"(?:a |use a )?(?:random|different|new|other|another) colou?r (?:for|on) <LIGHT>",
      r"(?:give|make|turn|paint|colou?r|tint) <LIGHT> (?:a |any |some |in a )?(?:random|different|new|other|another)? ?colou?r")  # fmt: skip
def any_light(stated: Said) -> Meant:
    return done({"op": "light_color"}, mention=LIGHT)


@rule(
    r"(?:<PAINT>|cast|bathe) <LIGHT>(?:(?:'s|')? colou?r)? (?:to |into |in )?(?:an? )?{tint}(?: colou?r| tint| tinge| hue| cast| glow)?",
    r"<PAINT> (?:the )?colou?r of <LIGHT> (?:to |into )?(?:a )?{tint}",
    r"(?:light|illuminate|bathe) (?:it|the scene|everything|the table|the room) (?:in|with) (?:a )?{tint}(?: lights?| lamps?| lighting)?",
    r"(?:let|make|have) <LIGHT> (?:glow|shine|be|burn) (?:in )?(?:a )?{tint}",
    r"(?:swap|exchange|replace|change|switch) <LIGHT> (?:for|with|by|to|into) (?:an? |some )?{tint}(?: ones?| lights?| lamps?| lighting)?",
    r"(?:use |shine |add |have )?(?:a )?{tint} <LIGHT>(?: (?:on|over|in) (?:it|the scene|everything|the table))?",
)
def tinted(stated: Said) -> Meant:
    tint = slots.rgb(slots.color(stated["tint"]))
    return _lit(tuple(slots.rounded(RECORDED * (0.5 + 0.5 * v)) for v in tint))


@rule(r"(?:make|turn) <LIGHT> (?:a bit |a little |slightly |much )?(?P<way>warmer|warm|cooler|cool|colder|cold)",
      r"(?P<way>warm|cool) <LIGHT>(?: (?:up|down|off))?(?: a bit| a little| slightly)?", r"(?P<way>warm|cool) (?:up|down|off) <LIGHT>",
      r"(?:light|illuminate) (?:it|the scene|everything|the table) (?:more )?(?P<way>warmer|warm|cooler|cool|colder|cold)(?:ly)?",
      r"(?:use |with |add )?(?:a )?(?P<way>warmer|warm|cooler|cool|colder|cold)(?:-colou?red| colou?red)? <LIGHT>")  # fmt: skip
def warm(stated: Said) -> Meant:
    return _lit(WARM if stated["way"].startswith("warm") else COOL)


@rule(rf"(?:{DIM_VERB}|turn down|tone down|dial down|bring down) {LEVEL}(?: down)?(?: by {{share}})?",
      rf"(?:turn|tone|dial|bring|take|dim) {LEVEL} down(?: (?:by )?{{share}})?",
      rf"{DIM_VERB} {LEVEL} {{share}}",
      r"(?:make|turn|get) <LIGHT> (?:by )?(?:{share} )?(?:a bit |a little |slightly |much )?(?:dimmer|darker|dim|dark|weaker|less bright|fainter)",
      r"(?:make|turn|get) <LIGHT> (?:dimmer|darker|weaker|less bright) by {share}",
      r"<LIGHT> (?:by )?{share} (?:dimmer|darker|weaker|down)", r"<LIGHT> (?:dimmer|darker|down)(?: by {share})?",
      r"(?:use |with |add )?(?:a )?(?:dimmer|darker|dim|less|weaker) <LIGHT>", r"{share} less light", r"<LIGHT> (?:dimmed|darkened|reduced)(?: by {share})?")  # fmt: skip
def dim(stated: Said) -> Meant:
    return _level(
        RECORDED * (1 - slots.share(stated["share"])) if stated.get("share") else DIM, stated
    )


@rule(rf"(?:{BRIGHT_VERB}|turn up|dial up|bring up|crank up|bump up) {LEVEL}(?: up)?(?: by {{share}})?",
      rf"(?:turn|dial|bring|crank|bump) {LEVEL} up(?: (?:by )?{{share}})?",
      rf"{BRIGHT_VERB} {LEVEL} {{share}}",
      r"(?:make|turn|get) <LIGHT> (?:by )?(?:{share} )?(?:a bit |a little |slightly |much )?(?:brighter|bright|stronger|less dim)",
      r"(?:make|turn|get) <LIGHT> (?:brighter|stronger) by {share}",
      r"<LIGHT> (?:by )?{share} (?:brighter|stronger|up)", r"<LIGHT> (?:brighter|up)(?: by {share})?",
      r"(?:use |with |add )?(?:a )?(?:brighter|bright|more|stronger) <LIGHT>", r"{share} more light")  # fmt: skip
def brighten(stated: Said) -> Meant:
    return _level(
        RECORDED * (1 + slots.share(stated["share"])) if stated.get("share") else BRIGHT, stated
    )


@rule(r"(?:make |set |put |turn |dim )?<LIGHT> (?:at |to )?(?P<times>twice|half|{number} times) (?:as (?:bright|strong|much)|(?:of )?(?:the|its|their) (?:own |original |recorded |current |present |usual )?(?:brightness|intensity|strength|level)|brighter)",
      rf"(?:dim|set|reduce|lower|bring|turn) {LEVEL}(?: down)? to (?P<times>half|twice)",
      rf"(?:dim|set|reduce|lower|bring|turn|raise|increase|change|brighten) {LEVEL}(?: down| up)? to {{share}}(?: of (?:the|its|their|what it|what they) .+)?",
      r"(?P<times>twice|half|{number} times) as much light",
      rf"(?P<times>double|halve) {LEVEL}")  # fmt: skip
def times(stated: Said) -> Meant:
    fixed = {"twice": 2.0, "half": 0.5, "double": 2.0, "halve": 0.5}
    if stated.get("share"):
        return _level(RECORDED * slots.share(stated["share"]), stated)
    factor = fixed.get(stated["times"]) or slots.number(stated["number"])
    return _level(RECORDED * factor, stated)


@rule(r"<PUT> <LIGHT>(?: (?:elsewhere|somewhere else|around|about|randomly))?", r"turn <LIGHT>(?: around)?",
      rf"(?:light|illuminate) {SCENE} from (?:another|a different|a new|a random|some other|any) (?:direction|side|angle|place|position)",
      r"<VARY> the (?:direction|position|angle|place|placement|location)s? of <LIGHT>(?:,? (?:by )?<UP_TO> {angle})?",
      r"<VARY> (?:the )?(?:light|lamp|lighting|lights|lamps)(?:'s|')? (?:direction|position|angle|placement|location)s?(?:,? (?:by )?<UP_TO> {angle})?",
      r"(?:<VARY> )?(?:where|from where) (?:the )?(?:light|lights|lamp|lamps|lighting) (?:comes?|shines?|is|are|stands?|hangs?)(?: from)?",
      r"(?:a |use a )?(?:random|different|new|another) (?:light|lamp|lighting) (?:direction|position|angle)",
      r"(?:move|turn|rotate|shift|swing|tilt|jitter|swivel|wobble)(?: the direction of)? <LIGHT>(?: a?round| about)?,? (?:by )?<UP_TO> {angle}",
      r"(?:let|have|make) <LIGHT> (?:come|shine) from (?:another|a different|a new|a random|some other) (?:direction|side|angle|place)")  # fmt: skip
def elsewhere(stated: Said) -> Meant:
    limit = {"turn": slots.angle(stated["angle"])} if stated.get("angle") else {}
    return done({"op": "light_direction", **limit}, mention=LIGHT)


@rule(r"(?:move|turn|rotate|shift|swing|tilt|swivel) <LIGHT> (?:by )?{angle}")
def exactly(stated: Said) -> Meant:
    raise refuse(
        "a lamp turns by at most an angle, about any axis: say `up to`, or give the direction (x, y, z) to it"
    )


@rule(rf"(?:light|illuminate) {SCENE} from {ABOVE}",
      r"<PUT> <LIGHT> (?:straight |right |directly )?(?P<above>above|overhead|on top|over)(?: (?:of )?(?:the table|the scene|it|everything|the workspace))?",
      rf"(?:let|have|make|shine) <LIGHT> (?:(?:come|shine|fall|be) )?(?:down )?from {ABOVE}", rf"(?:use |add |shine )?<LIGHT> from {ABOVE}",
      r"(?:<PUT>|turn|point|aim) <LIGHT> (?:in|to|into|at|towards?) (?:the )?(?:direction )?{triple}",
      r"(?:let|have|make|shine) <LIGHT> (?:come |shine )?from (?:the )?(?:direction )?{triple}",
      rf"(?:light|illuminate) {SCENE} from (?:the )?(?:direction )?{{triple}}")  # fmt: skip
def towards(stated: Said) -> Meant:
    to = slots.numbers(stated["triple"]) if stated.get("triple") else [0, 0, 1]
    return done({"op": "light_direction", "to": to}, mention=LIGHT)


@rule(rf"(?:light|illuminate) {SCENE} from .+",
      r"(?:<PUT>|turn) <LIGHT> (?:to|on|from) the .+")  # fmt: skip
def which_side(stated: Said) -> Meant:
    raise refuse(
        "the lamp's directions are the world's: say `from above`, or give the direction (x, y, z) to it"
    )


NOISE = r"(?:some |more |a bit of |a little )?(?:random )?(?:sensor |camera |image |pixel )?(?:noise|grain)"
SENSORS = r"(?:<IMAGES>|all cameras|the cameras|all the cameras|the camera|every camera)"
ADD = r"(?:add|use|put on|introduce|apply|inject|include|put)"
ON = rf"(?: (?:to|on|in|into|for) {SENSORS})?"


@rule(rf"{ADD} {NOISE}{ON}", rf"give {SENSORS} {NOISE}(?: (?:of )?<UP_TO> {{share}}| of {{share}})?",
      rf"(?:{ADD} )?{NOISE}{ON} (?:of |with )?between (?P<low>{slots.PERCENT}) and (?P<high>{slots.PERCENT}){ON}", rf"give {SENSORS} {NOISE} (?:of |with )?between (?P<low>{slots.PERCENT}) and (?P<high>{slots.PERCENT})",
      rf"{NOISE} (?:to|on|in|for) {SENSORS}", r"(?:sensor|camera|image|pixel) noise",
      rf"(?:make|render|get) {SENSORS} (?:more |a bit |a little |slightly )?(?:noisy|noisier|grainy|grainier)", r"(?:noisy|noisier|grainy|grainier) <IMAGES>",
      rf"(?:noise|roughen) {SENSORS}(?: up)?",
      rf"(?:{ADD} )?{NOISE}{ON},? (?:with )?<UP_TO> {{share}}",
      rf"(?:{ADD} )?<UP_TO> {{share}} (?:of )?{NOISE}{ON}", rf"(?:{ADD} )?{{share}} (?:of )?{NOISE}{ON}",
      rf"(?:{ADD} )?{NOISE} <UP_TO> {{share}}{ON}", rf"(?:{ADD} )?{NOISE} (?:of|at|with) {{share}}{ON}")  # fmt: skip
def noise(stated: Said) -> Meant:
    if stated.get("low"):
        drawn = [slots.share(stated["low"]), slots.share(stated["high"])]
        return done({"op": "sensor_noise", "read": drawn})
    if not stated.get("share"):
        return done({"op": "sensor_noise"})
    most = slots.share(stated["share"])
    return done(
        {"op": "sensor_noise", "read": [0, most]}, notes=(f"noise is drawn up to {most:g}",)
    )


BLURRED = r"(?:(?:slightly |a bit |a little )?(?:out of focus|blurry|blurrier|blurred|defocused|softer|unsharp))"
BLUR = rf"(?:(?:blur|soften|defocus|smooth|smear) {SENSORS}|(?:put|make|have|get|render) {SENSORS} {BLURRED}|(?:{ADD} |give {SENSORS} )?(?:a |some |a bit of )?(?:gaussian |lens |random )?(?:blur|defocus)(?:ring)?{ON})"


@rule(rf"{BLUR}(?: (?:a bit|slightly|a little))?", r"(?:blurry|blurrier|blurred|soft|softer) <IMAGES>",
      rf"{BLUR}{ON},? (?:by |of |with )?(?:a sigma of |sigma )?(?P<low>{slots.NUMBER}) ?(?:pixels?|px)",
      rf"(?:{ADD} )?(?:a )?(?P<low>{slots.NUMBER})[ -]?(?:pixels?|px)(?: of)? blur{ON}",
      rf"{BLUR}{ON},? (?:with )?<UP_TO> (?P<most>{slots.NUMBER}) ?(?:pixels?|px)",
      rf"(?:{ADD} )?<UP_TO> (?P<most>{slots.NUMBER}) ?(?:pixels?|px) of blur{ON}",
      rf"{BLUR}{ON},? (?:by |of )?between (?P<low>{slots.NUMBER})(?: (?:pixels?|px))? and (?P<high>{slots.NUMBER}) ?(?:pixels?|px){ON}")  # fmt: skip
def blur(stated: Said) -> Meant:
    if stated.get("most"):
        return done({"op": "sensor_blur", "sigma": [0.3, slots.tidy(slots.number(stated["most"]))]})
    return done({"op": "sensor_blur", **_interval("sigma", stated)})


JPEG = rf"jpe?gs?(?:[ -](?:compression|artefacts|artifacts|encoding|quality))?{ON}"
AS_JPEG = r"(?: (?:as|with|by|to|in|using|into) (?:a )?(?:jpe?gs?)(?: compression)?)?"
QUALITY = rf"(?:,? (?:with |at |of |to |by |= ?|in )?(?:an? )?(?:jpe?g )?(?:quality(?: level| factor| setting)?(?: of| =| at)? )?(?:(?:between |from )?(?P<low>{slots.NUMBER})(?: ?(?:to|and|-) ?(?P<high>{slots.NUMBER}))?)(?: quality)?)"
SAVE = r"(?:compress|encode|save|store|re-?encode|re-?compress|write|degrade)"


@rule(rf"{SAVE} <IMAGES>{AS_JPEG}{QUALITY}?", rf"jpe?g[ -]?(?:compress|encode) <IMAGES>{QUALITY}?", rf"jpe?g <IMAGES>{QUALITY}?", rf"jpe?g-compressed <IMAGES>{QUALITY}?",
      rf"give <IMAGES> (?:some )?{JPEG}{QUALITY}?",
      rf"(?:(?:{ADD}|set|vary|randomi[sz]e|change|make) )?(?:some |the )?{JPEG}{QUALITY}?",
      rf"(?:make |turn )<IMAGES> (?:into )?jpe?gs?{QUALITY}?",
      rf"(?:{ADD} )?(?:a )?quality (?P<low>{slots.DIGITS}) jpe?g(?: compression)?{ON}")  # fmt: skip
def jpeg(stated: Said) -> Meant:
    return done({"op": "sensor_jpeg", **_interval("quality", stated)})


STOPS = rf"(?P<stops>{slots.NUMBER}) ?(?:of an? )?(?:f-?)?(?:stops?|ev)"
LESS = (
    "under",
    "darker",
    "darken",
    "reduce",
    "decrease",
    "lower",
    "less",
    "down",
    "drop",
    "cut",
    "pull down",
)
EXPOSURE = rf"(?:the )?(?:image |camera )?exposure(?: of {SENSORS})?"


@rule(rf"(?P<way>under|over)-?expose(?: {SENSORS})?(?: (?:by )?{STOPS})?",
      rf"(?:make|expose|render|turn) {SENSORS} (?:by )?{STOPS} (?P<way>brighter|darker|more|less|lighter)",
      rf"(?:make|render|turn) {SENSORS} (?P<way>brighter|darker|lighter)(?: (?:by )?{STOPS})?",
      rf"(?P<way>brighten|darken|lighten) {SENSORS}(?: (?:by )?{STOPS})?",
      rf"{SENSORS} {STOPS} (?P<way>brighter|darker|lighter)", rf"{STOPS} (?P<way>brighter|darker|lighter)(?: <IMAGES>)?",
      rf"{STOPS} (?:of )?(?P<way>over|under)-?exposure", rf"(?:move |turn |set )?{EXPOSURE} (?P<way>up|down)(?: (?:by )?{STOPS})?", rf"(?:turn|bring|take) (?P<way>up|down) {EXPOSURE}(?: (?:by )?{STOPS})?",
      rf"(?P<way>increase|reduce|decrease|raise|lower|boost|drop|cut|bump up|push up|pull down) {EXPOSURE}(?: (?:by )?{STOPS})?")  # fmt: skip
def exposure(stated: Said) -> Meant:
    less = stated["way"] in LESS
    amount = slots.tidy(slots.number(stated["stops"])) if stated.get("stops") else 1
    notes = () if stated.get("stops") else ("one stop, since no amount was named",)
    value = -amount if less else amount
    return done({"op": "sensor_exposure", "stops": [value, value]}, notes=notes)


@rule(rf"<VARY> {EXPOSURE}(?:,? (?:by )?<UP_TO> (?P<most>{slots.NUMBER}) ?(?:stops?|ev)(?: either way| in either direction| up or down)?)?",
      rf"<VARY> {EXPOSURE} (?:by |within )?(?P<most>{slots.NUMBER}) ?(?:stops?|ev) (?:either way|in either direction|up or down)",
      r"(?:a |use |use a )?(?:random|varying|different|varied) exposures?(?: (?:for|on) <IMAGES>)?")  # fmt: skip
def any_exposure(stated: Said) -> Meant:
    if not stated.get("most"):
        return done({"op": "sensor_exposure"})
    most = slots.tidy(slots.number(stated["most"]))
    return done({"op": "sensor_exposure", "stops": [-most, most]})


def _interval(name: str, stated: Said) -> dict[str, Any]:
    """A field's low and high, the same if one number was said."""
    low = stated.get("low")
    if low is None:
        return {}
    return {
        name: [slots.tidy(slots.number(low)), slots.tidy(slots.number(stated.get("high") or low))]
    }


def _level(value: float, stated: Said) -> Meant:
    if not 0 < value <= 1:
        raise refuse(
            f"lamps can be from 0 to 2 times as bright as recorded, not {value / RECORDED:g}"
        )
    return _lit((slots.rounded(value),) * 3)


def _lit(color: tuple[float, ...]) -> Meant:
    return done({"op": "light_color", "range": [list(color), list(color)]}, mention=LIGHT)
