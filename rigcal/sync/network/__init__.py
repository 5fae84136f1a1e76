"""Probing the clocks of camera hosts over the network, in the packets of NTP."""
