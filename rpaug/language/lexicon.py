"""What words ask for in a wish, beside values and things: those of every operator's `asked_as`, and ours."""

from collections.abc import Mapping
from functools import cache

from rpaug.core import registry

OURS: Mapping[str, str] = {
    # Said without asking for anything: politeness, emphasis, and what holds of every edit anyway.
    "filler": "please, plz, pls, kindly, ok, okay, hey, hi, hello, well, oh, actually, maybe, perhaps, simply, just, also, "
    "too, now, as well, thanks, thank you, thx, can you, could you, would you, will you, can we, could we, can i, i, i'd, "
    "we, we'd, i'm, we're, want, wants, need, needs, love, prefer, wish, would, would like, i'd like, we'd like, like to, "
    "looking for, go ahead and, make sure, it would be nice to, it would be great if, let us, let's, if possible, ideally, "
    "preferably, if you can, in addition, additionally, afterwards, after that, then, next, finally, first, should, shall, "
    "must, ought, has to, have to, to be, be, been, per episode, per copy, in each copy, for each copy, in every copy, "
    "for every copy, each copy, every copy, one draw per episode, one per copy, one per episode, within an episode, "
    "in all views, in all cameras, in every view, over the whole episode, over the episode, from copy to copy, "
    "between copies, over the copies, consistently, no flicker, fixed over the episode, constant over the episode, "
    "keep the original shading, keep the shading, keeping the shading, and update the pcd, depth and masks too, whatever, "
    "instead, somehow, completely, all, totally, entirely, fully, really, very, quite, nicely, here, still, even, "
    "additional, extra, all at once, at once, obviously, never both at once, in any direction, either way, "
    "in either direction, in all directions, up or down, the, a, an, of, some, its, their, it's, own, by, at, for, "
    "on average, all of, or so, me, us, you, that's, thats, coat, layer, than that, than before, than it is, uniform, "
    "uniformly, anywhere, of what's there now, about, only, either, quickly, gaussian, no pattern, roughly, "
    "by the same offset, by the same rigid offset, the same rigid offset, instead of that, around the table, matching, "
    "that is, that are, whose longest side is, to have, look of, go crazy, incl, including, drawn, picked, theres",
    "do": "make, set, turn, switch, give, use, have, has, get, let, render, take, do, convert, replace, exchange, become, "
    "becomes, put, bring, go, goes, look, looks, look like, looks like, appear, gets, come, comes, coming, shine, apply, "
    "glow, bathe, cast, laid, wear, placed, on, onto, over, upon, choose, pick, draw, show, throw",
    "vary": "change, changes, changed, randomize, randomise, rand, random, randomly, vary, varied, jitter, diversify, "
    "perturb, perturbed, randomized, randomised, mix up, alter, modify, shake, bump, wobble, wiggle, jiggle, at random, "
    "different, another, other, new, various, varying, somewhere else, elsewhere, slightly off, a bit off, "
    "another one, a different one",
    "swap": "swap, swapped, exchanged, interchange",
    "image": "image, images, all images, every image, each image, all the images, picture, pictures, photo, photos, frame, "
    "frames, video, videos, footage, rgb images, color images, view, views, whole picture",
    "all": "everything, it all, whole scene, the scene, scene, every thing, the whole scene, all things, the room, room, "
    "whole thing",
    "rest": "the other two, the other three, other two, the other one, else, otherwise, the rest of the time, rest of the time, "
    "the other copies, other copies, the rest, rest, all the rest, everything else, all else, the others, others, the other things, all other things, "
    "all other objects",
    "to": "to, into, in, with, as, like, ->, :, =, onto, is, are, turns, made of, made out of, out of, as if made of",
    "on": "on the table, onto the table, on the desk, on the tabletop, somewhere on the table, to the scene, into the scene, "
    "in the scene, on table, to the table, around the table, across the table, over the table, all over the table, "
    "in the workspace, lying on the table, somewhere, standing on the table",
    "near": "next to, near, close to, beside, by the side of, nearby, alongside, around, in the vicinity of, right next to, "
    "adjacent to, around at",
    "from": "from, away from",
    "up": "up, upwards, upward, higher, raise, lift, elevate, raised, above",
    "down": "down, downwards, downward, lower, lowered, drop, further down",
    "left": "left, from the robot left, leftwards, to the left, towards the left, the left, left side, the left side, "
    "left hand side",
    "right": "right, from the robot right, rightwards, to the right, towards the right, the right, right side, "
    "the right side, right hand side",
    "ahead": "forward, forwards, closer, nearer, ahead, towards the scene, closer to the table, closer to the scene, "
    "towards the table",
    "back": "back, backward, backwards, farther, further away, farther away, away from the table, further back, back off",
    "off": "away from the robot, away from robot, from the robot",
    "close": "towards the robot, toward the robot, closer to the robot, nearer to the robot",
    "further": "further, more, a bit more",
    "little": "slightly, a bit, a little, a little bit, somewhat, a touch, a touch of, mildly, mild, a tad",
    "much": "a lot, much, strongly, far, considerably",
    "and": "and, plus, and the, ',', both",
    "or": "or, vs",
    "any": "any, any color, arbitrary",
    "not": "instead of, rather than, except, but, except for, apart from, other than, besides, but not, all but, excluding, without, not",
    "more": "increase, boost, strengthen, turn up, amplify, bump up",
    "less": "reduce, decrease, turn down, weaken, tone down",
    "twice": "twice, double, doubled, twice as",
    "halve": "halve, half as, half the",
    "same": "the same, same, identical",
    "each": "each its own, separately, individually, independently, each, every, drawn independently, for each camera, "
    "drawn separately, of them, of these",
    "keep": "leave, keep, keeps, keeping, preserve, hold, stays, stay, remains, remain, untouched, unchanged, alone, in peace, "
    "as it is, as they are, as is, as it was, as recorded, fixed, constant, hands off, where it is, though, leaving, "
    "do not touch, don't touch, dont touch, must not be touched, must not be moved, must not be changed, should not change, "
    "without touching, without changing, without moving, not touching, do not change, don't change, do not move, don't move, "
    "nothing else, only that, not the others, like original, like the original, be left, be left on the table, as original, "
    "never touch, don't edit, must not move, never, do not, don't, dont, may not",
    "because": "so, so that, because, since, otherwise, in order to, as on, like on, like in, like from, as usual, as in, "
    "the policy, policy, my policy, our policy, the model, the network, i think, this is, we need to see, like the one",
    "even": "50 / 50, 50 50, fifty fifty, fifty-fifty, half and half, equal chance, equal chances, equal probability, "
    "with equal probability, with equal chance, equal chances each, same probability, equal shares",
    "undo": "undo, undone, revert, reverted, cancel, take back, taken back, forget, forget about, roll back, scratch, no undo",
    "restart": "start over, start again, start afresh, start from scratch, forget everything, undo everything, clear the recipe",
    "harder": "harder, more difficult, more challenging, tougher, less visible, less obvious, harder to see, harder to find, "
    "harder to spot, harder to detect, harder to recognize, harder to make out, more diverse, more robust",
    "clear_of": "through, won't, will not, doesn't, does not, can't, cannot, out of the way, far from, away from, well away from, out of the way of, clear of, nothing that",
}
MARKS: Mapping[str, str] = {";": "stop", ",": "and", "(": "and", ")": "and"}


def spread(blocks: Mapping[str, str]) -> dict[str, str]:
    """What each phrase of the blocks is: the block's name. Phrases are parted by commas."""
    return {
        phrase.strip(): kind
        for kind, text in blocks.items()
        for phrase in text.split(",")
        if phrase.strip()
    }


@cache
def senses() -> Mapping[str, str]:
    """What each phrase asks for: operators' own, and over them ours."""
    own: dict[str, str] = {}
    for name in registry.operator_names():
        own |= spread(registry.operator(name).asked_as)
    return own | spread(OURS) | MARKS
