"""The surgeon's side: a movement, sampled and sent."""

from tis import refuse_old_name

refuse_old_name(__name__)
