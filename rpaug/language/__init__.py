"""Words in, recipes out: small stages over typed messages. `asking.ask` runs them all."""

__all__ = ["answers", "asking", "making", "messages", "prompting", "rounds", "schemas", "talk"]
