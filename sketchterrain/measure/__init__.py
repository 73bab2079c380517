"""How far a terrain does what its sketch says, and how near it is to real land."""
