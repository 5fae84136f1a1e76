"""Clocks from what the cameras saw: a moving board, people, or a light that is switched."""
