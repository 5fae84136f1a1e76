"""How clocks and frames held through a recording: what the page of ``rigcal sync report`` shows."""
