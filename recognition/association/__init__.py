"""Which detections of different cameras show one worker or one object.

:mod:`recognition.association.paper` is the Safe-Construct paper's greedy method; the tracked method's parts are
:mod:`recognition.association.claims` (what tracks claim) and :mod:`recognition.association.leftovers` (the rest).
"""

from recognition.association.paper import Association, AssociationOptions, Groups, associate, match

__all__ = ["Association", "AssociationOptions", "Groups", "associate", "match"]
