"""What documents and help tell to type is understood as it stands: each command's options, each snippet's names.

README's, the quickstart's and the Python page's are run too, in tests/test_docs.py; here nothing is.
"""

import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer.main

import rpaug
from rpaug.cli import app
from tests.test_docs import PAGES, ROOT, blocks

CLI = typer.main.get_command(app)
INDENTED = re.compile(r"(?m)^    (rpaug .*(?:\\\n.*)*)")
ENDS = ("|", "&&", ";", "&", ">")


def told(page: Path) -> Iterator[list[str]]:
    """The words of each `rpaug` command of a page, behind `rpaug`; without options in brackets."""
    text = page.read_text()
    lines = [
        line for block in blocks(page, "sh") for line in block.replace("\\\n", " ").splitlines()
    ]
    lines += [line.replace("\\\n", " ") for line in INDENTED.findall(text)]
    for line in lines:
        words = shlex.split(re.sub(r" \[--[^\]]*\]", "", line), comments=True)
        while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
            words = words[1:]
        if words[:1] == ["rpaug"] and "..." not in words and "…" not in words:
            end = next((i for i, word in enumerate(words) if word in ENDS), len(words))
            yield words[1:end]


def examples() -> Iterator[list[str]]:
    """The words of each example in the help of a command, behind `rpaug`."""
    for path in sorted((ROOT / "rpaug/cli").glob("*.py")):
        for line in re.findall(r"Example: \[bold\]rpaug (.*?)\[/\]", path.read_text(), re.DOTALL):
            yield shlex.split(line.replace("\\[", "[").replace("\n", " "))


def understand(words: list[str]) -> None:
    """Parse a command line as the program would, without running it. Raises what the program says of a wrong one."""
    command, context, rest = CLI, None, words
    while True:
        context = command.make_context("rpaug", list(rest), parent=context)
        if not hasattr(command, "resolve_command"):
            return
        rest = [*context._protected_args, *context.args]
        if not rest:
            return
        _, command, rest = command.resolve_command(context, rest)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_of_documents_are_understood(page: Path) -> None:
    for words in told(page):
        try:
            understand(words)
        except Exception as error:
            pytest.fail(f"rpaug {' '.join(words)}: {getattr(error, 'message', error)}")


def test_examples_of_help_are_understood() -> None:
    found = list(examples())
    assert len(found) > 25
    for words in found:
        understand(words)


def test_what_is_not_understood_is_found_out() -> None:
    with pytest.raises(Exception, match="No such option"):
        understand(["augment", "sample", "--recipee", "robust"])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_in_snippets_exist(page: Path) -> None:
    for block in blocks(page, "python"):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rpaug"):
                for one in node.names:
                    exec(f"from {node.module} import {one.name}", {})
            elif isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "rpaug":
                assert hasattr(rpaug, node.attr), node.attr
