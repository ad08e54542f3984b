"""Raw lenslet pictures, as taken by a sensor behind a lens array, whose pitch isn't a whole number of pixels."""
