"""Motion models: odometry, wheels, and what they err by."""
