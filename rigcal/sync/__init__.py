"""Clocks: probes of the camera hosts, stamps of the frames and what the cameras saw give a clock model each."""
