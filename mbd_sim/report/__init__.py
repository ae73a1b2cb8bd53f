"""What `mbd_sim check` reports about a mechanism."""
