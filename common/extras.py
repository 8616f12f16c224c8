"""Commands that install the packages of each extra, which errors name where one is missing."""

from typing import Final

GET_REPORT: Final = "pip install 'tis-testbed[report]'"
GET_PARQUET: Final = "pip install 'tis-testbed[parquet]'"
GET_ROSBAG: Final = "pip install 'tis-testbed[rosbag]'"
GET_HOSTS: Final = "pip install 'tis-testbed[hosts]'"
GET_CLUSTER: Final = "pip install 'tis-testbed[cluster]'"
GET_DEVICE: Final = "pip install 'tis-testbed[device]'"
GET_LEARNED: Final = "pip install 'tis-testbed[learned]'"
GET_SIM: Final = "pip install 'tis-testbed[sim]'"
GET_DYNAMICS: Final = "pip install 'tis-testbed[dynamics]'"
