"""Where an instance may stand: free space on the support, and what standing there touches."""

__all__ = [
    "free_space",
    "free_space_rgb",
    "grip",
    "growing",
    "placing",
    "policy_views",
    "standing",
    "untouched",
    "zones",
]
