"""Resampling schemes: ancestors of the next particles."""
