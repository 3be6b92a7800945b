"""MuJoCo scenes that write real-format episodes, and their truly changed versions."""

from rpaug.twin.look import Bump, Look
from rpaug.twin.record import Take, perform, record
from rpaug.twin.truth import Truth

__all__ = ["Bump", "Look", "Take", "Truth", "perform", "record"]
