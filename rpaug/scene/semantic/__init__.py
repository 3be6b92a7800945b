"""Which Gaussian belongs to which instance: by weighted vote, by learned encodings, and finer than the masks."""
