"""The table of edits of a large recording: aims and misses stand where the page looks for them."""

from tools.bench import large


def test_aims_stand_beside_processor_seconds() -> None:
    found = {"color": {"processor": 9.04, "wall": 6.0}, "light": {"processor": 5.0, "wall": 4.0}}
    table = large.recorded(found, (121, 1920, 1080))
    assert table.rows == [
        ["color", {"value": 9.0, "target": "<= 8"}, 6.0, 60],
        ["light", 5.0, 4.0, "-"],
    ]
    assert table.command == "python -m tools.bench.large --edit color --edit light"
