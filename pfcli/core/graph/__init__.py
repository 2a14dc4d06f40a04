"""Pose graphs."""
