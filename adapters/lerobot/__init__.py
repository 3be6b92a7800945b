"""LeRobot v3.0: tables in parquet, cameras as mp4."""

from rpaug_adapters.lerobot.adapter import LeRobot

__all__ = ["LeRobot"]
