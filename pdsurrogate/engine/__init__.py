"""The engine under the kernels: compilation and its cache, passes on threads, vector loads and stores, arrays of known row length."""
