"""The articulated-body recursion, its multipliers and reactions."""
