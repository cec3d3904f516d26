"""Elastic joints identified by one method, without what a user's call does before."""

from symid.identification.elastic.identify import prepare_methods
from symid.identification.elastic.options import ElasticOptions


def identify_elastic(library, recordings, options=None, *, echo=None):
    """Return the estimate by the method of the options."""
    options = options or ElasticOptions()
    return prepare_methods(library, recordings, options, echo=echo)(options.method)
