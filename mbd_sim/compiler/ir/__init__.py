"""LLVM's intermediate language, written as text."""
