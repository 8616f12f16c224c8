"""Links: packets offered, held and released; rules, queues, books."""
