"""What the runtime is worth on data whose truth is known."""

from recognition.evaluation.dataset import Dataset, open_dataset
from recognition.evaluation.people import Evaluation, evaluate_people
from recognition.evaluation.timed import TimedTruth

__all__ = ["Dataset", "Evaluation", "TimedTruth", "evaluate_people", "open_dataset"]
