"""Which Gaussian belongs to which instance: by weighted vote, by learned encodings, and finer than the masks.

`vote` and `assigned` are the fast default, `learn` the encodings, `tell_apart` the parts that masks do not know,
`adopted` and `added` take in Gaussians from elsewhere.
"""

from rpaug.scene.semantic.adopt import added, adopted, from_ply
from rpaug.scene.semantic.distil import Prompt, Told, tell_apart
from rpaug.scene.semantic.encoding import Identities, Learning, identity_mask, learn
from rpaug.scene.semantic.labels import UNKNOWN, Labelled, Stage, recorded
from rpaug.scene.semantic.masks import mask
from rpaug.scene.semantic.vote import assigned, ballots, vote

__all__ = [
    "UNKNOWN",
    "Identities",
    "Labelled",
    "Learning",
    "Prompt",
    "Stage",
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
