"""MuJoCo moves things on machines that can render nothing."""

import os
import subprocess
import sys

PROGRAM = """
import sys
class Missing:  # PyOpenGL where no library is installed
    def find_spec(self, name, *rest):
        if name in ("mujoco.egl", "mujoco.osmesa", "mujoco.glfw"):
            raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")
sys.meta_path.insert(0, Missing())
from rpaug.core import simulation
model = simulation.mujoco().MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
import os
print(model.nbody, os.environ.get("MUJOCO_GL"))
"""


def test_things_move_where_the_named_opengl_is_missing() -> None:
    for named in ("egl", "osmesa", None):
        variables = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"}
        variables |= {"MUJOCO_GL": named} if named else {}
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=variables,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.stdout.split() == ["1", str(named)], done.stderr
