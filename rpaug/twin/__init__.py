"""MuJoCo scenes that write real-format episodes, and their truly changed versions."""

from rpaug.twin.covers import Cover
from rpaug.twin.look import LAMPS, RIG, Bump, Look, TwinLamp
from rpaug.twin.record import Take, perform, record
from rpaug.twin.tasks import TASKS
from rpaug.twin.truth import Laid, Truth

__all__ = [
    "LAMPS",
    "RIG",
    "TASKS",
    "Bump",
    "Cover",
    "Laid",
    "Look",
    "Take",
    "Truth",
    "TwinLamp",
    "perform",
    "record",
]
