"""The commands of clocks: answer probes, probe, compare video, check before a recording, report after it."""
