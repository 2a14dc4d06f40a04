"""The systems, one folder each, and what they share."""
