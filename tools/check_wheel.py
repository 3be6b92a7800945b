"""Builds the wheel, installs it afresh without dependencies being fetched again, and uses it from elsewhere."""

import os
import subprocess
import sys
import sysconfig
import tempfile
import venv
from pathlib import Path

USE = """
import json, subprocess, sys
from pathlib import Path
import rpaug, rpaug_adapters, rpaug_recipes
from rpaug.core import registry
from rpaug.pipeline import recipe
here = Path(sys.argv[1])
for module in (rpaug, rpaug_adapters, rpaug_recipes):
    assert Path(module.__file__).is_relative_to(here), module.__file__
for name in registry.adapter_names():
    assert registry.adapter(name).name == name
assert recipe.load(Path(rpaug_recipes.__file__).parent / "demo.yaml").steps
assert registry.adapter_for(Path(rpaug.__file__).parent / "sample").name == "rlbench"
rpaug_command = Path(sys.executable).parent / "rpaug"
shown = subprocess.run([rpaug_command, "validate-recipe", "demo", "--json"], capture_output=True, text=True, check=True)
assert json.loads(shown.stdout)["valid"]
print("the wheel works from", here)
"""


def main() -> None:
    """Raises CalledProcessError if any step fails."""
    root = Path(__file__).resolve().parent.parent
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        build = [
            sys.executable,
            "-m",
            "pip",
            "wheel",
            "--quiet",
            "--no-deps",
            "--wheel-dir",
            str(work),
            str(root),
        ]
        subprocess.run(build, check=True)
        (wheel,) = work.glob("rpaug-*.whl")
        venv.create(work / "venv", with_pip=True)
        python = work / "venv" / "bin" / "python"
        version = f"python{sys.version_info.major}.{sys.version_info.minor}"
        site = work / "venv" / "lib" / version / "site-packages"
        install = [
            str(python),
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--no-deps",
            str(wheel),
        ]
        subprocess.run(install, check=True)
        # The dependencies are those of this environment; only rpaug itself must come from the wheel,
        # whatever checkout a shell's PYTHONPATH names.
        (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
        alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        subprocess.run([str(python), "-c", USE, str(site)], check=True, cwd=work, env=alone)


if __name__ == "__main__":
    main()
