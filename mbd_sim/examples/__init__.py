"""Control examples: nodes that use only the topics of `sim_node`, one folder each, to be copied."""
