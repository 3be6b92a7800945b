"""What a recording says about its world, one folder an idea.

Who moves how (`tracking`), who is who (`naming`, `semantic`, `segmentation`, `rgb_only`), what was seen and can be
shown again (`recorded`, `splats`, `four`), its light (`lighting`), what edits bring in (`placement`, `added`,
`simulated`, `painted`).
"""

__all__ = ["build", "sampled_frames"]
