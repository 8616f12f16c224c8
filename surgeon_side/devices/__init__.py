"""Devices at hand as operators' devices: what mouse and gamepad do, as poses."""
