"""Recipe, plan, preparation, one copy, its gates and report, and whole runs of them."""
