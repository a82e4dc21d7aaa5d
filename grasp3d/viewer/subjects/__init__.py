"""Viewed surfaces and their numbers, from labels or from files."""
