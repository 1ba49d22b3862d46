"""Persons' legs in a 2D scan: clusters, their geometric features, a classifier, pairs of legs."""
