"""Sensor models: how well a reading fits a pose."""
