"""Links: packets are offered, held and released; rules, queues and the ledger."""
