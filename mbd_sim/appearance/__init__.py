"""How a mechanism looks, whoever draws it: shared by the viewer, the pictures and the markers."""
