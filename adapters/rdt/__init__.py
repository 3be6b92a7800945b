"""RDT and ALOHA: an HDF5 file an episode."""

from rpaug_adapters.rdt.adapter import RDT

__all__ = ["RDT"]
