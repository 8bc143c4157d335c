"""Where the scripts of the workflow report to: their log file, and a sentence on the terminal."""

import logging
import os
import sys
from pathlib import Path
from types import TracebackType


def start(path: str | os.PathLike[str]) -> None:
    """Log to a file from now on, an exception that nobody catches too.

    Such an exception is then reported on the terminal in one sentence, without its traceback; and
    so is what this package warns of.
    """
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    logging.basicConfig(
        filename=path,
        filemode="w",
        level=logging.INFO,
        format="%(levelname)s %(name)s: %(message)s",
    )
    logging.captureWarnings(True)
    # On a full disk the log itself cannot be written: what failed is said once, by `_report`.
    logging.raiseExceptions = False
    # Of each font in each figure it has a hundred lines to say.
    logging.getLogger("fontTools").setLevel(logging.WARNING)
    terminal = logging.StreamHandler(sys.stderr)
    terminal.setLevel(logging.WARNING)
    logging.getLogger("sphpod").addHandler(terminal)
    sys.excepthook = _report


def _report(
    kind: type[BaseException], error: BaseException, traceback: TracebackType | None
) -> None:
    logging.critical("stopped", exc_info=(kind, error, traceback))
    sentence = str(error) or kind.__name__
    expected = isinstance(error, ValueError | ArithmeticError | OSError)
    print(sentence if expected else f"{kind.__name__}: {sentence}", file=sys.stderr)
