"""Words that mean the same to the rules: verbs by what they ask for, and what is said out of politeness."""

from collections.abc import Mapping

from rpaug.language.slots import any_of


def _any(words: str) -> str:
    return any_of(tuple(" ".join(word.split()) for word in words.split(",")))


VERBS: Mapping[str, str] = {
    "VARY": _any(
        """
        vary, randomise, randomize, rerandomise, rerandomize, change, jitter, alter, modify, diversify, perturb,
        shake up, mix up, switch up, swap, swap out
        """
    ),
    "SHAKE": _any(
        """
        jitter, shake, bump, perturb, wiggle, wobble, jiggle, joggle, jostle, nudge, rattle, knock, disturb,
        randomise, randomize, vary, alter, change, diversify
        """
    ),
    "REMOVE": _any(
        """
        remove, delete, erase, get rid of, take away, take out, eliminate, hide, discard, clear away, clear out,
        wipe out, throw out, throw away, toss out, chuck out, cut out, edit out, paint out, scrap, ditch, lose,
        dispose of, do away with, strip out, leave out, omit, banish, exclude
        """
    ),
    "PAINT": _any(
        """
        make, paint, repaint, re-paint, spray, spray-paint, spray paint, recolour, recolor, re-colour, re-color,
        colour, color, turn, dye, tint, stain, render, change, set, swap, switch, convert, coat, shade, give
        """
    ),
    "ADD": _any(
        """
        add, put, place, insert, set, stand, drop, introduce, spawn, include, throw in, toss in, drop in, bring
        in, mix in, put in, create, generate, position, lay
        """
    ),
    "PUT": _any(
        """
        move, shift, push, pull, slide, put, place, set, bring, displace, relocate, nudge, drag, carry, shove,
        transfer, reposition, lay, stand, scoot, take, position, translate, stick, park
        """
    )
    + r"(?: down| over)?",
}
POLITE = _any(
    """
    please, plz, pls, kindly, ok, okay, hey, hi, hello, well, right, oh, actually, maybe, perhaps, simply,
    quickly, go ahead and, try to, make sure to, be so kind as to, now, then, also, and, next, finally, lastly,
    first, firstly, second, secondly, afterwards, after that, could you, can you, would you, will you, i want
    you to, i need you to, i would like you to, i'd like you to, i want to, we want to, i would like to, i'd
    like to, we'd like to, i wish to, may i ask you to, let us, let's, just, in addition, additionally, so
    """
)
THANKS = _any(
    """
    please, pls, plz, too, as well, also, now, thanks, thank you, thx, cheers, for me, will you, would you, if
    you can, if possible
    """
)
