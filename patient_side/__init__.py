"""The patient's side: identification, estimation and the arm."""
