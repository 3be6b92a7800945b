"""The contract that every operator keeps, on the sample that ships: `pip install . && python -m pytest`."""

from glow import Glow

import rpaug


class TestGlow(rpaug.OperatorContract):
    def operator(self):
        return Glow(target=rpaug.Target(role="manipulated"), color="violet")
