"""Import of recordings of many formats into tables that `source: {kind: table}` plays."""
