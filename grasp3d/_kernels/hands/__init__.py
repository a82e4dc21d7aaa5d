"""Hands with joints."""
