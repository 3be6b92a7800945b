"""Why a policy fails, from its rollouts' images, and the recipe that may mend it."""

from rpaug.diagnosis.diagnose import diagnose
from rpaug.diagnosis.evaluation import Evaluation, Rollout
from rpaug.diagnosis.jsonl import FrameImages, Line, write
from rpaug.diagnosis.messages import Cause, Diagnosis, Measured
from rpaug.diagnosis.reading import read

__all__ = [
    "Cause",
    "Diagnosis",
    "Evaluation",
    "FrameImages",
    "Line",
    "Measured",
    "Rollout",
    "diagnose",
    "loop",
    "page",
    "read",
    "reference",
    "vision",
    "write",
]
