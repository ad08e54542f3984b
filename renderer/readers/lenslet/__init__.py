"""Raw lenslet pictures: what a sensor behind a lens array takes, with a pitch that is no whole number of pixels."""
