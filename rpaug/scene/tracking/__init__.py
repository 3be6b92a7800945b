"""How each instance moves: static, with the gripper, as a link of the arm, or aligned by depth."""
