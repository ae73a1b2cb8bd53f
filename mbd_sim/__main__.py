"""`python -m mbd_sim`: the same as the command `mbd_sim`."""

import sys

from mbd_sim.programs import command

sys.exit(command.cli.main.main())
