"""Which factor tells failures from successes: splits by distance, their likelihood ratio, and shuffled outcomes.

A policy that was not trained on blue tables fails beyond some difference, not in proportion to it. So each factor is
tried as one threshold on its distance from the recordings: the logarithm of the likelihood ratio of "fails at one rate
beyond and at another within" against "fails at one rate" (Wilks 1938) says how much it explains. The best is taken, and
the search goes on within its two halves, so that a second cause is not hidden by the first, and what merely goes along
with the first explains nothing more. Confidence comes of a permutation test over the whole search (Westfall and Young
1993), whose p-value is turned into a probability (Sellke, Bayarri and Berger 2001).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float64, Int64

from rpaug.diagnosis.measure import Table
from rpaug.diagnosis.messages import Factor, Measured
from rpaug.diagnosis.sight import NUMBERS

SHUFFLES = 300
MOST_CAUSES = 3
LEAST = 3  # rollouts on either side of a threshold
NEAR = 1.25  # distances below are no difference at all
CUTS = 16
ENOUGH = 5  # successes; with fewer, the recordings stand in for what succeeds


def ranked(table: Table, seed: int = 0) -> list[Measured]:
    """Every measured factor, the one that explains most first; later ones explain what is left."""
    away, failed = _with_stand_ins(table)
    rng = np.random.default_rng([seed, len(failed)])
    strata = np.zeros(len(failed), int)
    left = list(away)
    out: list[Measured] = []
    sure = True
    while left:
        splits = {factor: _splits(away[factor]) for factor in left}
        gains = {factor: _best(splits[factor], failed, strata) for factor in left}
        order = sorted(left, key=lambda factor: -gains[factor][0])
        first = order[0]
        confidence = _confidence(splits, gains[first][0], failed, strata, rng) if sure else 0.0
        out.append(_measured(first, table, away[first], failed, strata, gains[first], confidence))
        left.remove(first)
        sure = sure and confidence > 0.5 and len(out) < MOST_CAUSES
        if not sure:
            out += [_measured(f, table, away[f], failed, strata, gains[f], 0.0) for f in order[1:]]
            break
        strata = 2 * strata + (away[first] > gains[first][1])
    return out


def given(one: Measured, table: Table) -> str:
    """What a measured cause is, in a sentence."""
    numbers = table.numbers[one.factor][table.failed & (table.away[one.factor] > one.threshold)]
    middle = np.nanmedian(numbers, 0) if len(numbers) else np.zeros(len(NUMBERS[one.factor]))
    strongest = np.argsort(-np.abs(middle))[:2]
    parts = ", ".join(
        f"{NUMBERS[one.factor][i][0]} {middle[i]:+.1f}" for i in strongest if abs(middle[i]) >= NEAR
    )
    beyond = f"beyond {one.threshold:.1f} standard deviations of the recordings"
    rates = f"{100 * one.exposed:.0f} % fail {beyond}, {100 * one.spared:.0f} % of the others"
    return f"{rates}; in failures (median, standard deviations): {parts}" if parts else rates


def spans(one: Measured, table: Table) -> tuple[tuple[float, float], ...]:
    """Low and high of each plain difference in the failures that the cause explains, a tenth of them left out at
    either end."""
    beyond = table.failed & (table.away[one.factor] > one.threshold)
    if one.factor not in table.plain:
        return ()
    numbers = table.plain[one.factor][beyond]
    numbers = numbers[np.isfinite(numbers).all(1)]
    if not len(numbers):
        return ()
    low, high = np.quantile(numbers, (0.1, 0.9), axis=0)
    return tuple(zip(low.tolist(), high.tolist(), strict=True))


def _with_stand_ins(
    table: Table,
) -> tuple[Mapping[Factor, Float64[np.ndarray, "n"]], Bool[np.ndarray, "n"]]:
    """Distances and outcomes; where hardly anything succeeded, the recordings count as successes."""
    if (~table.failed).sum() >= ENOUGH or not table.usual:
        return table.away, table.failed
    count = min(len(found) for found in table.usual.values())
    away = {
        factor: np.concatenate([found, table.usual[factor][:count]])
        for factor, found in table.away.items()
    }
    return away, np.concatenate([table.failed, np.zeros(count, bool)])


def _splits(
    away: Float64[np.ndarray, "n"],
) -> tuple[Float64[np.ndarray, "c"], Bool[np.ndarray, "c n"]]:
    """Thresholds between distances, and who lies beyond each; what was not measured lies within."""
    known = np.unique(away[np.isfinite(away)])
    if len(known) < 2:
        return np.empty(0), np.empty((0, len(away)), bool)
    middles = (known[1:] + known[:-1]) / 2
    cuts = np.unique(np.quantile(middles, np.linspace(0, 1, CUTS)))
    cuts = cuts[cuts >= NEAR]
    beyond = np.nan_to_num(away, nan=-1.0) > cuts[:, None]
    enough = (beyond.sum(1) >= LEAST) & ((~beyond).sum(1) >= LEAST)
    return cuts[enough], beyond[enough]


def _best(
    splits: tuple[Float64[np.ndarray, "c"], Bool[np.ndarray, "c n"]],
    failed: Bool[np.ndarray, "n"],
    strata: Int64[np.ndarray, "n"],
) -> tuple[float, float]:
    """The best gain and its threshold."""
    cuts, beyond = splits
    if not len(cuts):
        return 0.0, np.inf
    gains = _gain(beyond, failed[None], strata)[0]
    best = int(gains.argmax())
    return float(gains[best]), float(cuts[best])


def _gain(
    beyond: Bool[np.ndarray, "c n"], failed: Bool[np.ndarray, "s n"], strata: Int64[np.ndarray, "n"]
) -> Float64[np.ndarray, "s c"]:
    """Logarithm of each split's likelihood ratio for each row of outcomes, 0 where more fail within than beyond."""
    total = np.zeros((len(failed), len(beyond)))
    excess = np.zeros_like(total)
    for stratum in np.unique(strata):
        rows = strata == stratum
        lies, fails = beyond[:, rows].astype(float), failed[:, rows].astype(float)
        far, near = lies.sum(1), (1 - lies).sum(1)
        bad_far = fails @ lies.T
        bad = fails.sum(1, keepdims=True)
        total += _log_likelihood(bad_far, far) + _log_likelihood(bad - bad_far, near)
        total -= _log_likelihood(bad, np.array([float(rows.sum())]))
        excess += bad_far - bad * far / rows.sum()
    return np.where(excess > 0, total, 0.0)


def _log_likelihood(
    bad: Float64[np.ndarray, "..."], count: Float64[np.ndarray, "..."]
) -> Float64[np.ndarray, "..."]:
    """Of `bad` failures out of `count` at the likeliest rate."""
    rate = bad / np.maximum(count, 1)
    good = count - bad
    return bad * np.log(np.maximum(rate, 1e-12)) + good * np.log(np.maximum(1 - rate, 1e-12))


def _confidence(
    splits: Mapping[Factor, tuple[Float64[np.ndarray, "c"], Bool[np.ndarray, "c n"]]],
    gain: float,
    failed: Bool[np.ndarray, "n"],
    strata: Int64[np.ndarray, "n"],
    rng: np.random.Generator,
) -> float:
    """How surely this is more than chance, by the share of shuffled outcomes (within strata) that reach the gain."""
    beyond = [found for _, found in splits.values() if len(found)]
    if not beyond or gain <= 0:
        return 0.0
    shuffled = np.tile(failed, (SHUFFLES, 1))
    for stratum in np.unique(strata):
        rows = np.flatnonzero(strata == stratum)
        shuffled[:, rows] = rng.permuted(shuffled[:, rows], axis=1)
    best = _gain(np.concatenate(beyond), shuffled, strata).max(1)
    return surely(float(1 + (best >= gain - 1e-9).sum()) / (1 + SHUFFLES))


def surely(p: float) -> float:
    """The most that a p-value says for there being a cause, where either is as likely before: 0.8 is p = 0.026."""
    return 1 / (1 - np.e * p * np.log(p)) if p < 1 / np.e else 0.0


def _measured(
    factor: Factor,
    table: Table,
    away: Float64[np.ndarray, "n"],
    failed: Bool[np.ndarray, "n"],
    strata: Int64[np.ndarray, "n"],
    best: tuple[float, float],
    confidence: float,
) -> Measured:
    gain, threshold = best
    beyond = np.nan_to_num(away, nan=-1.0) > threshold
    # Rates where no cause found before is at work: those would be counted twice.
    free = strata == 0 if (strata == 0).sum() >= 2 * LEAST else np.ones(len(strata), bool)
    return Measured(
        factor=factor,
        failed=_median(away[failed]),
        succeeded=_median(away[~failed]),
        effect=delta(away[failed], away[~failed]),
        threshold=threshold if np.isfinite(threshold) else 0.0,
        exposed=_rate(failed[free & beyond]),
        spared=_rate(failed[free & ~beyond]),
        gain=gain,
        confidence=confidence,
    )


def delta(
    first: Sequence[float] | Float64[np.ndarray, "n"],
    second: Sequence[float] | Float64[np.ndarray, "m"],
) -> float:
    """Cliff's delta (1993): the chance that one of the first is larger than one of the second, less the opposite."""
    one, other = np.asarray(first), np.asarray(second)
    one, other = one[np.isfinite(one)], other[np.isfinite(other)]
    return float(np.sign(one[:, None] - other).mean()) if len(one) and len(other) else 0.0


def _rate(failed: Bool[np.ndarray, "n"]) -> float:
    return float(failed.mean()) if len(failed) else 0.0


def _median(values: Float64[np.ndarray, "n"]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0
