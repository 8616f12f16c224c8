"""The composition root: the only package that knows all three sides."""

from tis import refuse_old_name

refuse_old_name(__name__)
