"""Options go before the environment, that before the file; its key stays private and goes to its server alone."""

from pathlib import Path

import pytest
from endpoints import KEY

from rpaug.providers import llm_settings
from rpaug.providers.language import LanguageError

HOME = "http://home:1/v1"


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    place = tmp_path / "rpaug" / "llm.toml"
    place.parent.mkdir()
    place.write_text(f'url = "{HOME}"\nmodel = "kept"\nkey = "{KEY}"\n')
    place.chmod(0o600)
    return place


def test_nothing_named_is_no_endpoint() -> None:
    assert llm_settings.endpoint(None, None) is None
    assert llm_settings.endpoint("off", "small") is None
    with pytest.raises(LanguageError, match="RPAUG_LLM_MODEL"):
        llm_settings.endpoint(HOME, None)
    with pytest.raises(LanguageError, match="RPAUG_LLM_URL"):
        llm_settings.endpoint(None, "small")


def test_options_go_before_environment_before_file(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def found(url: str | None = None, model: str | None = None) -> tuple[str, str, str]:
        one = llm_settings.endpoint(url, model)
        assert one is not None
        return one.url, one.model, one.key

    assert found() == (HOME, "kept", KEY)
    assert found(model="other") == (HOME, "other", KEY)
    monkeypatch.setenv("RPAUG_LLM_MODEL", "set")
    assert found() == (HOME, "set", KEY)
    monkeypatch.setenv("RPAUG_LLM_URL", "http://set/v1")
    assert found() == ("http://set/v1", "set", "")  # the file's key is not for another server
    monkeypatch.setenv("RPAUG_LLM_KEY", "set-key")
    assert found("http://given/v1", "given") == ("http://given/v1", "given", "set-key")
    assert llm_settings.endpoint("off", None) is None


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644])
def test_a_key_that_others_may_read_is_refused(file: Path, mode: int) -> None:
    file.chmod(mode)
    with pytest.raises(LanguageError, match="chmod 600") as caught:
        llm_settings.endpoint(None, None)
    assert KEY not in str(caught.value)
    file.write_text(f'url = "{HOME}"\nmodel = "kept"\n')  # without a key anyone may
    assert llm_settings.endpoint(None, None) is not None


@pytest.mark.parametrize("text", [f'key = "{KEY}', f'token = "{KEY}"', "url = 3", "\x00"])
def test_a_file_that_is_none_is_one_line(file: Path, text: str) -> None:
    file.write_text(text)
    with pytest.raises(LanguageError, match=r"llm\.toml") as caught:
        llm_settings.endpoint(None, None)
    assert KEY not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_key_that_no_header_takes_is_refused() -> None:
    for key in ("two\nlines", "schlüssel"):
        with pytest.raises(LanguageError, match="characters") as caught:
            llm_settings.Endpoint.of(HOME, "small", key=key)
        assert key not in str(caught.value)
    with pytest.raises(LanguageError, match="not in the URL") as caught:
        llm_settings.Endpoint.of(f"http://host/{KEY}/v1", "small", key=KEY)
    assert KEY not in str(caught.value)


def test_words_that_hold_a_key_are_refused(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    llm_settings.refuse_keys("paint the sketch_of_a_rather_long_name red")
    llm_settings.refuse_keys(
        "key light from the left, 3200 K; the token_of_a_rather_long_name blue"
    )
    monkeypatch.setenv("RPAUG_LLM_KEY", "short")
    likely = (
        "sk-proj-0123456789abcdefghij",
        "ghp_0123456789abcdefghij",
        "eyJhbGciOiJIUzI1NiJ9.e30.x",
    )
    likely += ("Bearer 0123456789abcdef0123456789", "api key: 0123456789abcdef0123456789")
    for words in (f"red {KEY}", "make it short", *(f"use {one} to paint" for one in likely)):
        with pytest.raises(LanguageError, match="hold a key") as caught:
            llm_settings.refuse_keys(words)
        assert words not in str(caught.value)
