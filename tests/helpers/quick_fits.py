"""Fits of a few steps, in this process and in workers: for what does not hang on how good they are."""

from functools import partial
from multiprocessing.connection import Connection

from rpaug.gaussians import cached
from rpaug.gaussians.descent import FitSettings
from rpaug.gaussians.fit4 import FourSettings
from rpaug.pipeline import workers

SHORT = FitSettings(steps=8, train_frames=3, checked_frames=1, threads=1)
BOTH = cached.Both(SHORT, FourSettings(rounds=2, checked_frames=2, densify_rounds=()))
QUICK = {
    "fitted": partial(cached.fitted, settings=SHORT),
    "fitted_in_time": partial(cached.fitted_in_time, settings=BOTH),
}


def quick_worker(connection: Connection) -> None:
    """A fresh one knows nothing of what a test changed."""
    vars(cached).update(QUICK)
    workers._serve(connection)
