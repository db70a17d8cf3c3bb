"""``python -m cadet_sym`` is ``cadet-sym``."""

import sys

from cadet_sym.cli import main

sys.exit(main())
