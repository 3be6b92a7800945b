"""README's table of how near each edit comes to the truth, by what a dataset records.

    python -m tools.docs.overview [--check]

Every figure is one of docs/benchmarks/results; the words follow from the figures by `WORDS`. The table stands in README
between `<!-- overview -->` and `<!-- end -->`. --check writes nothing and fails if it is stale. `tools.docs.site` puts
an operator's row on its page.
"""

import argparse
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import median

from tools.bench.harness import pages

README = pages.DOCS.parent / "README.md"
WORDS = ((40, "exact"), (28, "good"), (-100, "rough"))  # from so many dB in the changed region on
PLACE = re.compile(r"(<!-- overview -->\n).*?(<!-- end -->)", re.DOTALL)
COLUMNS = (
    "depth and masks",
    "the same, in worlds rpaug was not built on",
    "color alone",
    "photographs, by models of middle quality",
)
FORMATS = (
    "`rlbench`, `hdf5_sim`; `rlds`, `rdt`, `lerobot`, `droid` with depth, where instances are found by motion",
    "Meta-World, robosuite, Gymnasium's Fetch",
    "`rlds`, `rdt`, `lerobot`, `droid`, `video`",
    "the same, with `--models`",
)


@dataclass(frozen=True)
class Measured:
    """Figures of a committed table where some rows and columns cross; their median if several."""

    topic: str
    table: str
    rows: str | Sequence[str]
    column: str | Sequence[str]
    note: str = ""
    beside: str = ""  # the column of the best edit of each image alone
    unedited: str = ""  # the column of the recording itself

    def value(self, column: str | Sequence[str]) -> float:
        """The figure; a row without one ("refused") has no part in it."""
        columns = [column] if isinstance(column, str) else column
        tables = {table.id: table for table in pages.load(self.topic).tables}
        names = [self.rows] if isinstance(self.rows, str) else self.rows
        cells = [pages.plain(tables[self.table].find(n, c)) for n in names for c in columns]
        return median(float(found[0]) for cell in cells if (found := re.match(r"[\d.]+", cell)))

    def __str__(self) -> str:
        value = self.value(self.column)
        unedited = self.value(self.unedited) if self.unedited else -100
        if value <= unedited:
            word, note = "no", f"no better than no edit ({unedited:.1f})"
        else:
            word, note = next(word for bound, word in WORDS if value >= bound), self.note
        link = f"[{value:.1f} dB](docs/benchmarks/{self.topic}.md)"
        beside = f" (2D {self.value(self.beside):.1f})" if self.beside else ""
        return f"**{word}** {link}{beside}{', ' * bool(note)}{note}"


@dataclass(frozen=True)
class Said:
    """A cell without a figure, and why."""

    words: str

    def __str__(self) -> str:
        return self.words


@dataclass(frozen=True)
class Quoted:
    """A cell of a committed table as it stands, where no dB tells it: the figure before the first comma."""

    topic: str
    table: str
    row: str
    column: str
    words: str  # `{}` is the figure

    def __str__(self) -> str:
        (table,) = (one for one in pages.load(self.topic).tables if one.id == self.table)
        figure = pages.plain(table.find(self.row, self.column)).split(",")[0]
        return self.words.format(f"[{figure}](docs/benchmarks/{self.topic}.md)")


def recorded(factor: str) -> Measured:
    """On the twin, nothing given: old colors and lamps estimated from the recording."""
    baseline = "best 2D baseline, estimated"
    return Measured("appearance", "ten", factor, "estimated", beside=baseline)


def rejected() -> str:
    """What becomes of moved cameras of foreign worlds, where the arm has no file."""
    tables = {table.id: table for table in pages.load("cameras").tables}
    share = pages.plain(tables["worked"].find("worked: 0.1 m, 0.05 rad", "rejected, %"))
    return f"{share} % rejected without the arm's file"


def foreign(factor: str) -> Measured:
    """The same in other people's simulators."""
    return Measured("foreign_edits", "edits-worked", f"worked: {factor}", "estimated, dB")


def color_alone(what: str, note: str = "", table: str = "whole") -> Measured:
    """On the twin with depth, masks and cameras hidden."""
    return Measured("rgb_only", table, what, "inside, dB (unedited)", note)


def photographed(what: str, note: str = "", table: str = "colors") -> Measured:
    """On the twin as a cheap camera takes it, outlined and given depth by models that err."""
    return Measured("photographed", table, what, "inside, dB", note, unedited="unedited, dB")


def put_in(what: str, note: str = "") -> Measured:
    """On the same, on other seeds."""
    column, unedited = "inside, dB", "unedited, dB"
    return Measured("photographed_moves", "placed", what, column, note, unedited=unedited)


def put_elsewhere(what: str, note: str = "") -> Measured:
    """On the twin as a cheap camera takes it, in the three tasks that the table has."""
    tasks = ("slide_block", "stack_cups", "put_in_box")
    return Measured("photographed_moves", "worked", what, tasks, note)


def furnished(what: str) -> Measured:
    """In other people's simulators, of things that those put there."""
    return Measured("foreign_edits", "furnished", what, "dB", unedited="no edit, dB")


NO = Said("**no**: refused")
OPEN = Said("not measured")
NO_TRUTH = Said("no truth")
NO_PLACE = Said("no truth: an assumed camera")
MEAN_COLOR = "mean color"
TASKS = ("open_drawer", "pick_block", "push_button", "slide_block", "stack_cups", "put_in_box")
SENSORS = tuple(f"sensor_{kind}" for kind in ("noise", "blur", "jpeg", "exposure"))
ROWS: Mapping[str, Sequence[Measured | Quoted | Said]] = {
    "recolor": (
        recorded("object_color (7 objects)"),
        foreign("object_color"),
        Measured("rgb_only", "twin", TASKS, "inside, dB (unedited)", "two tasks of six refused"),
        photographed("recolor"),
    ),
    "retexture": (
        recorded("object_texture"),
        foreign("object_texture"),
        color_alone("object's texture", f"{MEAN_COLOR}; four of six refused", "textures"),
        photographed("retexture"),
    ),
    "table_color": (
        recorded("table_color"),
        foreign("table_color"),
        color_alone("table, one refused", "one task of six refused"),
        photographed("table's color"),
    ),
    "table_texture": (
        recorded("table_texture"),
        foreign("table_texture"),
        color_alone("table's texture", f"{MEAN_COLOR}; one of six refused", "textures"),
        photographed("table's texture"),
    ),
    "background_texture": (
        recorded("background_texture"),
        foreign("background_texture"),
        color_alone("background", MEAN_COLOR),
        photographed("background's texture"),
    ),
    "light_color": (
        recorded("light_color"),
        foreign("light_color"),
        color_alone("light's color"),
        photographed("lamps' color", table="middle"),
    ),
    "light_direction": (
        recorded("light_direction"),
        foreign("light_direction"),
        NO,
        photographed("lamp's direction", table="middle"),
    ),
    "camera_pose": (
        Measured("appearance", "ten", "camera_pose", "given", beside="best 2D baseline"),
        Measured("cameras", "worked", "worked: 0.1 m, 0.05 rad", "all, dB", rejected()),
        Said("**no**, without a model of depth"),
        photographed("moved camera, seen pixels", "where a camera saw it", "middle"),
    ),
    "distractors": (
        Measured("placing", "baselines", "distractor", "dB", beside="best baseline, dB"),
        Measured("foreign_edits", "edits-worked", "worked: distractor", "given, dB"),
        NO_PLACE,
        put_in("distractors"),
    ),
    "insert": (
        Measured("placing", "insert", "mesh, harmonised", "color, worst dB", "worst of nine"),
        furnished("insert"),
        NO_PLACE,
        photographed("inserted", table="middle"),
    ),
    "object_size": (
        Measured("placing", "baselines", "object_size", "dB", beside="best baseline, dB"),
        furnished("object_size"),
        NO,
        photographed("resized", table="middle"),
    ),
    "remove": (
        Measured(
            "placing",
            "removed",
            ("pick_block, cylinder", "stack_cups, marble block", "put_in_box, blue block"),
            "never seen, dB",
            "of what no camera saw",
        ),
        furnished("remove"),
        NO,
        photographed("removed, seen background", "of what some camera saw"),
    ),
    "move": (
        Measured("placing", "moved", "move", "dB"),
        furnished("move"),
        NO,
        put_elsewhere("moved"),
    ),
    "duplicate": (
        Measured("recast", "doubled", "duplicate", "dB"),
        furnished("duplicate"),
        NO,
        put_elsewhere("duplicated"),
    ),
    "spread": (
        Measured("recast", "doubled", "spread", "dB"),
        furnished("spread"),
        NO,
        put_in("spread", "two of three refused"),
    ),
    "shadows": (
        Measured("lights", "cast", "fainter, to 0.4", "dB", "made fainter", unedited="no edit, dB"),
        furnished("shadows"),
        NO,
        NO,
    ),
    "physics": (
        Quoted(
            "physics",
            "rigid",
            "box's lid pushed shut on its hinge",
            "at worst",
            "off by {} mm in the worst of six motions",
        ),
        OPEN,
        NO,
        put_elsewhere("left to physics", "against itself on exact depth; two of three refused"),
    ),
    "stylize": (
        Quoted(
            "stylising",
            "twin",
            "slide_block: stylize",
            "match, first to last",
            "no truth; the style's distance falls from {}",
        ),
        *[NO_TRUTH] * 3,
    ),
    **dict.fromkeys(SENSORS, (Said("no truth: a camera's own errors, drawn"), *[NO_TRUTH] * 3)),
}


def row(operators: Sequence[str]) -> str:
    """The row of operators of which the same is said."""
    names = ", ".join(f"[`{one}`](docs/operators.md#{one})" for one in operators)
    return f"|{names}|{'|'.join(map(str, ROWS[operators[0]]))}|"


def table(operators: Iterable[str] = tuple(ROWS)) -> str:
    """The table of all operators, or of some."""
    columns = (f"{what}:<br>{formats}" for what, formats in zip(COLUMNS, FORMATS, strict=True))
    head = ("edit", *columns)
    alike = groupby(operators, lambda one: ROWS[one])
    lines = (
        f"|{'|'.join(head)}|",
        f"|{'|'.join(['---'] * len(head))}|",
        *(row(tuple(same)) for _, same in alike),
    )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write README's table, or say that it is stale."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing, fail if it is stale")
    given = parser.parse_args()
    text = README.read_text()
    made = PLACE.sub(lambda found: found[1] + table() + found[2], text)
    if not given.check:
        README.write_text(made)
    sys.exit(1 if given.check and made != text else 0)


if __name__ == "__main__":
    main()
