"""One file per format or library: what stands outside becomes nouns, and nouns go out."""
