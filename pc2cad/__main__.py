"""``python -m pc2cad`` is the command ``pc2cad``."""

import sys

from pc2cad.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
