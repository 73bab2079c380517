"""Roads, railways and paths: their network, alignment, structures and longitudinal profile; building pads."""
