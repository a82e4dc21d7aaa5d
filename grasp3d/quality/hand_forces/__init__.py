"""What the motors of a hand with joints can hold: closure, payload, and what limits it."""
