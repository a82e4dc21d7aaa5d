"""What is looked at: surfaces with their numbers, from labels or from files."""
