"""Many logs, systems, parameters and seeds: what to run, who runs it, and what came out."""
