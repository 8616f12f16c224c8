"""The paper's comparison of methods, `tis paper --methods`: each of its adjectives as measured figures."""
