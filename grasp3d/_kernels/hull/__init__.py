"""The hull of contact wrenches: epsilon, force closure, certificates."""
