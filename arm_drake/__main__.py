"""Entry point of `python -m arm_drake`, which is `arm-drake`."""

import sys

from arm_drake.cli import main

if __name__ == "__main__":
    sys.exit(main())
