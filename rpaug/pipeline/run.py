"""What is asked of a run over a dataset, which copies it makes of which episodes, and what it came to."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from rpaug.core import fingerprint, registry
from rpaug.core.errors import BadInput
from rpaug.core.interfaces import Adapter
from rpaug.core.version import __version__
from rpaug.pipeline import journal
from rpaug.pipeline.copies import ORIGINAL
from rpaug.pipeline.recipe import Recipe

MINUTES = 60.0
NAMED = 3  # episodes that a sentence names at most


@dataclass(frozen=True)
class Budget:
    """What a job may take before its worker is ended: bytes of resident memory (None: a worker's share of the
    machine's), and minutes for each copy. Memory is watched where there is /proc."""

    memory: float | None = None
    minutes: float = MINUTES


@dataclass(frozen=True)
class Run:
    """What is asked for: `recipe` on the dataset `source`, written to `target`, shown at `tier` at least.

    The recipe takes over what the dataset's `roles.yaml` settles. Raises BadInput where that is wrong.
    """

    source: Path
    recipe: Recipe
    target: Path
    tier: int = 0
    scenes: Path | None = None  # a store of fitted scenes
    share: bool = (
        False  # episodes of one place borrow the static Gaussians of its first, through the store
    )
    keep_invalid: bool = False  # copies whose recorded actions no longer hold
    ratio: tuple[int, int] | None = None  # recorded to synthetic episodes, in each group
    licence: str | None = None  # of the source, where it does not say
    device: str = "cpu"  # that fits Gaussians and edits appearance: cpu or cuda
    linked: bool = False  # untouched files are hard links to the recorded ones, not copies
    shard: tuple[int, int] | None = None  # which part of how many this run makes, from 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "recipe", self.recipe.settled(self.source))

    @cached_property
    def adapter(self) -> Adapter:
        """The adapter of the dataset's layout, by the journal of an output that goes on. Raises BadInput."""
        layout = (journal.marker(self.target) or {}).get("layout")
        return registry.adapter(layout) if layout else registry.adapter_for(self.source)

    @cached_property
    def keys(self) -> list[str]:
        """The selected episodes. Raises BadInput if there are none."""
        every = self.adapter.episodes(self.source)
        keys = self.recipe.select(every)
        if not keys:
            known = f"{', '.join(every[:5])}{', ...' if len(every) > 5 else ''}"
            raise BadInput(
                self.source,
                "select",
                found="no episode that matches",
                expected=f"patterns for: {known}",
            )
        return keys

    def makes(self, number: int) -> bool:
        """Whether the episode of that place in `keys` belongs to this run's part: every nth one does."""
        return self.shard is None or number % self.shard[1] == self.shard[0] - 1

    @property
    def copies(self) -> range:
        """The copy numbers of each episode, the original's among them if it is kept."""
        first = ORIGINAL if self.recipe.keep_originals or self.ratio else ORIGINAL + 1
        last = self.recipe.copies
        if self.ratio:
            last = -(-self.ratio[1] // self.ratio[0])
        return range(first, last + 1)

    @cached_property
    def spared(self) -> frozenset[tuple[str, int]]:
        """Episodes that get no last copy, so that `ratio` is met: drawn from the recipe's seed, group by group."""
        if not self.ratio:
            return frozenset()
        groups: dict[str, list[str]] = {}
        for key in self.keys:
            groups.setdefault(group_of(self.adapter, key), []).append(key)
        found, last = set(), self.copies[-1]
        for group, keys in groups.items():
            wanted = round(len(keys) * self.ratio[1] / self.ratio[0])
            rng = np.random.default_rng([self.recipe.seed, zlib.crc32(group.encode())])
            order = rng.permutation(len(keys))
            found |= {(keys[i], last) for i in order[wanted - len(keys) * (last - 1) :]}
        return frozenset(found)

    @property
    def marker(self) -> dict[str, Any]:
        """What tells one run's output from another's, beside where the dataset lies: that may move."""
        return {
            "contents": self.contents,
            "layout": self.adapter.name,
            "version": __version__,
            "tier": self.tier,
            "keep_invalid": self.keep_invalid,
            "recipe": self.recipe.source,
            **({"share": True} if self.share else {}),
            **({"ratio": list(self.ratio)} if self.ratio else {}),
            **({"device": self.device} if self.device != "cpu" else {}),
            **({"shard": list(self.shard)} if self.shard else {}),
        }

    @cached_property
    def contents(self) -> str:
        """What the dataset held when it was first asked."""
        held = self.source if self.source.is_dir() else self.source.parent
        return fingerprint.contents(held)


@dataclass
class Summary:
    """What a run came to, over all that is in the output folder now."""

    copies: int = 0
    as_recorded: int = 0  # of them: what their edits are made of is lacking, and nothing differs
    resumed: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    rejected: dict[str, str] = field(default_factory=dict)  # by key in that folder: why
    aborted: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    changed_share: dict[str, float] = field(default_factory=dict)
    mean_change: dict[str, float] = field(default_factory=dict)  # grey levels, over all pixels
    warnings: dict[str, list[str]] = field(default_factory=dict)  # by source episode
    left_out: list[dict[str, Any]] = field(default_factory=list)  # edits: where, how often, why
    fell_short: list[dict[str, Any]] = field(
        default_factory=list
    )  # edits: what, how many of how many, in which episodes
    painted_over: dict[str, int] = field(default_factory=dict)  # edits under others, with copies
    roles: list[str] = field(default_factory=list)  # that differ between episodes of one task
    unmet: bool = False  # an edit that all copies were to have is in none
    missing: bool = False  # aborted since an episode lacked what an edit is made of

    @property
    def stopped(self) -> bool:
        """Whether the machine's fault ended the run, so that it is to go on: nothing is gathered yet."""
        return self.aborted is not None and not self.missing

    @property
    def lacked(self) -> list[str]:
        """One sentence for each edit that was left out somewhere."""
        return [
            f"{one['edit']}: {'in no copy: ' if one['nowhere'] else ''}"
            f"{one['episodes']} of {one['drawn_in']} episodes lacked it: {_reasons(one['reasons'])}"
            for one in self.left_out
        ]

    @property
    def shortfalls(self) -> list[str]:
        """One sentence for each wish that an edit could not fulfil everywhere."""
        return [
            f"{one['edit']}: {one['count']} of {one['of']} {one['what']} ({_named(one['episodes'])})"
            for one in self.fell_short
        ]

    @property
    def exit_code(self) -> int:
        """0: all done; 1: some episodes were skipped, or copies rejected, or an edit without a probability is in no
        copy or all copies are as recorded, or the recipe's `on_missing: fail` ended the run; 2: nothing was made."""
        empty = self.copies and self.as_recorded == self.copies
        if not (self.failures or self.aborted or self.rejected or self.unmet or empty):
            return 0
        return 1 if self.copies or self.rejected or self.missing else 2


def alike(reasons: Mapping[str, str], *, files: bool = True) -> list[tuple[list[str], str]]:
    """Keys whose reasons differ at most in what there is instead, with the first one's reason; without `files` in the
    key too, as where each names a file of its episode."""
    found: dict[str, tuple[list[str], str]] = {}
    for key, reason in reasons.items():
        told = reason.removeprefix(f"{key}: ")
        same = told.partition("there is: ")[0]
        found.setdefault(same if files else same.replace(key, ""), ([], told))[0].append(key)
    return list(found.values())


def _named(keys: Sequence[str]) -> str:
    """Episodes by name, the first few of many."""
    more = f" and {len(keys) - NAMED} others" if len(keys) > NAMED else ""
    return ", ".join(keys[:NAMED]) + more


def _reasons(found: Sequence[Mapping[str, Any]]) -> str:
    """Why episodes lacked an edit, in a sentence; of several reasons each with its number of episodes, and without what
    there is instead, which differs between episodes."""
    if len(found) == 1 and found[0]["episodes"] == 1:
        return str(found[0]["reason"])
    brief = [(one["episodes"], one["reason"].partition("; there is: ")[0]) for one in found]
    if len(brief) == 1:
        return str(brief[0][1])
    return "; ".join(f"in {episodes}: {reason}" for episodes, reason in brief)


def group_of(adapter: Adapter, key: str) -> str:
    """The folder whose episodes are numbered together."""
    return PurePosixPath(adapter.key_at(key, 0)).parent.as_posix()
