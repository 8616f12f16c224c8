"""What it costs: figures of speed and punctuality, each beside a yardstick measured in the same run."""
