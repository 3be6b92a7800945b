"""A closed loop: demonstrations, augmentation, a small policy, and how often it then succeeds."""
