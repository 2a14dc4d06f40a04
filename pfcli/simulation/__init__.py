"""Worlds, robots and sensors with truth."""
