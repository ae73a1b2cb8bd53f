"""What `mbd_sim` costs and how exact it is, beside other simulators: `make bench`."""
