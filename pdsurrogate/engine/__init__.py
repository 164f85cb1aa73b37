"""Compiler and threads: compilation with a cache on disk, passes on threads, vector loads and stores, arrays of known row length."""
