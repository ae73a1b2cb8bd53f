"""Where bodies of finite shapes meet, in the subset of Python that is compiled."""
