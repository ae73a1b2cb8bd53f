"""The command `mbd_sim`: one module for each subcommand, listed in `main.COMMANDS`."""
