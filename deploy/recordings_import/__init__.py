"""Import of recordings: MCAP, rosbag2, LeRobot and JIGSAWS, into tables that `source: {kind: table}` plays."""
