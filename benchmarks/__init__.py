"""Speed and accuracy of `mbd_sim`, compared with other simulators: `make bench`."""
