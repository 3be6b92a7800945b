"""`rpaug doctor`: what this machine can do, and its kernels compiled ahead."""

from typing import Annotated

import typer
from rich.console import Console

from rpaug.cli.console import AsJson, plain, print_json, say
from rpaug.cli.progress import progress_bar


def doctor(
    warm: Annotated[
        bool,
        typer.Option("--warm", help="First compile all kernels into the cache: about a minute."),
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Check what this machine can do: packages, operators, OpenGL, GPU, kernel cache.

    With --warm, --json gives the seconds under `warmed` and the findings under `findings`.

    Example: [bold]rpaug doctor --warm[/]
    """
    from dataclasses import asdict

    from rpaug.cli import checks as asked

    warmed = []
    if warm:
        with progress_bar("compiling", as_json) as progress:
            for made in asked.warm(progress=progress):
                warmed.append(asdict(made))
                if not as_json:
                    channels = "" if made.channels is None else f", {made.channels} channels"
                    spent = f"{made.seconds:.1f} s, {made.cpu_seconds:.1f} s of the processor"
                    say(f"ready: {made.name}{channels}: {spent}")
    findings = asked.examine()
    if as_json:
        given = [asdict(finding) for finding in findings]
        print_json({"warmed": warmed, "findings": given} if warm else given)
    else:
        color = {"ok": "green", "note": "yellow", "bad": "bold red"}
        for finding in findings:
            mark = f"[{color[finding.level]}]{finding.level:4}[/]"
            Console().print(
                f"{mark} {finding.topic}: {plain(finding.message)}",
                highlight=False,
                soft_wrap=True,
            )
    return 2 if any(finding.level == "bad" for finding in findings) else 0
