"""`rpaug doctor`: what this machine can do."""

from rich.console import Console

from rpaug.cli.console import AsJson, plain, print_json


def doctor(as_json: AsJson = False) -> int:
    """Check what this machine can do: packages, operators, OpenGL, GPU, kernel cache.

    Example: [bold]rpaug doctor[/]
    """
    from dataclasses import asdict

    from rpaug.doctor import examine

    findings = examine()
    if as_json:
        print_json([asdict(finding) for finding in findings])
    else:
        colour = {"ok": "green", "note": "yellow", "bad": "bold red"}
        for finding in findings:
            mark = f"[{colour[finding.level]}]{finding.level:4}[/]"
            Console().print(
                f"{mark} {finding.topic}: {plain(finding.message)}",
                highlight=False,
                soft_wrap=True,
            )
    return 2 if any(finding.level == "bad" for finding in findings) else 0
