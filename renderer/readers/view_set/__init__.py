"""Sets of pictures, one for each view: the grid by their names, and views decoded when they are first used."""
