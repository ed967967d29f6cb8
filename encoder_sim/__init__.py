"""The simulated hardware: what a mount's electronics would send. Only it knows the truth."""
