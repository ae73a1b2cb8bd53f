"""Control experiments: nodes that talk to `sim_node` over topics alone, each a page long, to copy from."""
