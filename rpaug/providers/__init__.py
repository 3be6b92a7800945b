"""Knowledge from outside the episode, behind small functions: each has a way that works offline."""
