"""Evidence of violations: for each a folder that a person can look at and that can be kept apart from the recording.

``NAME.evidence/EVENT_ID/`` holds ``views.mp4`` (all views and the floor plan, from 5 s before to 5 s after, heads
blurred), ``instant.png`` (of it the instant at which the violation was clearest), ``plan.png`` (the floor then),
``margins.svg`` (by how much the rule was violated, over time) and ``event.json``.
"""

from recognition.evidence.exhibits import EvidenceOptions, Exhibit, write_exhibits
from recognition.evidence.plot import margin_plot

__all__ = ["EvidenceOptions", "Exhibit", "margin_plot", "write_exhibits"]
