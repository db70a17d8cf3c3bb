"""``python -m cadet_sym`` is ``cadet-sym``: one command in a process of its own.

Python looks for garbage while half a million objects come to stay, and once more as it leaves: a fifth of the time of a first
result, which is spared here.
"""

import gc
import sys

SELDOM = 100_000
"""Objects after which it is looked for garbage; Python's own number is 700."""


def run() -> int:
    """Run one command; returns its exit status."""
    gc.set_threshold(SELDOM)
    from cadet_sym.cli import main

    try:
        return main()
    finally:
        gc.freeze()  # what is there now is not searched once more


if __name__ == "__main__":
    sys.exit(run())
