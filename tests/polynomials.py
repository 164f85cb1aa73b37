"""Surrogates that fit in a moment."""

import pdsurrogate as pds


def polynomial(samples, degree):
    """A polynomial of isochoric features, fitted to samples."""
    regressor = pds.learning.ChebyshevRegressor(degree)
    return pds.surrogate_pipeline(regressor, features="isochoric").fit(samples.X, samples.y)
