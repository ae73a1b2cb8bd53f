"""The report of `mbd_sim check` about a mechanism, as data and as text."""
