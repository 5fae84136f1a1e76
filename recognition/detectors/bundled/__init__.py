"""The networks that come with the package, and the one definition of what goes into them and comes out.

``geometry`` and ``decode`` are that definition; what trains the networks imports it from here.
"""

from recognition.detectors.bundled.detector import BundledDetector
from recognition.detectors.bundled.loading import load_bundled

__all__ = ["BundledDetector", "load_bundled"]
