"""Recipe, plan, preparation, one copy, its gates and report, and whole runs of them."""

__all__ = [
    "augment",
    "contact",
    "contracts",
    "convert",
    "copies",
    "fit",
    "gates",
    "inputs",
    "inspect",
    "left_out",
    "pareto",
    "plan",
    "prepare",
    "python_api",
    "recipe",
    "recipe_errors",
    "role_facts",
    "run",
    "speed_error",
    "verify",
]
