"""Arms at the patient: the recorded one, a servo, and a simulated arm with joints."""
