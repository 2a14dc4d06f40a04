"""Where things sit on a robot: the transform tree of a recording, and readings brought into the base frame."""
