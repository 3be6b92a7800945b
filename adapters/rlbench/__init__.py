"""RLBench, PerAct and COLOSSEUM: a folder of PNGs and three pickles an episode."""

from rpaug_adapters.rlbench.adapter import RLBench

__all__ = ["RLBench"]
