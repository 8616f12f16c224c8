"""Settings of runs whose estimates nobody looks at: they load and compute least."""

HOLD = (
    "estimators=[hold]",
    "active_estimator=hold",
    "patient.orientation={methods: [hold], active: hold}",
)
