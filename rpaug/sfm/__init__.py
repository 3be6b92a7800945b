"""Where the camera of a video was, and what it filmed: structure from motion, and a scene that edits can be made in."""
