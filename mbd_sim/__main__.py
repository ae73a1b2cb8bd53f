"""`python -m mbd_sim`: the same as the command `mbd_sim`."""

import sys

from mbd_sim.cli.main import main

sys.exit(main())
