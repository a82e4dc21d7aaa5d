"""The figures: drawings of cones, curves, stacked fractions, painted surfaces (matplotlib)."""
