"""RLDS datasets of Open X-Embodiment: TFRecords and a description of their features."""

from rpaug_adapters.rlds.adapter import RLDS

__all__ = ["RLDS"]
