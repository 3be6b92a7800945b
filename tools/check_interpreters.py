"""Uses the wheel under every other Python that is meant and found: version, a copy of the sample, `verify`.

A Python that is not to be had is named and passed over. So is torch where the only build of it brings CUDA's libraries,
gigabytes of them: the wheel is then used without, since edits of images want no torch.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MEANT = ("3.11", "3.12", "3.13")
TORCH = os.environ.get("TORCH", "torch==2.13.0")
RECIPE = """version: 1
edits:
  - {op: recolor, target: {role: manipulated}, color: blue}
  - {op: table_texture}
  - {op: light_color, range: [[0.9, 0.8, 0.7], [0.9, 0.8, 0.7]]}
"""


def main() -> int:
    """Exit code 1 if a Python that was found cannot use the wheel."""
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    others = [version for version in MEANT if version != own]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(len(others)) as pool:
        work = Path(folder)
        wheel = built(work)
        outcomes = list(pool.map(lambda version: outcome(version, wheel, work / version), others))
    for version, (_, said) in zip(others, outcomes, strict=True):
        print(f"Python {version}: {said}")
    return 0 if all(well for well, _ in outcomes) else 1


def outcome(version: str, wheel: Path, folder: Path) -> tuple[bool, str]:
    """Whether nothing speaks against the wheel under this version, and what to say of it."""
    python = found(version)
    if python is None:
        return True, "not checked, none is installed"
    subprocess.run([python, "-m", "venv", str(folder / "venv")], check=True)
    tools = folder / "venv/bin"
    pip = [str(tools / "python"), "-m", "pip", "--disable-pip-version-check", "--quiet"]
    new = run(
        [*pip, "install", "--upgrade", "pip"]
    )  # older ones fetch a wheel to ask what it needs
    if new.returncode:
        return True, f"not checked, no package is to be had: {last(new)}"
    torch, with_torch = torch_for_cpu(pip)
    fault = installed(pip, torch, wheel) or used(tools / "rpaug", folder)
    return not fault, f"{fault or 'the wheel works'} ({with_torch})"


def found(version: str) -> str | None:
    """A Python of this version: on the path, or pyenv's."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    candidates = [
        f"python{version}",
        *(str(one / "bin/python") for one in pyenv.glob(f"{version}.*")),
    ]
    asked = "import sys, venv; print('%d.%d' % sys.version_info[:2])"
    for python in candidates:
        try:
            said = subprocess.run([python, "-c", asked], capture_output=True, text=True, check=True)
        except (OSError, subprocess.CalledProcessError):  # a shim of pyenv's says no
            continue
        if said.stdout.strip() == version:
            return python
    return None


def built(work: Path) -> Path:
    """The wheel of this checkout."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(work)]
    subprocess.run([*pip, str(ROOT)], check=True)
    (wheel,) = work.glob("rpaug-*.whl")
    return wheel


def installed(pip: list[str], torch: str | None, wheel: Path) -> str:
    """Why the wheel cannot be installed; empty where it was, without torch where there is none."""
    done = run([*pip, "install", *([torch, str(wheel)] if torch else needed())])
    if done.returncode == 0 and not torch:
        done = run([*pip, "install", "--no-deps", str(wheel)])
    return f"not installed: {last(done)}" if done.returncode else ""


def torch_for_cpu(pip: list[str]) -> tuple[str | None, str]:
    """What to install of torch, None where no build for the CPU is to be had, and a word on it."""
    done = run([*pip, "install", "--dry-run", "--no-deps", "--report", "-", TORCH])
    if done.returncode:
        return None, f"without torch: {last(done)}"
    (one,) = json.loads(done.stdout)["install"]
    needs = one["metadata"].get("requires_dist", [])
    if any(re.match(r"nvidia|cuda", name) for name in needs):
        return None, f"without torch: the only build of {TORCH} brings CUDA, gigabytes of it"
    return TORCH, f"with {TORCH}"


def needed() -> list[str]:
    """What the wheel asks for, but for torch."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    return [name for name in listed if not name.startswith("torch")]


def used(rpaug: Path, folder: Path) -> str:
    """What went wrong of the main job on the sample."""
    (folder / "recipe.yaml").write_text(RECIPE)
    for line in (
        "--version",
        "augment sample --recipe recipe.yaml --out augmented",
        "verify augmented --against sample",
    ):
        done = run([str(rpaug), *line.split()], folder)
        if done.returncode:
            return f"`rpaug {line}` fails: {last(done)}"
    return ""


def run(command: list[str], folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run it with nothing of a shell's PYTHONPATH: the wheel alone is what is tried."""
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(command, cwd=folder, env=alone, capture_output=True, text=True)


def last(done: subprocess.CompletedProcess[str]) -> str:
    """The last line of what was said."""
    return ((done.stderr or done.stdout).strip().splitlines() or ["nothing was said"])[-1]


if __name__ == "__main__":
    sys.exit(main())
