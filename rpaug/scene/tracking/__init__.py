"""How each instance moves: static, with the gripper, as a link of the arm, or aligned by depth."""

__all__ = [
    "agreement",
    "arms",
    "bodies",
    "calibration",
    "chain",
    "jaws",
    "outline_calibration",
    "outline_pose",
    "outline_starts",
    "robot_model",
    "slide",
    "touch",
]
