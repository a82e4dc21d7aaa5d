"""Figures with matplotlib: cones, curves, stacked area fractions, labelled surfaces."""
