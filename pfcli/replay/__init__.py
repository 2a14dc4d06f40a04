"""The way of a message, from the recording to an event with its odometry pose."""
