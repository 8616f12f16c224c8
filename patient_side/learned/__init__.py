"""Learned methods, as far as a run needs them: in numpy, so that a patient needs no framework to use a trained model.

Where to look:

- what they read: `inputs` (the recent path, with what is missing, in units of the hand's activity);
- networks: `transformer`, `informer`, `cnn`, on `layers`; their common end, a normal distribution: `gaussian_head`;
- all networks by name: `networks`; Gaussian processes: `gaussian_process`.

The networks compute with whichever array library is passed to them: numpy in a run, JAX in training
(`tis.patient_side.learning`). So there is one implementation of each.
"""
