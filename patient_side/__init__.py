"""The patient's side: identification, estimation and the arm."""

from tis import refuse_old_name

refuse_old_name(__name__)
