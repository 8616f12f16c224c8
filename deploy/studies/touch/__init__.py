"""Up to which stiffness and delay a wall can be touched: `tis touch`."""
