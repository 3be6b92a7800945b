"""Which Gaussian belongs to which instance: by weighted vote, by learned encodings, and finer than the masks.

`vote` and `assigned` are the fast default, `learn` the encodings, `tell_apart` the parts that masks do not know,
`adopted` and `added` take in Gaussians from elsewhere.
"""

from rpaug.gaussians.adopt import added, adopted, from_ply
from rpaug.gaussians.distil import PartPrompt, Told, tell_apart
from rpaug.gaussians.encoding import Identities, Learning, identity_mask, learn
from rpaug.gaussians.labels import UNKNOWN, Labelled, LabelRenderer, mask, recorded
from rpaug.gaussians.vote import assigned, ballots, vote

__all__ = [
    "UNKNOWN",
    "Identities",
    "LabelRenderer",
    "Labelled",
    "Learning",
    "PartPrompt",
    "Told",
    "added",
    "adopted",
    "assigned",
    "ballots",
    "from_ply",
    "identity_mask",
    "learn",
    "mask",
    "recorded",
    "tell_apart",
    "vote",
]
