"""The figures of reports and papers."""
