"""Contact problems: forces or impulses at several contacts at once, with Coulomb friction.

All arithmetic is elementwise, in a fixed order, so that results are the same bits on every machine.
"""
