"""Simulators' demonstrations in HDF5: robomimic, robosuite, LIBERO, ManiSkill."""

from rpaug_adapters.hdf5_sim.adapter import HDF5Sim

__all__ = ["HDF5Sim"]
