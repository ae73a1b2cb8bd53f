"""Tools for CasADi expressions: spatial algebra, pieces, tables, rank."""
