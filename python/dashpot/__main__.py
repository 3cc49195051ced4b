"""``python -m dashpot``: the command line."""

import sys

from dashpot.cli import main

sys.exit(main())
