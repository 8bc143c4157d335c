"""How many examples hypothesis draws."""

from hypothesis import settings


def examples(count: int) -> settings:
    """So many in the whole suite, and as many fewer in a quick run as its profile says."""
    return settings(max_examples=max(1, count * settings().max_examples // 100))
