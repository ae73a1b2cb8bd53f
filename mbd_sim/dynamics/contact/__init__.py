"""One-sided rows: gaps of shapes, cams, stops and constraints with their friction; and forces at compliant contacts."""
