"""MuJoCo scenes that write real-format episodes, and their truly changed versions."""

from rpaug.twin.covers import Cover
from rpaug.twin.look import FINISHES, LAMPS, RIG, Bump, Finish, Look, TwinLamp
from rpaug.twin.record import Take, perform, record
from rpaug.twin.tasks import TASKS
from rpaug.twin.truth import Laid, Truth

__all__ = [
    "FINISHES",
    "LAMPS",
    "RIG",
    "TASKS",
    "Bump",
    "Cover",
    "Finish",
    "Laid",
    "Look",
    "Take",
    "Truth",
    "TwinLamp",
    "perform",
    "record",
]
