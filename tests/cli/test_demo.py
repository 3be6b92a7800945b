"""`rpaug demo` writes copies and a preview, and opens the preview where somebody sits at a screen."""

import sys
import webbrowser
from pathlib import Path

import pytest

from rpaug.cli.demo import demo

pytestmark = pytest.mark.usefixtures("tracked_once")


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """What was asked of the browser."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DISPLAY", ":0")
    pages: list[str] = []
    monkeypatch.setattr(webbrowser, "open", pages.append)
    return pages


def test_it_ends_by_opening_the_preview(
    opened: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert demo() == 0
    page = Path("rpaug-demo-preview.html")
    assert opened == [page.resolve().as_uri()]
    assert page.stat().st_size > 1_000_000
    assert Path("rpaug-demo/rpaug.contact.html").exists()
    shown = capsys.readouterr().out
    assert shown.index("contact sheet: rpaug-demo/rpaug.contact.html") < shown.index(
        f"preview: {page}"
    )


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """A run and a page that cost nothing; whether each run was asked for JSON."""
    runs: list[bool] = []

    def ran(*_: object, as_json: bool = False) -> int:
        runs.append(as_json)
        return 0

    monkeypatch.setattr("rpaug.cli.demo.augment", ran)
    monkeypatch.setattr("rpaug.pages.preview.page", lambda *_, **__: b"page")
    return runs


def test_without_a_terminal_it_says_where_the_preview_is(
    opened: list[str], quick: list[bool], capsys: pytest.CaptureFixture[str]
) -> None:
    assert demo(Path("mine")) == 0
    assert quick == [False]
    assert not opened
    assert capsys.readouterr().out.splitlines()[-1] == "preview: mine-preview.html"


def test_for_programs_it_is_the_run_alone(
    opened: list[str], quick: list[bool], capsys: pytest.CaptureFixture[str]
) -> None:
    assert demo(as_json=True) == 0
    assert quick == [True]
    assert not capsys.readouterr().out
    assert not Path("rpaug-demo-preview.html").exists()
