"""What each instance does in the task, from how it moves, what it touches and what carries it: never from its name or
number.

The world's z axis points up. Every role is a belief with reasons; one below BOUND is no role of the scene.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rpaug.core.types import Belief, Body, Episode
from rpaug.scene.sampled_frames import SampledFrames, look
from rpaug.scene.targets.observed import BESIDE, REST, TOUCH, Evidence, Thing, gather
from rpaug.scene.targets.supports import THICK, Ground

NAMES = ("manipulated", "receiver", "robot", "table", "background")
BOUND = 0.4  # a belief below it is no role
SUREST = 0.99  # of what is seen: certain is only what a person settles

OFTEN = 0.5  # share of the frames that show both, in which parts that hang together touch
IDLE = 0.1  # share of the gripper's steps in which what hangs on it may seem to rest
NEAR = 0.15  # metres around the gripper's path within which things are neighbours
OVER = 0.4  # metres: an arm works that far over its table, more or less
NEIGHBORS = 0.2  # what the neighbours weigh, beside what is manipulated and the gripper's path
SIDE = 0.03  # metres: parts of one piece of furniture are within each other's outline by less
SMALLER = 0.25  # of the table's area: what lies flush on it and is smaller is a thing on it
REACH = 0.25  # metres: what stays so near to the gripper is the hand
AS_FIRM = 0.7  # of the firmest contact: of things that are touched so the largest is the receiver
LEAST_SURE = 0.8  # of what is taken for want of anything else: what is nearest, or is touched where nothing moves
SOME = 0.3  # of the last frames, or of the outline: less contact makes no receiver
LATE = 8  # the last so many-th part of the sampled frames shows where a thing was brought

NOTHING = Belief(frozenset(), 0.0)


def believe(
    episode: Episode, bodies: Sequence[Body], sampled: SampledFrames | None = None
) -> dict[str, Belief]:
    """What is believed of each role that anything speaks for; see NAMES. Every instance id has one role at most, and
    some have none.

    robot: what hangs on the gripper from the first frame on, and the base that this chain grows out of. manipulated:
    what else moves and is touched by the robot, or if nothing does what the gripper touches longest. table: what most
    falls on that the robot acts on, passes over, or finds beside that. receiver: the static thing that the
    manipulated is hinged to or touches at the end, with all that stands within its outline; never the table.
    background: what is left and larger than the table, or outside its bounds; a rim on the table's edge is none and
    has no role.
    """
    sampled = look(episode) if sampled is None else sampled
    evidence = gather(episode, bodies, sampled)
    arm = _arm(evidence)
    hand = _hand(evidence, arm)
    manipulated = _moved(evidence, arm, hand)
    ground = Ground(evidence, arm)
    table = _table(evidence, ground, arm, manipulated.instance_ids)
    if not manipulated.instance_ids:
        manipulated = _pressed(evidence, hand, arm.keys() | table.instance_ids)
    believed = table.instance_ids if table.confidence >= BOUND else frozenset[int]()
    robot = _robot(evidence, ground, arm, manipulated.instance_ids, believed)
    taken = robot.instance_ids | manipulated.instance_ids
    around = _around(evidence, ground, table.instance_ids, manipulated.instance_ids, taken)
    rims = frozenset(h for h in around if _on_edge(evidence, ground, h, table.instance_ids))
    background = Belief(
        around - rims,
        table.confidence if table.instance_ids else 0.0,
        ("larger than the table, beside it or below it, and no part of the robot",),
    )
    receiver = _receiver(
        evidence, ground, manipulated.instance_ids, taken | around, table.instance_ids
    )
    found = {
        "manipulated": manipulated,
        "receiver": receiver,
        "robot": robot,
        "table": table,
        "background": background,
    }
    return {
        name: replace(belief, confidence=min(belief.confidence, SUREST))
        for name, belief in found.items()
        if belief.instance_ids or (belief.reasons and not belief.confidence)
    }


def held(beliefs: Mapping[str, Belief]) -> dict[str, frozenset[int]]:
    """The instance ids of the roles that are believed firmly enough."""
    return {
        name: belief.instance_ids for name, belief in beliefs.items() if belief.confidence >= BOUND
    }


def _arm(evidence: Evidence) -> dict[int, float]:
    """What moves with the gripper from the start, and what that touches from the start, each with how firmly."""
    arm = {
        h: 1.0 if thing.body.motion == "link" else 1 - evidence.rest(h)
        for h, thing in evidence.things.items()
        if thing.body.motion == "link"
        or (thing.body.motion == "gripper" and evidence.rest(h) < IDLE)
    }
    still = {h for h, thing in evidence.things.items() if thing.static}
    movers = evidence.things.keys() - still - arm.keys()
    while arm:
        hand = _hand(evidence, arm)
        fresh = {}
        for h in (movers | still) - arm.keys():
            # What something still holds as well, a handle in the hand, is a link only if it touches one.
            anchored = evidence.early(h, still - {h})
            share = evidence.early(h, arm.keys() - hand if anchored >= OFTEN else arm)
            if h in movers and share >= max(OFTEN, anchored):
                fresh[h] = share
            # Too small for a track, and yet it is where the gripper is.
            elif (
                h in still
                and anchored < OFTEN
                and evidence.early(h, hand)
                and evidence.rides(h, REACH)
            ):
                fresh[h] = 1.0
        still -= fresh.keys()
        if not fresh:
            break
        arm |= fresh
    return arm


def _hand(evidence: Evidence, arm: Collection[int]) -> frozenset[int]:
    """The part of the arm that stays about the gripper."""
    if evidence.gripper is None:
        return frozenset()
    return frozenset(
        h
        for h in arm
        if evidence.things[h].static
        or (np.linalg.norm(evidence.middle(h) - evidence.gripper, axis=-1) < REACH).all()
    )


def _moved(evidence: Evidence, arm: Collection[int], hand: Collection[int]) -> Belief:
    """What moves, is no part of the arm, and was touched by the hand or by what that moved; farthest first."""
    movers = {h for h, thing in evidence.things.items() if not thing.static} - set(arm)
    if not hand:
        return Belief(frozenset(movers), 0.6 if movers else 0.0, ("it moves; no gripper is seen",))
    acted = dict.fromkeys(hand, np.ones(len(evidence.gaps) - 1, bool))
    while fresh := {
        h: steps for h in movers - acted.keys() if (steps := evidence.pushed(h, acted)).any()
    }:
        acted |= fresh
    found = frozenset(acted.keys() - hand)
    if not found:
        return NOTHING
    shares, reasons = [], []
    for h in sorted(found, key=lambda h: -evidence.steps(h).sum()):
        moves = int((evidence.steps(h) > REST).sum())
        near = int(evidence.pushed(h, {o: s for o, s in acted.items() if o != h}).sum())
        shares.append(near / moves)
        reasons.append(
            f"instance {h} moves in {moves} steps from one sampled frame to the next, in {near} of them beside the "
            f"hand or what that moves; it rests during {100 * evidence.rest(h):.0f} % of the gripper's way"
        )
    return Belief(found, min(shares), tuple(reasons))  # as sure as the least sure thing in it


def _pressed(evidence: Evidence, hand: Collection[int], not_these: Collection[int]) -> Belief:
    """What the hand touches in most frames, where nothing moves."""
    frames = {h: int(evidence.touch(h, hand).sum()) for h in evidence.things if h not in not_these}
    if not frames or not max(frames.values()):
        return NOTHING
    first, *others = sorted(frames, key=lambda h: -frames[h])
    second = frames[others[0]] if others else 0
    return Belief(
        frozenset([first]),
        LEAST_SURE * (frames[first] - second / 2) / frames[first] if frames[first] > 1 else 0.3,
        (
            f"nothing is seen to move, and the hand touches it in {frames[first]} of "
            f"{len(evidence.gaps)} frames, the next in {second}",
        ),
    )


def _table(
    evidence: Evidence, ground: Ground, arm: Collection[int], manipulated: Collection[int]
) -> Belief:
    """The static thing that carries what the robot acts on, at first and at last, its neighbours, and what lies under
    its path and beside that. Of containers side by side it is none that something is brought into."""
    near = _neighbors(evidence, set(arm) | set(manipulated))
    weights = dict.fromkeys(near, NEIGHBORS / max(len(near), 1))
    left = 1 - NEIGHBORS if near else 1.0
    share = left / 2 if evidence.gripper is not None else left
    weights |= dict.fromkeys(manipulated, share / max(len(manipulated), 1))
    on = ground.carried(weights, NEAR)
    if not on.weight:
        return NOTHING
    lowest = [evidence.things[h].low[2] for h in manipulated]
    lowest += [] if evidence.gripper is None else [float(evidence.gripper[:, 2].min())]
    scores, pieces = {}, {}
    for h in on.weight:
        height = ground.top(h).height
        under = max(0.0, min(lowest, default=height) - height)
        pieces[h] = _flush(evidence, ground, h)
        weight = on.together(pieces[h])
        scores[h] = weight**2 * float(np.exp(-under / OVER))
    best = max(scores, key=lambda h: scores[h])
    if not scores[best]:
        return NOTHING
    weight = on.together(pieces[best])
    second = max((score for h, score in scores.items() if h not in pieces[best]), default=0.0)
    ends = {h for h in pieces[best] if _ends_in(evidence, ground, h, pieces[best], manipulated)}
    return Belief(
        pieces[best] - ends,
        weight * scores[best] / (scores[best] + second),
        (
            f"{100 * weight:.0f} % of what the robot acts on, works over and finds beside that falls on instance "
            f"{best}, level at {ground.top(best).height:.2f} m",
            f"the next best support has {100 * second / scores[best]:.0f} % of its score",
        ),
    )


def _flush(evidence: Evidence, ground: Ground, best: int) -> frozenset[int]:
    """A support and what lies in its plane, overlaps it from above and is not much smaller."""
    top = ground.top(best)
    return frozenset(
        level.instance_id
        for level in ground.levels
        if level.instance_id == best
        or (
            abs(level.height - top.height) < THICK
            and SMALLER * top.area < level.area <= top.area
            and level is ground.top(level.instance_id)
            and _overlap(evidence.things[level.instance_id], evidence.things[best])
        )
    )


def _ends_in(
    evidence: Evidence,
    ground: Ground,
    one: int,
    flush: Collection[int],
    manipulated: Collection[int],
) -> bool:
    """Is a piece of the table a container of its own, that what is moved is brought into from another piece?

    It rises above its level surface, where two leaves of one table are even.
    """
    if evidence.things[one].high[2] < ground.top(one).height + THICK:
        return False
    others = [h for h in flush if h != one]
    return any(
        sum(ground.falls(m).get(h, 0.0) for h in others) > OFTEN < ground.falls(m, -1).get(one, 0.0)
        for m in manipulated
    )


def _neighbors(evidence: Evidence, without: Collection[int]) -> list[int]:
    """Static things that the gripper's path leads over or past."""
    if evidence.gripper is None:
        return [h for h, thing in evidence.things.items() if thing.static and h not in without]
    path = evidence.gripper[:, :2]
    out = []
    for h, thing in evidence.things.items():
        beyond = np.maximum(thing.low[:2] - path, path - thing.high[:2]).max(1)
        if thing.static and h not in without and beyond.min() < NEAR:
            out.append(h)
    return out


def _robot(
    evidence: Evidence,
    ground: Ground,
    arm: Mapping[int, float],
    manipulated: Collection[int],
    table: Collection[int],
) -> Belief:
    """The arm and its base: what touches its links in most frames, and what that stands on or carries."""
    if not arm:
        return NOTHING
    base = _base(evidence, ground, arm, _hand(evidence, arm), manipulated, table)
    seen = {h: len(evidence.things[h].points) for h in (*arm, *base)}
    firm = sum(seen[h] * f for h, f in (*arm.items(), *base.items())) / sum(seen.values())
    return Belief(
        frozenset(seen),
        firm * (1.0 if base else 0.8),
        (
            f"{len(arm)} instances move with the gripper from the first frames on and touch one another",
            f"{len(base)} that stand still touch these, or are under them"
            if base
            else "no base is seen",
        ),
    )


def _base(
    evidence: Evidence,
    ground: Ground,
    arm: Collection[int],
    hand: Collection[int],
    manipulated: Collection[int],
    table: Collection[int],
) -> dict[int, float]:
    """What holds the arm up, with how firmly it belongs there.

    It touches a link beyond the hand in most frames or from the first on, or touches other such parts more than it
    touches the table and what stands there, or carries or stands on such parts. What stands on the table is taken for
    a base only if it touches a link or is under one. If no camera sees a joint to the base, it is what is nearest to
    the stillest link.
    """
    under = set(table)
    for _ in evidence.things:  # the floor, that the table stands on
        under |= {on for h in under for on, part in ground.falls(h).items() if part > OFTEN}
    reach = float(
        np.linalg.norm(np.ptp([evidence.middle(h)[s] for h in arm for s in (0, -1)], 0))
    ) + max(evidence.things[h].size.max() for h in arm)
    limbs = [h for h in arm if h not in hand and not evidence.things[h].static]
    if not limbs:
        return {}
    stillest = min(limbs, key=lambda h: evidence.steps(h).sum())
    free = {
        h
        for h, thing in evidence.things.items()
        if h not in arm and h not in manipulated and h not in under and thing.size.max() < reach
    }
    lands = {h: ground.falls(h) for h in free | {stillest}}
    on_table = _standing(free, lands, table)
    others = set(table) | on_table
    base: dict[int, float] = {}
    while True:
        fresh = {}
        for h in free - base.keys():
            firm = max(evidence.strongest(h, limbs), evidence.early(h, limbs))
            parts = base.keys() | {stillest}
            if h not in on_table:
                grown = max(evidence.strongest(h, base), evidence.early(h, base))
                if grown >= evidence.strongest(h, others - base.keys()):
                    firm = max(firm, grown)
                firm = max(firm, *(lands[part].get(h, 0.0) for part in parts))
                firm = max([firm, *(lands[h].get(part, 0.0) for part in base)])
            elif any(_below(evidence, h, part) for part in parts):
                firm = max(firm, OFTEN)
            if firm >= OFTEN:
                fresh[h] = firm
        if (
            not fresh
            and not base
            and (near := _nearest(evidence, stillest, limbs, free - on_table))
        ):
            fresh = {near: OFTEN}
        if not fresh:
            break
        base |= fresh
    return base


def _standing(
    free: Collection[int], lands: Mapping[int, Mapping[int, float]], table: Collection[int]
) -> set[int]:
    """What stands on the table, and on what stands there."""
    out = set[int]()
    for _ in free:
        on = out | set(table)
        out |= {h for h in free if sum(lands[h].get(one, 0.0) for one in on) > OFTEN}
    return out


def _nearest(
    evidence: Evidence, one: int, arm: Collection[int], among: Collection[int]
) -> int | None:
    """What may hold a thing up though no camera sees where: the nearest, if the link between their boxes that nobody
    sees is no longer than the longest one seen."""
    low, high = evidence.bounds(one, 0)
    gaps = {}
    for h in among:
        under, over = evidence.bounds(h, 0)
        gaps[h] = float(np.linalg.norm(np.maximum(0, np.maximum(under - high, low - over))))
    near = min(gaps, key=lambda h: gaps[h], default=None)
    longest = max(float(np.linalg.norm(evidence.things[h].size)) for h in arm)
    return near if near is not None and gaps[near] < longest else None


def _below(evidence: Evidence, one: int, part: int) -> bool:
    """Does a thing stand under a part of the robot, within its outline?"""
    low, high = evidence.bounds(part, 0)
    middle = evidence.middle(one)[0]
    return bool(
        (middle[:2] > low[:2] - SIDE).all()
        and (middle[:2] < high[:2] + SIDE).all()
        and middle[2] < (low[2] + high[2]) / 2
    )


def _overlap(a: Thing, b: Thing) -> bool:
    """Do their outlines from above overlap, or all but touch?"""
    return bool((a.low[:2] < b.high[:2] + SIDE).all() and (b.low[:2] < a.high[:2] + SIDE).all())


def _around(
    evidence: Evidence,
    ground: Ground,
    table: Collection[int],
    manipulated: Collection[int],
    taken: Collection[int],
) -> frozenset[int]:
    """What stands still below the table, or that nothing is brought to and is larger than it or begins beyond it."""
    if not table:
        return frozenset()
    things = evidence.things
    low = np.min([things[h].low for h in table], 0)
    high = np.max([things[h].high for h in table], 0)
    broad = (high - low)[:2].max()
    ends = {h for m in manipulated for h, part in ground.falls(m, -1).items() if part > OFTEN}
    goals = {h for h in ends if not _on_edge(evidence, ground, h, table)}
    return frozenset(
        h
        for h, thing in things.items()
        if thing.static
        and h not in table
        and h not in taken
        and (
            thing.high[2] < low[2] - SIDE
            or (
                h not in goals
                and (
                    thing.size.max() > broad
                    or (thing.low[:2] > high[:2]).any()
                    or (thing.high[:2] < low[:2]).any()
                )
            )
        )
    )


def _on_edge(evidence: Evidence, ground: Ground, one: int, table: Collection[int]) -> bool:
    """Does a thing stand on the table as a rim does? It touches the table and begins at its level, and most of it is
    over the table; of a wall behind it more is seen than that."""
    over = sum(ground.falls(one).get(h, 0.0) for h in table)
    touches = max(evidence.strongest(one, table), evidence.early(one, table))
    bottom = evidence.things[one].low[2]
    level = any(bottom > ground.top(h).height - THICK for h in table)
    return level and over > OFTEN and touches >= OFTEN


def _receiver(
    evidence: Evidence,
    ground: Ground,
    manipulated: Collection[int],
    not_these: Collection[int],
    table: Collection[int],
) -> Belief:
    """What the manipulated touches, is in or is over at the end, or came up to; what stands within that thing's
    outline, and what it is one with: what touches it and holds it up if it hangs. The table is none: what is done to a
    receiver would be done to the whole of it."""
    free = evidence.things.keys() - set(not_these) - set(table)
    brought = {
        h: max((_brought(evidence, ground, m, h) for m in manipulated), default=(0.0, ""))
        for h in free
    }
    firm = {h: share for h, (share, _) in brought.items()}
    among = [h for h in firm if firm[h] >= max(SOME, AS_FIRM * max(firm.values()))]
    if not among:
        on = [ground.falls(m, -1) for m in manipulated]
        share = max((sum(one.get(h, 0.0) for h in table) for one in on), default=0.0)
        came = {h: max((_approached(evidence, m, h) for m in manipulated), default=0) for h in free}
        main = max(came, key=lambda h: came[h], default=0)
        other = came.get(main, 0.0)
        if other <= share / 2:
            ends = f"the manipulated ends over the table with {100 * share:.0f} % of its outline"
            return Belief(frozenset(), 0.0, (f"{ends}, and at nothing else",) if share else ())
        among = [main]
        brought[main] = (LEAST_SURE * other, "touches nothing at the end, and is nearest then to")
    main = max(among, key=lambda h: evidence.things[h].size.prod())
    low, high = evidence.bounds(main, -1)
    parts = {main}
    for h in free:
        under, over = evidence.bounds(h, -1)
        if (under[:2] > low[:2] - SIDE).all() and (over[:2] < high[:2] + SIDE).all():
            parts.add(h)
    holding = free if ground.hangs(main) else among
    parts |= {h for h in holding if evidence.share(main, h) >= OFTEN}
    return Belief(
        frozenset(parts), brought[main][0], (f"the manipulated {brought[main][1]} instance {main}",)
    )


def _brought(evidence: Evidence, ground: Ground, one: int, to: int) -> tuple[float, str]:
    """How sure a thing was brought to another, or hangs on it, and why."""
    tail = slice(-max(2, len(evidence.gaps) // LATE), None)
    low, high = evidence.bounds(to, -1)
    middle = evidence.middle(one)[tail]
    inside = float(((middle > low) & (middle < high)).all(1).mean())
    over = ground.falls(one, -1).get(to, 0.0)
    late = evidence.late(one, to)
    hinged = min(evidence.share(one, to), evidence.early(one, [to]), evidence.late(one, to, BESIDE))
    return max(
        (late, f"touches in {100 * late:.0f} % of the last frames that show both"),
        (hinged, f"touches in {100 * hinged:.0f} % of all frames, from first to last,"),
        (0.9 * inside, f"ends within {100 * inside:.0f} % of the last frames in"),
        (0.8 * over, f"ends above, with {100 * over:.0f} % of its outline,"),
    )


def _approached(evidence: Evidence, one: int, to: int) -> float:
    """How much of the way between a thing and another is gone at the end, seen from above; 0 if it ends BESIDE or
    farther, or was nearer before."""
    low, high = evidence.bounds(to, -1)
    middle, half = evidence.middle(one), evidence.things[one].size / 2
    gaps = np.maximum(0, np.maximum(low - half - middle, middle - half - high))[:, :2].max(1)
    if gaps[-1] >= min(BESIDE, gaps.min() + TOUCH, gaps[0]):
        return 0.0
    return float(1 - gaps[-1] / gaps[0])
