"""Plants: Poisson-disk points, species, foliage."""
