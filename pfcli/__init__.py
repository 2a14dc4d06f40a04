"""Replay recorded robot logs offline through published particle-filter systems."""

__version__ = "0.1.0"
