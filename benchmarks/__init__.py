"""Speed and accuracy of `mbd_sim`, compared with other simulators: `make bench`."""

import os

os.environ["MBD_SIM_QUICK_START"] = "off"  # steps are those of optimized code
