"""The network emulator: delay, jitter and loss between two Zenoh networks.

Where to look:

- a link, from one packet to the log: `link`, `flow`, `packet`, `rules`, `disorder`, `queue`,
  `full_buffer`, `ledger`;
- what befalls a packet: `impairment`, `draws`, `loss`, `delay`, `jitter`, `correlation`, `duplicate`, `corruption`,
  `reorder`, addressed through `blocks`, `column`, `segments` and `trace_rows`;
- what changes with time: `conditions` from `outage`, `states` and `timeline`, on the `grid`;
- what is asked while it runs: `control` and its files, `standing`, `changed_conditions`;
- what is known without running: `figures`, `simulate`, `synopsis`; what fits a record: `fit`;
- who runs it: `node` in virtual time, `bridge` and its files live, between two Zenoh networks.
"""
