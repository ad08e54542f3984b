"""Raw pictures of the Lytro cameras F01 and Illum: `.lfp`, `.lfr` and `.raw`."""
