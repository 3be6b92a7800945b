"""Words in, recipes out: small stages over typed messages. `asking.ask` runs them all."""
