"""The loop that all systems share, and what a run leaves."""
