"""The picture that crosses the network: how it is drawn, stamped, encoded, cut into messages, and put together."""
