"""Measure the things that ship, for the library to know their color and size without building them.

python tools/measure_assets.py
"""

import json

from rpaug.assets import library


def facts() -> dict[str, dict[str, object]]:
    """Color word, and size in metres to a micrometre, by name."""
    return {
        one.name: {"color": one.color, "size": [round(side, 6) for side in one.size]}
        for one in library.measured()
    }


if __name__ == "__main__":
    lines = (f"{json.dumps(name)}: {json.dumps(one)}" for name, one in facts().items())
    library.SHIPPED.write_text("{\n" + ",\n".join(lines) + "\n}\n")
