"""From exchanges with a host to its clock: offset, drift and a bound that holds, steps, and their course over time."""
