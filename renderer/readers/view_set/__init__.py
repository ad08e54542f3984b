"""Sets of pictures, one for each view: their names give the grid, and each view is decoded when it is first used."""
