"""The main job on the embedded sample: augment it by the shipped demo recipe, end with the contact sheet's path."""

import shutil
import subprocess
import sys
from pathlib import Path

import rpaug

OUT = Path("demo-output")


def main() -> None:
    """Run `rpaug augment` as a user would, into a fresh folder."""
    shutil.rmtree(OUT, ignore_errors=True)  # the demo's own folder, named in .gitignore
    sample = Path(rpaug.__file__).parent / "sample"
    command = [
        sys.executable,
        "-m",
        "rpaug",
        "augment",
        str(sample),
        "--recipe",
        "demo",
        "--out",
        str(OUT),
    ]
    print("$ rpaug", *command[3:], flush=True)
    subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
