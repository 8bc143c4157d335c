"""Whether the line may fold in a query: a strain of -1 or less, at which two particles meet."""

import numpy as np

from sphpod.surveys.parts import Operators, Values
from sphpod.surveys.query import Answer

FAR = 0.99
"""Strain below which none is looked for."""


def check_folds(operators: Operators, answer: Answer, values: Values) -> None:
    """Refuse an answer whose line may fold.

    No strain exceeds |u| over the smallest √(V c), and |u| grows by the force alone; where that
    excludes no fold, strain and bound are looked at at all particles and outputs.

    Raises
    ------
    ValueError
    """
    query = answer.query
    pushed = sum(course.impulse(query.times)[-1] for course in query.courses)
    most = answer.start_norm + answer.force_norm * pushed
    if most < FAR * operators.least_stiffness(values):
        return
    weights = np.sqrt(operators.volumes * operators.modulus.at(values))
    _, strain = answer.fields(operators)
    least = (strain - answer.bound[:, None] / weights).min()
    if not least > -1:
        raise ValueError(f"the line may fold: a strain may be {least:.3g}, and must be above -1")
