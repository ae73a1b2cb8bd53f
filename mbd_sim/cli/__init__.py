"""The command `mbd_sim`: one module a command."""
