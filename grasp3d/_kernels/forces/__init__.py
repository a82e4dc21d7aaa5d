"""Contact forces that resist wrenches and tasks."""
