"""Compilation of functions with a cache on disk, parallel passes over a body, vector loads and
stores, arrays of constant row length.
"""
