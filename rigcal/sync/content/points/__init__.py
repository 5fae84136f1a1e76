"""Clocks from labelled points that several cameras followed, in a rig that is known."""
